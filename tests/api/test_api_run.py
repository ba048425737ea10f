# SPDX-License-Identifier: BSD-3-Clause
"""A run through the API: what it returns, where it is kept, and that it equals what the command line gives."""

import gc
import json
import warnings
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import coclo_vio as cv
from coclo_vio.cli import app
from coclo_vio.evaluation.evaluation_record import EvaluationRecord
from coclo_vio.runs.run_record import EventRecord, TrajectoryRecord


def test_a_run_without_a_folder_is_removed_with_its_object(leg_log: Path) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error", ResourceWarning)
        run = cv.run(leg_log, "naive")
        folder = run.folder
        assert (folder / "run.json").is_file()
        del run
        gc.collect()
    assert not folder.exists()


def test_a_run_that_cannot_begin_leaves_no_temporary_folder(
    leg_log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    with pytest.raises(cv.CocloError):
        cv.run(leg_log, "stereo")
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_was_given_stays(leg_log: Path, tmp_path: Path) -> None:
    run = cv.run(leg_log, "naive", folder=tmp_path / "out")
    del run
    gc.collect()
    assert (tmp_path / "out" / "naive.tum").is_file()


def test_a_saved_run_is_loaded_with_all_it_had(naive_run: cv.Run, tmp_path: Path) -> None:
    loaded = cv.load_run(naive_run.save(tmp_path / "saved"))
    with pytest.raises(cv.DatasetError, match="would be overwritten; give overwrite=True to replace them"):
        naive_run.save(tmp_path / "saved")
    assert naive_run.save(tmp_path / "saved", overwrite=True) == tmp_path / "saved"
    assert loaded.record == naive_run.record
    assert loaded.names == naive_run.names == ("naive",)
    for ours, theirs in (
        (loaded.estimates(), naive_run.estimates()),
        (loaded.estimates("naive"), naive_run.estimates()),
    ):
        np.testing.assert_array_equal(ours.trajectory.stamps_ns, theirs.trajectory.stamps_ns)
        np.testing.assert_array_equal(ours.trajectory.T_world_body, theirs.trajectory.T_world_body)
        np.testing.assert_array_equal(ours.contact_probability, theirs.contact_probability)
    assert loaded.metrics()["naive"].ate_m == naive_run.metrics()["naive"].ate_m
    assert {path.name for path in loaded.folder.iterdir()} == {path.name for path in naive_run.folder.iterdir()}


def test_a_run_of_several_modes_has_all_their_trajectories(leg_log: Path) -> None:
    run = cv.run(leg_log, ["naive", "naive_rolling"])
    assert run.names == tuple(run.trajectories) == ("naive", "naive_rolling")
    assert set(run.metrics()) == {"naive", "naive_rolling"}
    assert dict(run.failures) == {}


def test_a_mode_that_lacks_something_is_a_failure_beside_the_others(leg_log: Path) -> None:
    run = cv.run(leg_log, ["stereo", "naive"])
    assert set(run.trajectories) == {"naive"}
    assert "walk has no stereo images" in run.failures["stereo"]


def test_the_default_mode_is_run_where_none_is_named(leg_log: Path, coclo_run: cv.Run) -> None:
    assert cv.open(leg_log).default_mode == "coclo"
    assert coclo_run.names == ("coclo",)


def test_combined_has_health_calibration_and_metrics(combined_run: cv.Run) -> None:
    health, learnt = combined_run.health, combined_run.calibrations
    assert len(health) > 5
    assert all(isinstance(one, cv.KeyframeHealth) for one in health)
    assert [one.stamp_ns for one in learnt] == sorted(one.stamp_ns for one in learnt)
    assert combined_run.calibration is not None
    assert combined_run.calibration.stamp_ns == learnt[-1].stamp_ns
    assert (np.abs(combined_run.calibration.rotation_body) < 4.0 * combined_run.calibration.rotation_sigma).all()
    for name, evaluation in combined_run.metrics().items():
        assert evaluation.ate_m < 0.01, name


def test_a_run_of_legs_has_neither_health_nor_calibration(naive_run: cv.Run) -> None:
    assert (naive_run.health, naive_run.calibrations, naive_run.calibration) == ((), (), None)


def test_events_are_in_time_order_and_each_once(naive_run: cv.Run) -> None:
    def with_events(mode: str, *stamps_ns: int) -> TrajectoryRecord:
        events = tuple(EventRecord.of(cv.Event(stamp_ns, "vision_lost", mode), 0) for stamp_ns in stamps_ns)
        return naive_run.record.estimators["naive"].model_copy(update={"mode": mode, "events": events})

    both = with_events("combined", 3, 9)
    estimators = {"vins": with_events("vins", 5), "combined_coclo": both, "combined_vins": both}
    run = cv.Run(naive_run.folder, naive_run.record.model_copy(update={"estimators": estimators}))
    assert [(event.stamp_ns, event.detail) for event in run.events] == [(3, "combined"), (5, "vins"), (9, "combined")]


def test_callbacks_get_progress_and_outputs(leg_log: Path) -> None:
    stamps: list[tuple[str, int]] = []
    outputs: list[tuple[str, cv.Output]] = []
    run = cv.run(
        leg_log,
        "naive",
        progress=lambda mode, stamp_ns: stamps.append((mode, stamp_ns)),
        watch=lambda mode, output: outputs.append((mode, output)),
    )
    assert len(stamps) == run.record.estimators["naive"].measurements
    assert {mode for mode, _ in stamps} == {mode for mode, _ in outputs} == {"naive"}
    assert sum(isinstance(output, cv.Estimate) for _, output in outputs) == len(run.trajectories["naive"])


def test_evaluate_equals_the_command(naive_run: cv.Run, tmp_path: Path) -> None:
    estimate, truth = naive_run.folder / "naive.tum", naive_run.folder / "groundtruth.tum"
    shown = CliRunner().invoke(app, ["evaluate", str(estimate), "--vicon", str(truth), "--json"])
    assert shown.exit_code == 0
    (printed,) = json.loads(shown.stdout).values()
    assert printed == EvaluationRecord.of(cv.evaluate(estimate, truth)).to_json()


def test_metrics_equal_the_command(naive_run: cv.Run) -> None:
    shown = CliRunner().invoke(app, ["evaluate", str(naive_run.folder), "--json"])
    assert shown.exit_code == 0
    computed = {name: EvaluationRecord.of(evaluation).to_json() for name, evaluation in naive_run.metrics().items()}
    assert json.loads(shown.stdout) == computed


def test_evaluate_takes_values_in_place_of_files(naive_run: cv.Run) -> None:
    truth = cv.load_ground_truth(naive_run.folder / "groundtruth.tum")
    of_values = cv.evaluate(cv.read_tum(naive_run.folder / "naive.tum"), truth)
    assert of_values.ate_m == cv.evaluate(naive_run.folder / "naive.tum", naive_run.folder / "groundtruth.tum").ate_m
