# SPDX-License-Identifier: BSD-3-Clause
"""A recording whose clock steps gives a run folder that is read, resumed and evaluated as any other."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from coclo_vio.datasets.writer import write_leg_log
from coclo_vio.robot.description import load_robot
from coclo_vio.robot.model import RobotModel
from coclo_vio.runs import run_folder
from coclo_vio.runs.evaluating import evaluate_run
from coclo_vio.runs.observers import Observers
from coclo_vio.runs.run_config import RunConfig, resolve
from coclo_vio.runs.run_folder import Existing
from coclo_vio.runs.run_record import ClockStepRecord, RunRecord
from coclo_vio.runs.running import Ending, run_modes
from coclo_vio.runs.stepped_clock import has_stepped_too, sample_stamps_ns
from coclo_vio.simulation.analytic import AnalyticTrialConfig, generate
from coclo_vio.simulation.body_motion import BodyMotionConfig
from coclo_vio.values.outputs import Estimate, Output
from coclo_vio.values.trajectory import GroundTruth, Trajectory

NS = 1_000_000_000
BEGIN_NS = 5000 * NS


def _config(step_s: float) -> RunConfig:
    settings = ["checkpoints.interval_s=0.5", "dataset.reading_threads=0"]
    return resolve("daisy", settings=[*settings, f"faults.clock_steps=['all:1.6:100:{step_s}']"])


def _estimates(folder: Path, mode: str = "coclo") -> Trajectory:
    return run_folder.read_estimates(folder, mode).trajectory


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three seconds of a Daisy that stands and walks, from 5000 s on, with its truth."""
    folder, robot = tmp_path_factory.mktemp("late") / "log", load_robot("daisy")
    body = BodyMotionConfig(rest_s=0.8, walk_s=2.0, stop_s=0.2, ramp_s=0.4)
    trial = generate(AnalyticTrialConfig(body=body), RobotModel(robot), seed=12)
    measurements = [replace(each, stamp_ns=each.stamp_ns + BEGIN_NS) for each in trial.measurements]
    truth = trial.truth.restamped(trial.truth.stamps_ns + BEGIN_NS)
    write_leg_log(folder, robot, measurements, GroundTruth(truth, True, "truth"))
    return folder


@pytest.fixture(scope="module")
def straight(log: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The run whose clock does not step."""
    folder = tmp_path_factory.mktemp("straight")
    run_modes(log, ["coclo"], resolve("daisy"), folder)
    return folder


@pytest.mark.long
@pytest.mark.parametrize("step_s", [-1000.0, 1000.0])
def test_files_have_the_first_clock_and_outputs_that_of_the_samples(
    step_s: float, log: Path, straight: Path, tmp_path: Path
) -> None:
    given: list[int] = []

    def watch(_: str, output: Output) -> None:
        if isinstance(output, Estimate):
            given.append(output.state.stamp_ns)

    config = _config(step_s)
    run_modes(log, ["coclo"], config, tmp_path, observers=Observers(watch=watch))
    record = run_folder.read_record(tmp_path)
    run, whole = record.estimators["coclo"], run_folder.read_record(straight).estimators["coclo"]
    found, expected = _estimates(tmp_path), _estimates(straight)
    (step,) = run.clock_steps
    assert step.step_ns == pytest.approx(step_s * NS, abs=10_000_000)  # to a period of the samples
    np.testing.assert_allclose(found.stamps_ns, expected.stamps_ns, atol=10_000_000)
    assert (np.diff(given) < 0).any() == (step_s < 0)
    np.testing.assert_array_equal(sample_stamps_ns(found.stamps_ns, run.clock_steps), given)
    assert record.recording_ns is not None
    assert record.recording_ns[1] - record.recording_ns[0] < 3.1 * NS
    assert [(event.kind, event.stamp_ns) for event in run.events if event.kind == "clock_step"] == [
        ("clock_step", step.at_ns)
    ]
    assert run.last_ns == pytest.approx(whole.last_ns, abs=10_000_000)
    evaluations, failures = evaluate_run(tmp_path, config.evaluation)
    before = evaluate_run(straight, config.evaluation)[0]["coclo"]
    assert failures == {}
    evaluation = evaluations["coclo"]
    assert evaluation.coverage == pytest.approx(before.coverage, abs=0.02)
    assert evaluation.ate_m == pytest.approx(before.ate_m, abs=0.01)
    how = "back" if step_s < 0 else "forward"
    assert f"the clock of all streams stepped {how} by 1000 s at 1.6" in " ".join(evaluation.notes)
    assert "is compared by the clock before that" in " ".join(evaluation.notes)


def test_a_ground_truth_that_jumped_ahead_too_is_compared_by_its_own_clock(log: Path, tmp_path: Path) -> None:
    config = _config(1000.0)
    run_modes(log, ["naive"], config, tmp_path)
    run = run_folder.read_record(tmp_path).estimators["naive"]
    before = evaluate_run(tmp_path, config.evaluation)[0]["naive"]
    truth = run_folder.read_ground_truth(tmp_path, run_folder.read_record(tmp_path))
    assert truth is not None
    jumped = truth.trajectory.restamped(sample_stamps_ns(truth.trajectory.stamps_ns, run.clock_steps))
    evaluations, failures = evaluate_run(tmp_path, config.evaluation, GroundTruth(jumped, True, "other"))
    assert failures == {}
    assert evaluations["naive"].ate_m == pytest.approx(before.ate_m, rel=0.05)
    assert "by the clock of the samples, as it stepped too" in " ".join(evaluations["naive"].notes)


def test_a_truth_has_stepped_too_where_it_has_a_hole_there() -> None:
    stamps_ns = np.arange(0, 10 * NS, NS // 100)
    poses = np.broadcast_to(np.eye(4), (len(stamps_ns), 4, 4))
    ahead = (ClockStepRecord(at_ns=4 * NS, step_ns=100 * NS),)
    jumped = sample_stamps_ns(stamps_ns, ahead)
    assert has_stepped_too(Trajectory(jumped, poses), ahead)
    assert not has_stepped_too(Trajectory(stamps_ns, poses), ahead)
    long = np.arange(0, 200 * NS, NS // 5)
    assert not has_stepped_too(Trajectory(long, np.broadcast_to(np.eye(4), (len(long), 4, 4))), ahead)
    assert not has_stepped_too(Trajectory(jumped, poses), (ClockStepRecord(at_ns=4 * NS, step_ns=-100 * NS),))
    assert not has_stepped_too(Trajectory(jumped, poses), ())


@pytest.mark.long
def test_a_run_that_was_killed_after_the_step_goes_on_with_it(log: Path, tmp_path: Path) -> None:
    config, left = _config(-1000.0), tmp_path / "killed"
    at_ns = BEGIN_NS - 1000 * NS + 2_470_000_000

    def progress(_: str, stamp_ns: int) -> None:
        if stamp_ns == at_ns and not left.exists():
            shutil.copytree(tmp_path / "whole", left)

    run_modes(log, ["coclo"], config, tmp_path / "whole", observers=Observers(progress=progress))
    assert left.exists()
    assert RunRecord.read(left / "run.json").status == "running"
    assert evaluate_run(left, config.evaluation)[1] == {}
    record = run_modes(log, ["coclo"], config, left, ending=Ending(Existing.RESUME))
    run, whole = record.estimators["coclo"], run_folder.read_record(tmp_path / "whole").estimators["coclo"]
    (resumed_ns,) = run.resumed_ns
    assert BEGIN_NS + 1.6 * NS < resumed_ns < BEGIN_NS + 2.47 * NS
    assert len(run.clock_steps) == 1
    assert (run.clock_steps, run.events, run.counts) == (whole.clock_steps, whole.events, whole.counts)
    for name in ("coclo.tum", "coclo_state.csv"):
        assert (left / name).read_bytes() == (tmp_path / "whole" / name).read_bytes()
