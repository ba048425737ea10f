# SPDX-License-Identifier: BSD-3-Clause
"""Modes side by side from the command line: what is printed, and what is written to the folder."""

import json
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from console import Coclo, is_one_sentence

from coclo_vio.api import comparison as api_comparison
from coclo_vio.api.recording import Recording
from coclo_vio.api.run import Run
from coclo_vio.cli import printing
from coclo_vio.evaluation.evaluate import EvaluationConfig, evaluate
from coclo_vio.evaluation.evaluation import Evaluation
from coclo_vio.evaluation.table_one import TableOne
from coclo_vio.geometry import se3
from coclo_vio.values.errors import DatasetError
from coclo_vio.values.trajectory import GroundTruth, Trajectory

CONTRACT_KEYS = {
    *("ate_m", "rpe_1m_percent", "drift_percent", "paper_drift_percent", "velocity_rmse_mps", "yaw_drift_deg"),
    *("path_length_m", "path_length_ratio", "coverage", "anees_pose", "realtime_factor"),
}
Measured = Callable[[float, float], Evaluation]


@pytest.fixture
def measured() -> Measured:
    """``measured(metres, off_m)``: an evaluation after so long a way along x, so far off at its end."""

    def make(metres: float, off_m: float) -> Evaluation:
        def straight(length_m: float) -> Trajectory:
            positions = np.zeros((1001, 3))
            positions[:, 0] = np.linspace(0.0, length_m, 1001)
            return Trajectory(np.arange(1001) * 10_000_000, se3.transform(np.tile(np.eye(3), (1001, 1, 1)), positions))

        config = EvaluationConfig.model_validate({"clock": {"offset_s": 0.0}})
        return evaluate(straight(metres + off_m), GroundTruth(straight(metres), True, "truth"), config)

    return make


@pytest.fixture
def shown(capsys: pytest.CaptureFixture[str]) -> Callable[[], str]:
    """What has been printed since the last call."""
    return lambda: capsys.readouterr().out


@pytest.mark.long
def test_two_recordings_of_one_name_have_a_page_over_both(coclo: Coclo, leg_log: Path, tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    twin = tmp_path / "again" / "walk"
    twin.mkdir(parents=True)
    for file in leg_log.iterdir():
        (twin / file.name).write_bytes(file.read_bytes())
    answer = coclo("compare", leg_log, twin, "--modes", "naive, naive_rolling", "-o", "both")
    assert answer.status == 0
    compared = json.loads((tmp_path / "both" / "compare.json").read_text(encoding="utf-8"))
    assert set(compared) == {"walk", "walk_2"}
    for name, values in compared.items():
        assert set(values) == {"naive", "naive_rolling"}
        assert set(values["naive"]) >= CONTRACT_KEYS
        assert json.loads((tmp_path / "both" / name / "compare.json").read_text(encoding="utf-8")) == values
        assert (tmp_path / "both" / name / "report.html").stat().st_size > 10_000
    assert answer.out.splitlines()[-1] == "report: both/report.html"
    assert "naive: standstill" not in answer.err, "counts are in run.json only"
    assert answer.err.count("clock offset") == 2, "once a recording, not once an estimator"
    assert json.loads((tmp_path / "both" / "ranking.json").read_text(encoding="utf-8")) == {
        name: {"schema_version": 1, "pairs": []} for name in ("walk", "walk_2")
    }
    assert (tmp_path / "both" / "walk" / "figures" / "overview.png").is_file()
    page = (tmp_path / "both" / "report.html").read_text(encoding="utf-8")
    assert '<a href="walk_2/report.html">' in page


def test_a_recording_without_ground_truth_is_refused_before_anything_runs(
    coclo: Coclo, leg_log: Path, tmp_path: Path
) -> None:
    (tmp_path / "bare").mkdir()
    (tmp_path / "bare" / "leg_log.csv").write_bytes((leg_log / "leg_log.csv").read_bytes())
    answer = coclo("compare", leg_log, "bare", "--modes", "naive", "-o", "out")
    assert (answer.status, answer.out) == (1, "")
    assert "bare has no ground truth to compare with" in answer.err
    assert is_one_sentence(answer)
    assert not (tmp_path / "out").exists()


def test_a_recording_that_fails_leaves_the_others_their_results(
    coclo: Coclo, leg_log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """And a report needs neither matplotlib nor plotly."""
    for name in ("matplotlib.figure", "plotly.offline"):
        monkeypatch.setitem(sys.modules, name, None)
    run = api_comparison.run

    def failing_at_first(recording: Recording, *arguments: Any, **options: Any) -> Run:
        if recording.path.name == "first":
            raise DatasetError("the disk is full; make room")
        return run(recording, *arguments, **options)

    monkeypatch.setattr(api_comparison, "run", failing_at_first)
    (tmp_path / "first").symlink_to(leg_log)
    answer = coclo("compare", tmp_path / "first", leg_log, "--modes", "naive")
    assert answer.status == 1
    assert "walk stopped early or has no result: the disk is full; make room" in answer.err
    assert "no mode went through on " in answer.err.splitlines()[-1]
    assert answer.out.splitlines()[-1] == "report: out/report.html"
    assert set(json.loads((tmp_path / "out" / "compare.json").read_text(encoding="utf-8"))) == {"walk_2"}
    assert "no figures: matplotlib is not installed" in answer.err
    assert "no figures" in (tmp_path / "out" / "walk_2" / "report.html").read_text(encoding="utf-8")


def test_small_errors_are_shown_in_millimetres_and_empty_columns_not_at_all(
    measured: Measured, shown: Callable[[], str]
) -> None:
    printing.print_table({"naive": measured(0.6, 0.004), "coclo": measured(0.6, 0.002)}, "short")
    short = shown()
    assert "mm" in short
    assert "RPE" not in short
    assert short.index("coclo ") < short.index("naive "), "the paper's estimators come first"
    printing.print_table({"combined_coclo": replace(measured(6.0, 0.6), anees_pose=22.5, realtime_factor=11.0)}, "long")
    long = shown()
    assert "mm" not in long
    assert "RPE" in long
    assert max(map(len, (short + long).splitlines())) <= 80
    assert "…" not in long, "no number is cut short"


def test_rankings_are_printed_a_line_each(measured: Measured, shown: Callable[[], str]) -> None:
    evaluations = {"coclo": measured(5.0, 0.2), "vins": measured(5.0, 0.1), "combined_coclo": measured(5.0, 0.05)}
    printing.print_ranking(evaluations, EvaluationConfig())
    assert [line.partition(":")[0] for line in shown().splitlines()] == [
        "VINS drifts less than COCLO",
        "combined COCLO drifts less than COCLO",
        "combined COCLO drifts less than VINS",
    ]


def test_the_table_over_several_recordings_fits_a_terminal(measured: Measured, shown: Callable[[], str]) -> None:
    one = dict.fromkeys(("coclo", "vins", "combined_coclo", "combined_vins"), measured(5.0, 0.05))
    printing.print_table_one(TableOne.of({"daisy_stairs_of_a_very_long_name_indeed.mcap": one, "ramp [red]x": one}))
    text = shown()
    assert max(map(len, text.splitlines())) <= 80
    assert "ramp [red]x" in text
    assert text.count(" / 1.00") == 8
    assert "another robot's data" in text
