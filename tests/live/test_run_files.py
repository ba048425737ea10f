# SPDX-License-Identifier: BSD-3-Clause
"""``run.json`` of a run on a wire: while it goes on, where it ends by an error, and where the disk is full."""

import errno
from pathlib import Path

import pytest
from played_source import messages_of, run_played

from coclo_vio.live.wire import WireMessage
from coclo_vio.runs import run_journal
from coclo_vio.runs.observers import Observers
from coclo_vio.runs.recorder import OutputRecorder
from coclo_vio.runs.run_folder import read_estimates, read_record
from coclo_vio.runs.run_record import RunRecord
from coclo_vio.values.outputs import Estimate, Output
from coclo_vio.values.units import NS_PER_S


@pytest.fixture(scope="module")
def messages(short_recording: Path) -> list[WireMessage]:
    """Two seconds of joints and IMU."""
    found = [m for m in messages_of(short_recording) if m.topic in ("/joint_states", "/imu", "/tf_static")]
    return [m for m in found if m.arrived_ns < found[0].arrived_ns + 2 * NS_PER_S]


class _Count:
    """Called with each output; does something at one estimate."""

    def __init__(self, at: int, act: object) -> None:
        self.estimates, self._at, self._act = 0, at, act

    def __call__(self, mode: str, output: Output) -> None:
        self.estimates += isinstance(output, Estimate)
        if self.estimates == self._at:
            self._act()  # type: ignore[operator]


def test_the_record_says_that_it_runs_and_how_far_it_is(
    messages: list[WireMessage], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(run_journal, "_EVERY_S", 0.0)
    seen: list[RunRecord] = []
    watch = _Count(50, lambda: seen.append(RunRecord.read(tmp_path / "run.json")))
    ended, _ = run_played(messages, tmp_path, observers=Observers(watch=watch))
    running = seen[0].estimators["coclo"]
    assert (seen[0].status, running.status) == ("running", "running")
    assert 45 <= running.estimates <= 50
    assert seen[0].recording_ns is not None
    assert (ended.status, ended.estimators["coclo"].status) == ("finished", "finished")
    assert ended.reader is not None
    assert RunRecord.read(tmp_path / "run.json") == ended


def test_an_error_is_in_the_record_and_the_files_hold_what_was_there(
    messages: list[WireMessage], tmp_path: Path
) -> None:
    def fail() -> None:
        raise RuntimeError("something is wrong")

    with pytest.raises(RuntimeError):
        run_played(messages, tmp_path, observers=Observers(watch=_Count(50, fail)))
    record = RunRecord.read(tmp_path / "run.json")
    assert (record.status, record.failure) == ("failed", "RuntimeError: something is wrong")
    assert record.estimators["coclo"].status == "interrupted"
    assert (
        len(read_estimates(tmp_path, "coclo").trajectory) == read_record(tmp_path).estimators["coclo"].estimates == 50
    )


def test_a_full_disk_ends_the_run_as_failed(
    messages: list[WireMessage], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    take, count = OutputRecorder.take, iter(range(1000))

    def full(self: OutputRecorder, output: Output) -> None:
        if next(count) > 60:
            raise OSError(errno.ENOSPC, "No space left on device", "coclo.tum")
        take(self, output)

    monkeypatch.setattr(OutputRecorder, "take", full)
    record, _ = run_played(messages, tmp_path)
    run = record.estimators["coclo"]
    assert (record.status, run.status) == ("failed", "failed")
    assert run.failure is not None
    assert "cannot write coclo.tum: No space left on device" in run.failure
    assert len(read_estimates(tmp_path, "coclo").trajectory) > 50
