# SPDX-License-Identifier: BSD-3-Clause
"""The parts of the matrix of faults, with answers known by hand."""

from pathlib import Path

import numpy as np
import pytest

from coclo_vio.experiments.faults import __main__ as command
from coclo_vio.experiments.faults.estimates_taken import EstimatesTaken
from coclo_vio.experiments.faults.fault_cases import CASES, KINDS, MODES, NOMINAL
from coclo_vio.experiments.faults.fault_job import FaultJob, run_fault_job
from coclo_vio.experiments.faults.fault_plan import FaultPlan, FaultUnit
from coclo_vio.experiments.faults.fault_record import (
    FaultFigures,
    FaultJobRecord,
    FaultRow,
    FaultsRecord,
    FaultTrajectory,
)
from coclo_vio.experiments.faults.fault_recording import ROBOTS, FaultRecording
from coclo_vio.experiments.faults.fault_summary import rows_of
from coclo_vio.experiments.faults.fault_text import amiss_lines, counts_sentence, event_rows, figure_rows
from coclo_vio.experiments.results.provenance import Provenance
from coclo_vio.robot.description import load_robot
from coclo_vio.runs.faults import Faults
from coclo_vio.runs.run_config import resolve
from coclo_vio.values.errors import ConfigError
from coclo_vio.values.estimates import NavState, StateEstimate
from coclo_vio.values.outputs import Estimate

ORIGIN = Provenance(commit="abc1234", date="2026-01-02", machine="one", versions={}, command="a command")
SENSORS = {
    "coclo": ("imu", "joints", "foot_force"),
    "vins": ("camera_imu", "stereo"),
    "combined": ("imu", "joints", "foot_force", "camera_imu", "stereo"),
}


def trajectory(
    drift: float | None,
    anees: float = 1.0,
    events: dict[str, int] | None = None,
    mode: str = "combined",
    **values: object,
) -> FaultTrajectory:
    figures = FaultFigures(
        drift_percent=drift, rpe_1m_percent=1.0, anees_pose=anees, coverage=1.0, worst_second_m=0.1, usual_m=0.05
    ).model_copy(update=values)
    return FaultTrajectory(figures=figures, failure=None, unreadable=None, events=events or {}, sensors=SENSORS[mode])


def job(case: str, mode: str, one: FaultTrajectory, seed: int = 1, *, is_as_nominal: bool = False) -> FaultJobRecord:
    return FaultJobRecord(
        robot="go1",
        seed=seed,
        case=case,
        mode=mode,
        origin=ORIGIN,
        not_run=None,
        is_as_nominal=is_as_nominal,
        trajectories={mode: one},
    )


def nominal(drift: float = 0.5, seed: int = 1) -> list[FaultJobRecord]:
    return [job(NOMINAL, mode, trajectory(drift, events={"frequent": 2}, mode=mode), seed) for mode in SENSORS]


def row_of(records: list[FaultJobRecord], case: str, name: str = "combined") -> FaultRow:
    (row,) = [each for each in rows_of(records) if (each.case, each.trajectory) == (case, name)]
    return row


@pytest.mark.parametrize("name", ROBOTS)
def test_every_case_is_a_configuration_of_every_robot(name: str) -> None:
    robot = load_robot(name)
    for case in CASES.values():
        config = resolve(name, settings=case.settings_on(robot, 7.3, 16.3))
        assert config.faults.is_none == (case.name == NOMINAL), case.name
        Faults(config.faults, robot)
    assert sum(map(len, KINDS.values())) == len(CASES) - 1 >= 25
    assert len({case.file_name for case in CASES.values()}) == len(CASES)


def test_a_fault_lasts_as_long_as_its_case_says() -> None:
    for case in CASES.values():
        if case.seconds is None:
            continue
        settings = case.settings_on(load_robot("go1"), 7.3, 16.3)
        assert f":7.3:{case.seconds:g}" in settings[0] or f"'7.3:{case.seconds:g}" in settings[0], case.name


def test_what_is_healthy_follows_from_what_legs_and_cameras_read() -> None:
    dark, silent, all_steps = "blackout 4 s", "joints silent 2 s", "all clocks step back 1000 s"
    records = nominal() + [job(case, "combined", trajectory(0.6)) for case in (dark, silent, all_steps)]
    assert row_of(records, dark).has_healthy_half
    assert row_of(records, silent).has_healthy_half
    assert not row_of(records, all_steps).has_healthy_half
    assert not row_of(records, NOMINAL).has_healthy_half


def test_a_run_is_silent_only_if_it_is_wrong_and_no_event_is_new() -> None:
    case = "blackout 4 s"
    for one, expected in (
        (trajectory(5.5), True),
        (trajectory(5.5, events={"frequent": 2}), True),
        (trajectory(5.5, events={"frequent": 3}), False),
        (trajectory(5.5, events={"other": 1}), False),
        (trajectory(4.5), False),
        (trajectory(0.5, coverage=0.5), True),
        (trajectory(5.5).model_copy(update={"failure": "it says why"}), False),
    ):
        row = row_of([*nominal(), job(case, "combined", one)], case)
        assert row.is_silent is expected
    assert not row_of([*nominal(6.0), job(case, "combined", trajectory(6.5))], case).is_silent, "it is not the fault"


def test_combined_may_drift_three_percent_or_three_times_nominal_with_a_healthy_half() -> None:
    case = "blackout 4 s"
    for before, after, expected in ((0.5, 2.9, False), (0.5, 3.1, True), (2.0, 5.9, False), (2.0, 6.1, True)):
        row = row_of([*nominal(before), job(case, "combined", trajectory(after, events={"why": 1}))], case)
        assert row.is_worse is expected
        assert not row.is_silent
    assert not row_of(
        [*nominal(), job("all clocks step back 1000 s", "combined", trajectory(9.0))], "all clocks step back 1000 s"
    ).is_worse


def test_an_anees_above_four_needs_an_event() -> None:
    case = "blackout 4 s"
    assert row_of([*nominal(), job(case, "combined", trajectory(1.0, 4.5))], case).is_unexplained
    assert not row_of([*nominal(), job(case, "combined", trajectory(1.0, 4.5, {"why": 1}))], case).is_unexplained
    assert not row_of([*nominal(), job(case, "combined", trajectory(1.0, 3.5))], case).is_unexplained


def test_a_row_is_the_worst_over_seeds() -> None:
    case = "blackout 4 s"
    recovered = {"recovery_s": 1.5, "has_recovered": True}
    records = nominal(seed=1) + nominal(seed=2)
    records += [job(case, "combined", trajectory(1.0, 2.0, {"a": 1}, **recovered), 1)]
    records += [job(case, "combined", trajectory(2.0, 1.5, {"a": 3, "b": 1}, has_recovered=False), 2)]
    row = row_of(records, case)
    assert (row.drift_percent, row.anees_pose, row.recovery_s, row.never_recovered) == (2.0, 2.0, 1.5, 1)
    assert row.events == {"a": 3, "b": 1}
    assert row.seeds == 2


def record_of(records: list[FaultJobRecord]) -> FaultsRecord:
    return FaultsRecord(
        command="a command",
        commit="abc1234",
        seeds={"go1": (1,)},
        rows=tuple(rows_of(records)),
        not_run={"go1 1, blackout 4 s, vins": "it broke"},
        finished=1,
        planned=2,
    )


def test_where_legs_and_cameras_alone_are_missing_nothing_is_said_of_healthy_halves() -> None:
    of_fault = job("blackout 4 s", "combined", trajectory(9.0))
    assert "1 are worse than they may be" in counts_sentence(record_of([*nominal(), of_fault]))
    alone = [each for each in nominal() if each.mode == "combined"]
    sentence = counts_sentence(record_of([*alone, of_fault]))
    assert "is not known without `coclo` and `vins`" in sentence
    assert "worse than they may be, and" not in sentence


def test_the_tables_show_figures_events_and_what_is_amiss() -> None:
    case = "blackout 4 s"
    record = record_of(
        [
            *nominal(),
            job(case, "coclo", trajectory(0.5, mode="coclo"), is_as_nominal=True),
            job(case, "combined", trajectory(7.0, 1.2, recovery_s=2.0, has_recovered=True)),
            job("joints silent 2 s", "combined", trajectory(1.0, events={"why": 2})),
        ]
    )
    figures = {row[0]: row[1:] for row in figure_rows(record, "go1")}
    assert figures[NOMINAL] == ("0.50 / 0.100, 1.0",) * 3
    assert figures[case] == ("=", "**exception**", "7.00 / 0.100 / 2.0 s, 1.2 **silent, worse**")
    events = {row[0]: row[1:] for row in event_rows(record, "go1")}
    assert events == {case: ("=", "exception", "-"), "joints silent 2 s": ("", "", "`why` 2")}
    lines = amiss_lines(record)
    assert lines[0] == "* go1, blackout 4 s, `combined`: wrong and silent: drift 7.00 %, ANEES 1.20, coverage 1.00."
    assert lines[-1] == "* go1 1, blackout 4 s, vins: it broke"
    assert len(lines) == 3


@pytest.mark.parametrize("step_s", [0.0, 1000.0, -1000.0])
def test_estimates_after_a_step_of_all_clocks_are_on_the_clock_of_the_truth(step_s: float) -> None:
    begin_ns, second = 1_700_000_000_000_000_000, 1_000_000_000
    taken = EstimatesTaken(begin_ns, begin_ns + 20 * second, step_s)
    for row in range(20):
        pose = np.eye(4)
        pose[0, 3] = row
        stamp_ns = begin_ns + row * second + (round(step_s * 1e9) if row >= 10 else 0)
        nav = NavState(pose, np.ones(3), np.zeros(3), np.zeros(3), np.zeros(3))
        taken.take(Estimate("one", StateEstimate(stamp_ns, nav, np.eye(9))))
    found = taken.trajectory("one")
    assert found is not None
    assert found.stamps_ns.tolist() == [begin_ns + row * second for row in range(20)]
    assert found.positions[:, 0].tolist() == list(range(20))
    assert taken.trajectory("other") is None


def plan_in(folder: Path) -> FaultPlan:
    return FaultPlan(folder, ("go1",), (1,), ("coclo", "combined"), "abc1234", "def5678")


def test_a_job_that_is_there_is_not_run_again_and_one_without_a_run_is(tmp_path: Path) -> None:
    plan = plan_in(tmp_path)
    assert len(list(plan.jobs())) == 2 * len(CASES)
    assert {each.case.name for each in plan.jobs("blackout*")} == {NOMINAL, "blackout 4 s"}
    first = plan.work("blackout")
    assert [unit.is_nominal for unit in first] == [True, False]
    finished, failed = first[1].jobs
    plan.files.write(finished.name, job("blackout 4 s", "coclo", trajectory(1.0, mode="coclo")))
    broken = job("blackout 4 s", "combined", trajectory(1.0)).model_copy(update={"not_run": "it broke"})
    plan.files.write(failed.name, broken)
    assert [each.name for each in plan.work("blackout")[1].jobs] == [failed.name]
    assert len(plan.finished()) == 2


def test_a_recording_that_cannot_be_made_is_the_result_of_its_jobs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(self: FaultRecording) -> None:
        raise ValueError(f"no OpenGL for {self.name}")

    monkeypatch.setattr(FaultRecording, "make", refuse)
    plan = plan_in(tmp_path)
    (unit, *_) = plan.work("blackout")
    lines = FaultUnit.run(unit, ORIGIN)["lines"]
    assert lines == [
        f"go1_1-nominal-{mode}: not recorded: ValueError: no OpenGL for go1_1" for mode in ("coclo", "combined")
    ]


def test_all_recordings_are_run_without_a_fault_before_any_is_run_with_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def refuse(self: FaultRecording) -> None:
        raise ValueError("no OpenGL")

    monkeypatch.setattr(FaultRecording, "make", refuse)
    monkeypatch.setattr(command, "run_all_kernels", lambda: None)
    only = ("--robots", "go1", "--modes", "coclo", "--only", "blackout")
    command.main(["-o", str(tmp_path), "--seeds", "2", *only])
    head, *lines = capsys.readouterr().err.splitlines()
    assert head.endswith(": 4 jobs are left")
    names = ("go1_1-nominal", "go1_2-nominal", "go1_1-blackout_4_s", "go1_2-blackout_4_s")
    assert lines == [f"{name}-coclo: not recorded: ValueError: no OpenGL" for name in names]


def test_a_mode_that_reads_nothing_with_the_fault_has_the_figures_without_it(tmp_path: Path) -> None:
    recording = FaultRecording("go1", 1, tmp_path)
    before = job(NOMINAL, "coclo", trajectory(0.7, mode="coclo"))
    same = run_fault_job(FaultJob(recording, CASES["blackout 4 s"], "coclo"), before, ORIGIN)
    assert same.is_as_nominal
    assert same.trajectories == before.trajectories
    other = run_fault_job(FaultJob(recording, CASES["joints silent 2 s"], "coclo"), before, ORIGIN)
    assert other.not_run, "there is no recording to run"
    assert not other.is_as_nominal


def test_a_misspelt_robot_or_mode_is_named_before_anything_runs(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="there is no recording of cat; choose some of --robots daisy, go1"):
        FaultRecording("cat", 1, tmp_path)
    with pytest.raises(SystemExit) as caught:
        command.main(["-o", str(tmp_path), "--modes", "combine"])
    assert "combine" in str(caught.value)
    assert set(MODES) == {"coclo", "vins", "combined", "tight"}
