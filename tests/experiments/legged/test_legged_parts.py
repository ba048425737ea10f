# SPDX-License-Identifier: BSD-3-Clause
"""The parts of the benchmark of legged odometry, with answers known by hand."""

from pathlib import Path

import numpy as np
import pytest

from coclo_vio.experiments.legged import __main__ as command
from coclo_vio.experiments.legged.impact_figure import impact_figure
from coclo_vio.experiments.legged.impact_strength import impact_strength
from coclo_vio.experiments.legged.legged_job import LeggedJob, recorded
from coclo_vio.experiments.legged.legged_plan import IMPACT_ESTIMATORS, LEG_ESTIMATORS, LeggedPlan
from coclo_vio.experiments.legged.legged_record import (
    ImpactStrength,
    LeggedFigures,
    LeggedJobRecord,
    LeggedRecord,
    LeggedTrajectory,
)
from coclo_vio.experiments.legged.legged_recording import LeggedRecording, LeggedRecordings, recordings_of
from coclo_vio.experiments.legged.legged_summary import differences, rows_of, summarise
from coclo_vio.experiments.legged.legged_text import failure_lines, impact_rows, overview_head, overview_rows
from coclo_vio.experiments.legged.relative_consistency import anees_per_metre
from coclo_vio.experiments.legged.smoother_mode import GTSAM_SMOOTHER, smoother_mode
from coclo_vio.experiments.results.provenance import Provenance
from coclo_vio.runs.modes.registry import modes
from coclo_vio.simulation.trot.ground import GROUNDS
from coclo_vio.values.errors import DatasetError, EvaluationError
from coclo_vio.values.measurements import ImuSample
from coclo_vio.values.trajectory import Trajectory

ORIGIN = Provenance(commit="abc1234", date="2026-01-02", machine="one", versions={}, command="a command")


def figures(drift_percent: float | None = 1.0, anees_pose: float | None = 1.0) -> LeggedFigures:
    values = dict.fromkeys(LeggedFigures.model_fields, 1.0)
    return LeggedFigures(**values | {"drift_percent": drift_percent, "anees_pose": anees_pose})


def job_record(
    group: str, seed: int, trajectories: dict[str, float | str], kind: str = "trot", peak_mps2: float = 9.0
) -> LeggedJobRecord:
    """A finished job: the drift of each trajectory, or why it failed."""
    return LeggedJobRecord(
        kind=kind,
        group=group,
        seed=seed,
        estimator=next(iter(trajectories), "coclo"),
        origin=ORIGIN,
        not_recorded=None if trajectories else "the robot fell",
        impacts=ImpactStrength(std_mps2=3.0, peak_mps2=peak_mps2),
        cpu_ms_per_joint_sample=0.5,
        trajectories={
            name: LeggedTrajectory(figures=None, failure=drift)
            if isinstance(drift, str)
            else LeggedTrajectory(figures=figures(drift), failure=None)
            for name, drift in trajectories.items()
        },
    )


def record_of(*jobs: LeggedJobRecord) -> LeggedRecord:
    rows = tuple(rows_of(jobs))
    return LeggedRecord(
        command="a command", commit="abc1234", seeds=(11,), rows=rows, not_recorded={}, finished=1, planned=1
    )


def test_every_robot_trots_on_every_ground_and_the_daisy_walks(tmp_path: Path) -> None:
    (tmp_path / "icub_sway").mkdir()
    found = recordings_of([11, 12], data=tmp_path)
    trots = {(each.robot, each.ground, each.seed) for each in found if each.kind == "trot"}
    assert trots == {(robot, ground, seed) for robot in ("go1", "anymal_b") for ground in GROUNDS for seed in (11, 12)}
    assert [each.group for each in found if each.kind == "log"] == ["icub_sway"]
    assert found[0].robot == str(tmp_path / "icub_sway" / "icub.yaml")
    assert sum(each.kind == "walk" for each in found) == 6
    assert len({each.name for each in found}) == len(found)
    assert "go1 flat 50 m" in {each.group for each in found}
    assert all(":" not in each.name and "/" not in each.name for each in recordings_of([1], impacts=True))


def test_jobs_are_chosen_by_a_part_of_their_name_and_finished_ones_are_left_out(tmp_path: Path) -> None:
    plan = LeggedPlan(tmp_path, tuple(recordings_of([11], distance_m=3.0, impacts=True)), "abc1234", "def5678")
    assert [job.name for job in plan.jobs("go1_flat*inekf")] == ["go1_flat_3_m_11-inekf"]
    assert {job.estimator for job in plan.jobs("rough")} == set(LEG_ESTIMATORS)
    assert {job.estimator for job in plan.jobs("touch-down")} == set(IMPACT_ESTIMATORS)
    assert len(plan.work("go1_flat")[0].jobs) == len(LEG_ESTIMATORS)
    assert [job.estimator for job in plan.work("go1_flat", ["coclo", "naive"])[0].jobs] == ["coclo", "naive"]
    plan.files.write("go1_flat_3_m_11-coclo", job_record("go1 flat 3 m", 11, {"coclo": 1.0}))
    assert [job.estimator for job in plan.work("go1_flat")[0].jobs] == list(LEG_ESTIMATORS[1:])
    record = summarise(plan, "a command")
    assert [row.trajectory for row in record.rows] == ["coclo"]
    assert (record.finished, record.planned) == (1, len(list(plan.jobs())))
    with pytest.raises(DatasetError, match=r"no job of commit 0000000 is finished in .*; run the benchmark first"):
        summarise(LeggedPlan(tmp_path, plan.recordings, "0000000", "def5678"), "a command")


def test_a_recording_that_is_not_there_is_a_result(tmp_path: Path) -> None:
    log = LeggedRecording("log", "go1_mocap", "go1", log=tmp_path / "go1_mocap")
    found = recorded(log, LeggedRecordings(tmp_path))
    assert found.reason == "there is no go1_mocap; name the folder of the logs with --data, or leave them out"


def test_impacts_are_measured_while_the_robot_moves() -> None:
    size = np.full(400, 9.81)
    size[200::2] += 3.0  # the second half: every other sample 3 m/s^2 above gravity
    samples = [
        ImuSample(5_000_000 * index, np.zeros(3), np.array([0.0, 0.0, value])) for index, value in enumerate(size)
    ]
    strength = impact_strength(samples)
    assert strength is not None
    assert strength.std_mps2 == pytest.approx(1.5)
    assert strength.peak_mps2 == pytest.approx(3.0)
    assert impact_strength(samples[:200]) is None
    assert impact_strength(samples[:5]) is None


@pytest.mark.parametrize(("assumed", "expected"), [(1.0, 1.0), (0.5, 4.0)])
def test_a_random_walk_is_consistent_over_a_metre_by_its_own_noise(assumed: float, expected: float) -> None:
    """Steps of 1 cm along x with 1 mm of noise on each axis; half the sigma assumed is four times the NEES."""
    steps, sigma = 20_000, 1e-3
    walk = np.zeros((steps, 3))
    walk[:, 0] = 0.01 * np.arange(steps)
    noisy = walk + np.cumsum(np.random.default_rng(3).normal(0.0, sigma, (steps, 3)), axis=0)
    covariance = np.zeros((steps, 6, 6))
    covariance[:, 3:, 3:] = (assumed * sigma) ** 2 * np.arange(1, steps + 1)[:, None, None] * np.eye(3)
    stamps = 100_000_000 * np.arange(steps)
    estimate = Trajectory(stamps, poses(noisy), covariance=covariance)
    reference = Trajectory(stamps, poses(walk))
    assert anees_per_metre(estimate, reference) == pytest.approx(expected, rel=0.15)
    assert anees_per_metre(Trajectory(stamps, poses(noisy)), reference) is None


def poses(positions: np.ndarray) -> np.ndarray:
    T_world_body = np.tile(np.eye(4), (len(positions), 1, 1))
    T_world_body[:, :3, 3] = positions
    return T_world_body


def test_a_failed_run_has_infinite_errors_in_the_median() -> None:
    jobs = [job_record("go1 flat", seed, {"coclo": drift}) for seed, drift in ((11, 1.0), (12, 3.0), (13, "it broke"))]
    (row,) = rows_of(jobs)
    assert (row.runs, row.failures, row.reasons) == (3, 1, ("it broke",))
    assert row.figures.drift_percent == 3.0
    assert row.figures.anees_pose == 1.0
    (row,) = rows_of(jobs[1:])
    assert row.figures.drift_percent is None
    assert rows_of([job_record("go1 slippery", 11, {})]) == []


def test_the_least_drift_of_a_recording_is_bold_and_failures_are_named() -> None:
    record = record_of(
        job_record("go1 flat", 11, {"coclo": 1.0}),
        job_record("go1 flat", 11, {"inekf": 2.0}),
        job_record("go1 rough", 11, {"inekf": "it broke"}),
    )
    assert overview_head(record) == ("recording", "`coclo`", "`inekf`")
    assert list(overview_rows(record)) == [
        ("go1 flat", "**1.00** / 1.00, 1.00", "2.00 / 1.00, 1.00"),
        ("go1 rough", "", "- / - (1 of 1 failed)"),
        ("ms a joint sample", "0.50", "0.50"),
    ]
    assert failure_lines(record) == ["* go1 rough, `inekf`, 1 of 1 failed: it broke"]


def test_impacts_are_listed_from_soft_to_hard_and_drawn() -> None:
    record = record_of(
        *(
            job_record("go1 hard", 11, {name: drift}, "impacts", 30.0)
            for name, drift in (("coclo", 1.0), ("inekf", 4.0))
        ),
        *(
            job_record("go1 soft", 11, {name: drift}, "impacts", 3.0)
            for name, drift in (("coclo", 2.0), ("inekf", 1.0))
        ),
    )
    assert [(row[0], row[-1]) for row in impact_rows(record)] == [
        ("go1 soft", "0.50 / 1.00"),
        ("go1 hard", "4.00 / 1.00"),
    ]
    (ours, theirs) = impact_figure(record).axes[0].lines
    assert list(ours.get_xdata()) == list(theirs.get_xdata()) == [3.0, 30.0]
    assert list(theirs.get_ydata()) == [1.0, 4.0]
    with pytest.raises(EvaluationError, match="run the benchmark with --impacts"):
        impact_figure(record_of(job_record("go1 flat", 11, {"coclo": 1.0})))


def test_what_changed_since_a_record_is_named() -> None:
    before = record_of(job_record("flat", 11, {"coclo": 1.0, "inekf": 2.0, "naive": 5.0}))
    after = record_of(job_record("flat", 11, {"coclo": 0.5, "inekf": 2.0, "tight": 0.1}))
    assert differences(before, after) == [
        "flat, coclo: drift 1.00 -> 0.50 %, ANEES 1.00 -> 1.00",
        "flat, tight: new",
        "flat, naive: not in this record",
    ]
    assert differences(before, before) == []
    failed = record_of(job_record("flat", 11, {"coclo": "it broke"}))
    assert differences(before, failed)[0] == "flat, coclo: drift 1.00 -> - %, ANEES 1.00 -> -, 0 -> 1 failed"


def test_publishing_writes_record_origin_and_pages(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "docs" / "results").mkdir(parents=True)
    (tmp_path / "docs" / "results" / "provenance.json").write_text("{}", encoding="utf-8")
    before = record_of(job_record("flat", 11, {"coclo": 1.0}))
    monkeypatch.setattr(command, "committed_text", lambda root, path: before.model_dump_json())
    monkeypatch.setattr(command, "render", lambda root: [root / "docs" / "legged.md"])
    monkeypatch.setattr(command.Provenance, "now", lambda line, root: ORIGIN)
    after = record_of(job_record("flat", 11, {"coclo": 0.5}))
    command._publish(after, tmp_path)
    printed = capsys.readouterr().out
    assert "flat, coclo: drift 1.00 -> 0.50 %, ANEES 1.00 -> 1.00" in printed
    assert LeggedRecord.read(tmp_path / "docs" / "results" / "legged.json") == after
    assert "abc1234" in (tmp_path / "docs" / "results" / "provenance.json").read_text(encoding="utf-8")


def test_the_smoother_is_a_mode_for_the_time_of_the_benchmark_only() -> None:
    assert GTSAM_SMOOTHER not in modes()
    with smoother_mode():
        assert GTSAM_SMOOTHER in modes()
    assert GTSAM_SMOOTHER not in modes()


def test_a_job_has_the_name_of_its_recording_and_mode() -> None:
    recording = LeggedRecording("trot", "go1 flat 50 m", "go1", "flat", 11, images=True)
    assert LeggedJob(recording, "tight").name == "go1_flat_50_m_images_11-tight"


def test_the_command_says_what_is_left_and_that_nothing_is_finished(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit, match=r"legged: no job of commit .* is finished in"):
        command.main(["-o", str(tmp_path), "--data", str(tmp_path), "--only", "no such recording"])
    assert "0 jobs on 0 recordings are left" in capsys.readouterr().err


def test_the_line_of_the_record_repeats_the_benchmark() -> None:
    line = "-o out --seeds 3 --distance 4 --only go1 --impacts --workers 2 --publish"
    options = command._parser().parse_args(line.split())
    expected = "-o OUT --seeds 3 --first-seed 11 --distance 4 --impacts"
    assert command._command(options) == f"python -m coclo_vio.experiments.legged {expected}"
