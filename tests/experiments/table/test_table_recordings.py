# SPDX-License-Identifier: BSD-3-Clause
"""Recordings of a table: those of the plan, whole, made once."""

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from short_walk import MadePlan, plan_of

from coclo_vio.experiments.table import recordings as module
from coclo_vio.experiments.table.recordings import Recordings
from coclo_vio.experiments.table.work_unit import WorkProgress, run_unit, units
from coclo_vio.values.errors import DatasetError, SimulationError

Made = Callable[..., MadePlan]


def test_a_missing_recording_is_simulated_over_the_remains_of_a_killed_run(tmp_path: Path) -> None:
    plan = plan_of(until_s=1.0)
    recordings = Recordings(tmp_path, plan)
    (tmp_path / "flat_1_truth").mkdir()
    (tmp_path / ".flat_1.killed").mkdir()
    (tmp_path / ".flat_12.alive").mkdir()
    recordings.make("flat", 1)
    recordings.check()
    assert {path.name for path in tmp_path.iterdir()} == {"flat_1", "flat_1_truth", ".flat_12.alive"}
    assert recordings.truth("flat", 1).trajectory.duration_s == pytest.approx(1.0, abs=0.02)


def test_a_recording_made_by_another_process_is_used(made: Made, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "simulate_recording", lambda *_, **__: pytest.fail("it was simulated again"))
    recordings = made().recordings
    recordings.make("flat", 1)
    recordings.check()


def test_a_recording_of_other_settings_is_refused(made: Made) -> None:
    folder = made().recordings.folder
    with pytest.raises(
        DatasetError, match=r"flat_1 was simulated with other settings \(trial.imperfection\); .* --recordings"
    ):
        Recordings(folder, plan_of(ideal=True)).check()
    shutil.rmtree(folder / "flat_1_truth")
    with pytest.raises(DatasetError, match="flat_1 has no truth beside it"):
        Recordings(folder, plan_of()).check()
    (folder / "flat_1_truth").mkdir()
    (folder / "flat_1_truth" / "groundtruth.tum").touch()
    (folder / "flat_1_truth" / "config.yaml").write_text("trial: {legs: 8}", encoding="utf-8")
    with pytest.raises(DatasetError, match=r"by another release .* there is no trial.legs"):
        Recordings(folder, plan_of()).check()


@pytest.mark.parametrize("keeps", [True, False])
def test_a_recording_is_removed_after_its_last_job_unless_it_is_kept(keeps: bool, made: Made) -> None:
    table = made(seeds=2)
    recordings = Recordings(table.recordings.folder, table.plan, keeps)
    table.store.prepare()
    first, _ = units(table.plan, recordings, table.store, {})
    run_unit(first, lambda _: None)
    gone = set() if keeps else {"flat_1", "flat_1_truth"}
    there = {path.name for path in recordings.folder.iterdir()}
    assert there == {"flat_1", "flat_1_truth", "flat_2", "flat_2_truth"} - gone


def test_a_trial_that_cannot_be_simulated_fails_its_jobs_and_no_others(
    made: Made, monkeypatch: pytest.MonkeyPatch
) -> None:
    def falls(path: Path, *_: object, **__: object) -> None:
        raise SimulationError(f"{path}: the robot fell after 3 s")

    monkeypatch.setattr(module, "simulate_recording", falls)
    table = made(seeds=2)
    shutil.rmtree(table.recordings.folder / "flat_1")
    table.store.prepare()
    steps: list[WorkProgress] = []
    for unit in units(table.plan, table.recordings, table.store, {}):
        run_unit(unit, steps.append)
    first, second = (table.store.read(job) for job in table.plan.jobs())
    assert first is not None
    assert first.failure == "flat_1: the robot fell after 3 s"
    assert second is not None
    assert second.failure is None
    assert [step.kind for step in steps] == ["simulating", "running", "failed", "ended", "running", "done", "ended"]
