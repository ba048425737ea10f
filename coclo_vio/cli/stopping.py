# SPDX-License-Identifier: BSD-3-Clause
"""SIGINT and SIGTERM: the files are finished, what was done is said, and the status is 130 or 143."""

import signal
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from types import FrameType

import typer

from coclo_vio.cli.terminal import say
from coclo_vio.runs import run_folder
from coclo_vio.runs.stop_request import RunStopped, StopRequest
from coclo_vio.values.errors import DatasetError
from coclo_vio.values.units import NS_PER_S

_SIGNALS = (signal.SIGINT, signal.SIGTERM)
_STATUS_BASE = 128  # of a process that a signal ended, as shells count


@contextmanager
def stoppable(sentences: Callable[[], Iterable[str]]) -> Iterator[StopRequest]:
    """While a command runs: a signal asks its run to stop between two measurements, and interrupts anything else.

    A second signal interrupts at once.

    Args:
        sentences: what was done and how to go on; said after a stop.

    Raises:
        typer.Exit: it was stopped; with status 130 or 143.
    """
    stop = StopRequest()
    number = signal.SIGINT

    def handle(received: int, _frame: FrameType | None) -> None:
        nonlocal number
        is_first, number = not stop.is_requested, signal.Signals(received)
        stop.request()
        if not (is_first and stop.is_polled):
            raise RunStopped

    before: dict[signal.Signals, object] = {}
    with suppress(ValueError):  # only the main thread takes signals
        before = {each: signal.signal(each, handle) for each in _SIGNALS}
    try:
        yield stop
        if stop.is_requested:
            raise RunStopped
    except KeyboardInterrupt:
        for each in before:
            signal.signal(each, signal.SIG_IGN)  # only these lines are left
        say(f"stopped by {number.name}")
        for sentence in sentences():
            say(sentence)
        raise typer.Exit(_STATUS_BASE + number) from None
    finally:
        for each, handler in before.items():
            signal.signal(each, handler)  # type: ignore[arg-type]


def done_so_far(folder: Path, *, can_resume: bool = True) -> Iterator[str]:
    """What stands in a folder of ``run``, ``compare`` or ``play``, and how to go on.

    Args:
        folder: of the results; those of several recordings are in folders inside it.
        can_resume: whether the command has ``--resume``.
    """
    found = [place for place in (folder, *sorted(folder.glob("*/"))) if (place / run_folder.RUN_JSON).is_file()]
    for place in found:
        try:
            record = run_folder.read_record(place)
        except DatasetError as error:
            yield str(error)
            continue
        for mode, run in record.by_mode().items():
            until = ""
            if run.last_ns is not None and record.recording_ns is not None:
                until = f" up to {(run.last_ns - record.recording_ns[0]) / NS_PER_S:.2f} s of the recording"
            yield f"{place}: {mode} {run.status}, {run.estimates} estimates{until}"
    if not found:
        yield f"nothing was written to {folder}"
    else:
        measures = f"coclo-vio evaluate {found[0]} measures what is there"
        yield f"the same command with --resume goes on from here; {measures}" if can_resume else measures
