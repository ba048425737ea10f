# SPDX-License-Identifier: BSD-3-Clause
"""A command in another process, which shows how far it has read, and is ended there by a signal."""

import mmap
import os
import signal
import struct
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

from coclo_vio.runs.mode_run import ModeRun

EXPECTED = {signal.SIGKILL: -signal.SIGKILL, signal.SIGTERM: 143, signal.SIGINT: 130}
"""The status of a process by the signal that ended it."""
_START_S, _END_S, _POLL_S = 300.0, 3600.0, 0.002
_BEGIN_S = 0.5  # from the folder of the jobs to the first of them
_STAMP = struct.Struct("<q")
_CHILD = (
    "from coclo_vio.experiments.kills.ended_process import show_position; show_position(); "
    "from coclo_vio.cli import main; main()"
)
_STAMP_FILE = "COCLO_VIO_STAMP_FILE"


class EndedProcess:
    """``coclo-vio`` in another process; its output goes to a file beside ``stamp_file``."""

    def __init__(self, arguments: Sequence[str], stamp_file: Path) -> None:
        """Start it."""
        self._stamp_file = stamp_file
        stamp_file.write_bytes(_STAMP.pack(0) * 2)
        environment = {**os.environ, _STAMP_FILE: str(stamp_file)}
        command = [sys.executable, "-c", _CHILD, *arguments]
        with stamp_file.with_suffix(".log").open("wb") as log:
            self._process = subprocess.Popen(command, env=environment, stdout=log, stderr=subprocess.STDOUT)

    def end_at(self, modes: int, stamp_ns: int, sent: signal.Signals) -> tuple[int | None, int]:
        """End it when it has finished so many modes and read up to a stamp.

        Returns:
            Its status, None where it had come to its end before; and the stamp it had read.
        """
        until_s = time.monotonic() + _START_S
        read_ns = 0
        while self._process.poll() is None and time.monotonic() < until_s:
            finished, read_ns = (value for (value,) in _STAMP.iter_unpack(self._stamp_file.read_bytes()))
            if finished > modes or (finished == modes and read_ns >= stamp_ns):
                break
            time.sleep(_POLL_S)
        return self._ended(sent), read_ns

    def end_after(self, jobs: int, seconds: float, folder: Path, sent: signal.Signals) -> int | None:
        """End it so long after a folder has so many files; its status, None where it had come to its end before."""
        until_s = time.monotonic() + _START_S
        while self._process.poll() is None and time.monotonic() < until_s:
            if folder.is_dir() and len(list(folder.glob("*.json"))) >= jobs:
                break
            time.sleep(_POLL_S)
        until_s = time.monotonic() + _BEGIN_S + seconds
        while self._process.poll() is None and time.monotonic() < until_s:
            time.sleep(_POLL_S)
        return self._ended(sent)

    def _ended(self, sent: signal.Signals) -> int | None:
        if self._process.poll() is not None:
            return None
        self._process.send_signal(sent)
        return self.status() or None  # status 0: it came to its end just before

    def status(self) -> int:
        """Wait for its end; its status."""
        return self._process.wait(_END_S)


def finished(arguments: Sequence[str], stamp_file: Path) -> int:
    """Run a command to its end; its status."""
    return EndedProcess(arguments, stamp_file).status()


def show_position() -> None:
    """From now on runs in this process write how many modes they have finished, and which stamp they have read."""
    path = Path(os.environ[_STAMP_FILE])
    with path.open("r+b") as file:
        shared = mmap.mmap(file.fileno(), 2 * _STAMP.size)
    advance, run = ModeRun._advance, ModeRun.run

    def advanced(self: ModeRun, stamp_ns: int) -> None:
        shared[_STAMP.size :] = _STAMP.pack(stamp_ns)
        advance(self, stamp_ns)

    def ran(self: ModeRun, *given: object) -> None:
        run(self, *given)  # type: ignore[arg-type]
        shared[:] = _STAMP.pack(_STAMP.unpack(shared[: _STAMP.size])[0] + 1) + _STAMP.pack(0)

    ModeRun._advance, ModeRun.run = advanced, ran  # type: ignore[assignment,method-assign]
