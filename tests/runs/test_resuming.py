# SPDX-License-Identifier: BSD-3-Clause
"""A run that was killed at any moment goes on from its checkpoint, and gives the files of one that was not."""

import json
import shutil
from pathlib import Path

import pytest
import yaml

from coclo_vio.backend import filter_calls
from coclo_vio.online.guarded_estimator import GuardedEstimator
from coclo_vio.runs import checkpoint, run_folder
from coclo_vio.runs.checkpoint import Checkpoints, Position
from coclo_vio.runs.evaluating import evaluate_run
from coclo_vio.runs.observers import Observers
from coclo_vio.runs.run_config import resolve
from coclo_vio.runs.run_folder import Existing
from coclo_vio.runs.run_record import RunRecord
from coclo_vio.runs.running import Ending, run_modes
from coclo_vio.runs.stop_request import StopRequest
from coclo_vio.values.errors import ConfigError, DatasetError
from coclo_vio.values.measurements import Measurement
from coclo_vio.values.outputs import Output

SETTINGS = ["checkpoints.interval_s=0.5", "dataset.reading_threads=0"]
CONFIG = resolve("daisy", settings=SETTINGS)
RESUME = Ending(Existing.RESUME)
NS = 1_000_000_000


def _killed(leg_log: Path, folder: Path, modes: list[str], at: tuple[str, int]) -> Path:
    """Run to the end; the folder as it stood when ``at``, mode and stamp, had been read: what a kill leaves there."""
    left = folder / "killed"

    def progress(name: str, stamp_ns: int) -> None:
        if (name, stamp_ns) == at and not left.exists():
            shutil.copytree(folder / "whole", left)

    run_modes(leg_log, modes, CONFIG, folder / "whole", observers=Observers(progress=progress))
    return left


def _files(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.suffix in {".tum", ".csv", ".yaml"}}


@pytest.mark.long
@pytest.mark.parametrize(
    ("mode", "at_ns", "from_ns"),
    [
        ("naive", 10_000_000, None),
        ("naive", 1_230_000_000, NS),
        ("naive_weighted", 2_990_000_000, 2_500_000_000),
        ("coclo", 490_000_000, None),
        ("coclo", 2_170_000_000, 2 * NS),
        ("coclo_paper", 1_510_000_000, 1_500_000_000),
        ("inekf", 1_700_000_000, 1_500_000_000),
        ("inekf", 2_990_000_000, 2_500_000_000),
    ],
)
def test_a_killed_run_goes_on_and_equals_one_that_was_not(
    mode: str, at_ns: int, from_ns: int | None, leg_log: Path, tmp_path: Path
) -> None:
    left = _killed(leg_log, tmp_path, [mode], (mode, at_ns))
    assert RunRecord.read(left / "run.json").status == "running"
    read: list[int] = []
    observers = Observers(progress=lambda _, stamp_ns: read.append(stamp_ns))
    record = run_modes(leg_log, [mode], CONFIG, left, observers=observers, ending=RESUME)
    run = record.estimators[mode]
    assert (record.status, run.status) == ("finished", "finished")
    assert run.resumed_ns == (() if from_ns is None else (from_ns,))
    assert read[0] >= (from_ns or 0)
    whole = run_folder.read_record(tmp_path / "whole").estimators[mode]
    assert _files(left) == _files(tmp_path / "whole")
    assert (run.events, run.counts, run.measurements) == (whole.events, whole.counts, whole.measurements)
    assert {path.name for path in left.iterdir()} == {path.name for path in (tmp_path / "whole").iterdir()}


def test_an_interrupt_in_compiled_code_is_one_of_the_run(
    leg_log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Numba makes a SystemError of it."""

    def interrupted(*given: object) -> None:
        raise SystemError("returned a result with an exception set") from KeyboardInterrupt()

    with pytest.raises(KeyboardInterrupt):
        run_modes(leg_log, ["naive"], CONFIG, tmp_path, observers=Observers(progress=interrupted))
    record = RunRecord.read(tmp_path / "run.json")
    assert (record.status, record.estimators["naive"].status) == ("interrupted", "interrupted")


class Working:
    """An estimator with work in another thread until it is waited for."""

    def __init__(self) -> None:
        self.works = True
        self.counts: dict[str, int] = {}

    def push(self, measurement: Measurement) -> tuple[Output, ...]:
        return ()

    def finish(self) -> tuple[Output, ...]:
        return ()

    def settle(self) -> None:
        self.works = False


def test_a_checkpoint_waits_for_other_threads_also_behind_the_guard(tmp_path: Path) -> None:
    estimator = GuardedEstimator(Working)
    Checkpoints(tmp_path, "working", estimator).save(Position(1, NS, 0), {})
    read = GuardedEstimator(Working)
    Checkpoints(tmp_path, "working", read).load()
    assert isinstance(read.estimator, Working)
    assert not read.estimator.works


def test_what_a_kill_left_is_evaluated_with_all_but_the_last_moment(leg_log: Path, tmp_path: Path) -> None:
    left = _killed(leg_log, tmp_path, ["coclo"], ("coclo", 2_470_000_000))
    record = run_folder.read_record(left)
    assert record.estimators["coclo"].last_ns is not None
    assert record.estimators["coclo"].last_ns >= 2_300_000_000
    evaluations, failures = evaluate_run(left, CONFIG.evaluation)
    assert (list(evaluations), failures) == (["coclo"], {})
    assert "the run of coclo was killed, or is still going on" in " ".join(evaluations["coclo"].notes)


@pytest.mark.long
def test_modes_that_had_finished_stay_and_the_others_go_on(leg_log: Path, tmp_path: Path) -> None:
    modes = ["naive", "naive_weighted", "naive_rolling"]
    left = _killed(leg_log, tmp_path, modes, ("naive_weighted", 1_040_000_000))
    ran: dict[str, int] = {}
    run_modes(leg_log, modes, CONFIG, left, observers=Observers(progress=ran.setdefault), ending=RESUME)
    assert ran == {"naive_weighted": NS, "naive_rolling": 0}
    assert _files(left) == _files(tmp_path / "whole")
    again: list[str] = []
    observers = Observers(progress=lambda name, _: again.append(name))
    record = run_modes(leg_log, modes, CONFIG, left, observers=observers, ending=RESUME)
    assert (again, record.status) == ([], "finished")


@pytest.mark.long
def test_a_run_that_was_asked_to_stop_goes_on_exactly_there_and_may_stop_again(leg_log: Path, tmp_path: Path) -> None:
    run_modes(leg_log, ["coclo"], CONFIG, tmp_path / "whole")
    record = None
    for until_ns in (700_000_000, 1_900_000_000, 9 * NS):
        stop = StopRequest()

        def progress(_: str, stamp_ns: int, stop: StopRequest = stop, until_ns: int = until_ns) -> None:
            if stamp_ns >= until_ns:
                stop.request()

        ending = Ending(Existing.RESUME, stop)
        observers = Observers(progress=progress)
        record = run_modes(leg_log, ["coclo"], CONFIG, tmp_path / "parts", observers=observers, ending=ending)
    assert record is not None
    assert record.estimators["coclo"].resumed_ns == (700_000_000, 1_900_000_000)
    assert record.status == "finished"
    assert _files(tmp_path / "parts") == _files(tmp_path / "whole")


def test_a_cut_last_line_is_dropped_as_the_run_goes_on(leg_log: Path, tmp_path: Path) -> None:
    left = _killed(leg_log, tmp_path, ["naive"], ("naive", 1_740_000_000))
    for name in ("naive.tum", "naive_state.csv"):
        path = left / name
        path.write_bytes(path.read_bytes()[:-7])
    run_modes(leg_log, ["naive"], CONFIG, left, ending=RESUME)
    assert _files(left) == _files(tmp_path / "whole")


def test_lines_that_were_there_at_the_checkpoint_must_be_there(leg_log: Path, tmp_path: Path) -> None:
    left = _killed(leg_log, tmp_path, ["naive"], ("naive", 1_740_000_000))
    (left / "naive.tum").write_text("", encoding="ascii")
    with pytest.raises(DatasetError, match=r"naive\.tum has lost lines since its run was checkpointed; begin anew"):
        run_modes(leg_log, ["naive"], CONFIG, left, ending=RESUME)


def test_another_configuration_recording_or_version_is_refused_by_name(leg_log: Path, tmp_path: Path) -> None:
    left = _killed(leg_log, tmp_path, ["naive"], ("naive", 1_740_000_000))
    other = resolve("daisy", settings=[*SETTINGS, "filter.max_gap_s=0.07"])
    with pytest.raises(ConfigError, match=r"was configured otherwise \(filter\.max_gap_s\); begin anew with --overwri"):
        run_modes(leg_log, ["naive"], other, left, ending=RESUME)
    shutil.copytree(leg_log, tmp_path / "twin")
    with pytest.raises(DatasetError, match=r"holds a run over .*, not over .*twin; begin anew"):
        run_modes(tmp_path / "twin", ["naive"], CONFIG, left, ending=RESUME)
    values = json.loads((left / "run.json").read_text(encoding="utf-8"))
    (left / "run.json").write_text(json.dumps(values | {"version": "0.0.7"}), encoding="utf-8")
    with pytest.raises(DatasetError, match=r"holds a run of version 0\.0\.7, this is version"):
        run_modes(leg_log, ["naive"], CONFIG, left, ending=RESUME)


@pytest.mark.long
def test_a_checkpoint_of_another_format_or_code_is_refused(
    leg_log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    left = _killed(leg_log, tmp_path, ["naive"], ("naive", 1_740_000_000))
    monkeypatch.setattr(checkpoint, "FORMAT", 99)
    with pytest.raises(
        DatasetError, match=r"naive\.npz was written by another format of checkpoints \(1, this is 99\)"
    ):
        run_modes(leg_log, ["naive"], CONFIG, left, ending=RESUME)
    monkeypatch.setattr(checkpoint, "FORMAT", 1)
    monkeypatch.setattr(checkpoint, "code_digest", lambda: "0123")
    with pytest.raises(DatasetError, match=r"naive\.npz was written by another state of coclo-vio's code \("):
        run_modes(leg_log, ["naive"], CONFIG, left, ending=RESUME)
    (left / "checkpoints" / "naive.npz").write_bytes(b"half")
    with pytest.raises(DatasetError, match=r"naive\.npz cannot be read .*; begin anew with --overwrite"):
        run_modes(leg_log, ["naive"], CONFIG, left, ending=RESUME)


def test_a_recording_that_has_changed_is_a_failure_of_the_mode(leg_log: Path, tmp_path: Path) -> None:
    shutil.copytree(leg_log, tmp_path / "log")
    left = _killed(tmp_path / "log", tmp_path, ["naive"], ("naive", 1_740_000_000))
    log = tmp_path / "log" / "leg_log.csv"
    lines = log.read_text(encoding="ascii").splitlines(keepends=True)
    log.write_text("".join(lines[:20] + lines[21:]), encoding="ascii")
    record = run_modes(tmp_path / "log", ["naive"], CONFIG, left, ending=RESUME)
    assert "the recording has changed; begin anew with --overwrite" in (record.estimators["naive"].failure or "")


def test_resuming_where_there_is_nothing_begins(leg_log: Path, tmp_path: Path) -> None:
    record = run_modes(leg_log, ["naive"], CONFIG, tmp_path / "new", ending=RESUME)
    assert (record.status, record.estimators["naive"].resumed_ns) == ("finished", ())
    assert yaml.safe_load((tmp_path / "new" / "config.yaml").read_text(encoding="utf-8"))["checkpoints"] == {
        "interval_s": 0.5
    }


def test_without_an_interval_there_are_no_checkpoints_and_resuming_begins_anew(leg_log: Path, tmp_path: Path) -> None:
    config = resolve("daisy", settings=["checkpoints.interval_s=0"])
    stop = StopRequest()
    for ending in (Ending(stop=stop), RESUME):
        record = run_modes(
            leg_log,
            ["naive"],
            config,
            tmp_path,
            observers=Observers(progress=lambda _, stamp_ns: stop.request() if stamp_ns > NS else None),
            ending=ending,
        )
        assert not (tmp_path / "checkpoints").exists()
    assert (record.status, record.estimators["naive"].resumed_ns) == ("finished", ())


def test_where_a_checkpoint_has_to_wait_the_one_before_stays(
    leg_log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(filter_calls, "MOST_BYTES", 20_000)
    left = _killed(leg_log, tmp_path, ["inekf"], ("inekf", 2_990_000_000))
    run = run_modes(leg_log, ["inekf"], CONFIG, left, ending=RESUME).estimators["inekf"]
    assert run.resumed_ns == (1_000_000_000,)
    assert _files(left) == _files(tmp_path / "whole")
