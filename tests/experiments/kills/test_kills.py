# SPDX-License-Identifier: BSD-3-Clause
"""What an ended command left, and what counts as a fault of it."""

import json
import shutil
import signal
from pathlib import Path
from typing import Any

import pytest

from coclo_vio.experiments.kills import __main__ as command
from coclo_vio.experiments.kills import kill_cases
from coclo_vio.experiments.kills.ended_table import compared_tables, jobs_of, left_of_table
from coclo_vio.experiments.kills.kill_cases import Case, all_cases, write_cut, write_walks
from coclo_vio.experiments.kills.kill_record import Kill, KillsRecord
from coclo_vio.experiments.kills.kill_text import HEAD, amiss_lines, rows, summary_sentence
from coclo_vio.experiments.kills.what_is_left import compared, left_of
from coclo_vio.experiments.table.plan import TablePlan
from coclo_vio.experiments.table.recordings import Recordings
from coclo_vio.runs import run_folder
from coclo_vio.runs.evaluating import evaluate_run
from coclo_vio.runs.run_config import resolve
from coclo_vio.runs.run_folder import read_estimates
from coclo_vio.runs.run_record import RunRecord
from coclo_vio.runs.running import run_modes
from coclo_vio.simulation.body_motion import BodyMotionConfig

MS = 1_000_000


def kill(**changes: Any) -> Kill:
    values: dict[str, Any] = {
        "command": "run",
        "modes": "coclo",
        "signal": "SIGKILL",
        "at_share": 0.5,
        "status": -9,
        "is_status_right": True,
        "lost_s": 0.2,
        "left": "evaluated",
        "reason": "",
        "resumed_status": 0,
        "resumed_from_s": {"coclo": (3.0,)},
        "difference": 1e-12,
        "has_same_events": True,
    }
    return Kill(**(values | changes))


@pytest.mark.parametrize(
    ("changes", "is_passed"),
    [
        ({}, True),
        ({"left": "no estimate yet", "lost_s": 0.0}, True),
        ({"left": "too short"}, True),
        ({"command": "table", "lost_s": None}, True),
        ({"left": "failed"}, False),
        ({"lost_s": 1.2}, False),
        ({"is_status_right": False}, False),
        ({"resumed_status": 1}, False),
        ({"difference": 1e-8}, False),
        ({"difference": None}, False),
        ({"has_same_events": False}, False),
    ],
)
def test_what_passes(changes: dict[str, Any], is_passed: bool) -> None:
    assert kill(**changes).is_passed is is_passed


def test_the_table_counts_each_kind_by_command_and_names_what_is_amiss() -> None:
    kills = [
        kill(),
        kill(left="no estimate yet", signal="SIGTERM", lost_s=0.0),
        kill(command="table", modes="naive,coclo", lost_s=None, left="failed", reason="no JSON", difference=None),
    ]
    record = KillsRecord.of(kills)
    run, table, total = rows(record)
    assert len(run) == len(HEAD)
    assert run == ("`run` coclo", "2", "2", "1", "0", "1", "0", "0.20", "2", "2", "1e-12")
    assert table == ("`table` naive, coclo", "1", "1", "0", "0", "0", "1", "-", "1", "0", "-")
    assert total[1:3] == ("3", "3")
    assert summary_sentence(record) == "3 kills (2 by SIGKILL, 1 by SIGTERM), 2 of them without fault."
    assert list(amiss_lines(record)) == [
        "* `table` naive,coclo, SIGKILL at 50 %: failed (no JSON); other lengths or words"
    ]


@pytest.fixture(scope="module")
def whole(leg_log: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run that was not ended."""
    folder = tmp_path_factory.mktemp("whole")
    run_modes(leg_log, ["naive"], resolve("daisy"), folder)
    return folder


def _ended(whole: Path, to: Path, poses: int) -> Path:
    """A folder as a kill leaves it after so many poses."""
    shutil.copytree(whole, to)
    for name, head in (("naive.tum", 0), ("naive_state.csv", 1)):
        lines = (to / name).read_text(encoding="ascii").splitlines(keepends=True)
        (to / name).write_text("".join(lines[: poses + head]), encoding="ascii")
    values = json.loads((to / "run.json").read_text(encoding="utf-8"))
    values["estimators"]["naive"] |= {"status": "running", "estimates": poses}
    (to / "run.json").write_text(json.dumps(values | {"status": "running"}), encoding="utf-8")
    return to


@pytest.mark.parametrize(
    ("poses", "after", "left", "lost_s"),
    [
        (200, 10, "evaluated", 0.1),
        (200, 60, "evaluated", 0.6),
        (1, 1, "too short", 0.01),
        (0, 5, "no estimate yet", 0.04),
        (0, 130, "failed", 1.29),
    ],
)
def test_what_is_left_is_measured_against_the_whole_run(
    poses: int, after: int, left: str, lost_s: float, whole: Path, tmp_path: Path
) -> None:
    """``after`` poses of the whole run follow up to the newest measurement that was read."""
    stamps_ns = read_estimates(whole, "naive").trajectory.stamps_ns
    found = left_of(_ended(whole, tmp_path / "left", poses), whole, "naive", int(stamps_ns[poses + after - 1]) + MS)
    assert (found.left, found.lost_s) == (left, pytest.approx(lost_s, abs=1e-9))


def test_a_folder_that_evaluate_cannot_read_has_failed(whole: Path, tmp_path: Path) -> None:
    folder = _ended(whole, tmp_path / "left", 100)
    path = folder / "naive.tum"
    lines = path.read_text(encoding="ascii").splitlines(keepends=True)
    path.write_text("".join([*lines[:50], "damage\n", *lines[50:]]), encoding="ascii")
    stamps_ns = read_estimates(whole, "naive").trajectory.stamps_ns
    assert left_of(folder, whole, "naive", int(stamps_ns[100])).left == "failed"
    (folder / "run.json").unlink()
    assert left_of(folder, whole, "naive", 0).left == "failed"


def test_resumed_files_are_compared_number_by_number(whole: Path, tmp_path: Path) -> None:
    shutil.copytree(whole, tmp_path / "same")
    assert compared(whole, tmp_path / "same").difference == 0.0
    path = tmp_path / "same" / "naive.tum"
    fields = path.read_text(encoding="ascii").splitlines()
    words = fields[-1].split()
    fields[-1] = " ".join([words[0], str(float(words[1]) + 0.25), *words[2:]])
    path.write_text("\n".join(fields) + "\n", encoding="ascii")
    assert compared(whole, tmp_path / "same").difference == pytest.approx(0.25)
    path.write_text("\n".join(fields[:-1]) + "\n", encoding="ascii")
    assert compared(whole, tmp_path / "same").difference is None
    record = RunRecord.read(tmp_path / "same" / "run.json")
    run = record.estimators["naive"].model_copy(update={"counts": {"gap": 7}})
    run_folder.write_record(tmp_path / "same", record.model_copy(update={"estimators": {"naive": run}}))
    assert not compared(whole, tmp_path / "same").has_same_events


def _table(folder: Path, drift: float, cpu_s: float = 1.0) -> Path:
    run = folder / "runs" / "flat_1" / "naive"
    run.mkdir(parents=True)
    (run / "naive.tum").write_text("0.0 0 0 0 0 0 0 1\n", encoding="ascii")
    (folder / "jobs").mkdir()
    (folder / "jobs" / "flat_1_naive.json").write_text("{}", encoding="utf-8")
    values = {"jobs": [{"cpu_s": cpu_s, "drift": drift, "name": "flat"}], "version": "1"}
    (folder / "table.json").write_text(json.dumps(values), encoding="utf-8")
    return folder


def test_tables_are_compared_without_times(tmp_path: Path) -> None:
    one, other = _table(tmp_path / "one", 0.5), _table(tmp_path / "other", 0.5, cpu_s=9.0)
    found = compared_tables(one, other, jobs_of(other))
    assert (found.difference, found.has_same_events) == (0.0, True)
    changed = _table(tmp_path / "changed", 0.75)
    assert compared_tables(one, changed, {}).difference == pytest.approx(0.25)
    assert not compared_tables(one, other, {"flat_2_naive.json": b"{}"}).has_same_events  # a finished job was lost
    (other / "runs" / "flat_1" / "naive" / "naive.tum").unlink()
    assert not compared_tables(one, other, {}).has_same_events


def test_a_table_without_a_job_has_no_estimate_yet_and_half_a_job_is_a_failure(tmp_path: Path) -> None:
    assert left_of_table(tmp_path).left == "no estimate yet"
    folder = _table(tmp_path / "one", 0.5)
    assert left_of_table(folder).left == "failed"


def test_the_recordings_are_written_once_and_fit_their_commands(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(kill_cases, "WALK", BodyMotionConfig(rest_s=0.1, walk_s=0.4, stop_s=0.1, ramp_s=0.1))
    cut = write_cut(tmp_path / "cut.mcap", 0.3)
    written = cut.stat().st_mtime_ns
    assert write_cut(cut, 0.3).stat().st_mtime_ns == written
    walks = write_walks(tmp_path / "walks")
    plan = TablePlan(seeds=2, first_seed=11, trials=("flat",), modes=("naive",), policy_seeds=0)
    recordings = Recordings(walks, plan)
    recordings.check()
    assert all(recordings.is_there("flat", seed) for seed in (11, 12))


def test_all_commands_are_in_one_session_and_a_table_goes_on_by_itself(tmp_path: Path) -> None:
    cases = all_cases(tmp_path, 3.0, "coclo,naive", "", "")
    assert [case.name for case in cases] == ["run_coclo", "run_naive", "compare_coclo_naive"]
    assert "checkpoints.interval_s=3.0" in cases[0].arguments(tmp_path)
    assert cases[0].resuming(tmp_path)[-1] == "--resume"
    table = Case("table", "naive", ("--seeds", "2"))
    assert table.resuming(tmp_path) == table.arguments(tmp_path)


@pytest.mark.long
def test_a_killed_run_in_another_process_is_resumed_and_compared(leg_log: Path, tmp_path: Path) -> None:
    more = (str(leg_log), "--robot", "daisy", "--set", "checkpoints.interval_s=0.5")
    config = resolve("daisy", settings=["checkpoints.interval_s=0.5"])
    run_modes(leg_log, ["naive"], config, tmp_path / "whole_run_naive")
    killer = command.Killer(tmp_path, {"run_naive": 1.0})
    found = killer.kill(Case("run", "naive", more), signal.SIGKILL, 0.6)
    assert (found.status, found.left, found.resumed_status) == (-9, "evaluated", 0)
    assert found.is_passed
    assert found.resumed_from_s["naive"]
    assert evaluate_run(tmp_path / "killed", resolve("daisy").evaluation)[1] == {}
