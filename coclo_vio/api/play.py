# SPDX-License-Identifier: BSD-3-Clause
"""A recording played to an estimator by its stamps, as drivers would push it: what comes out, and how late."""

import tempfile
from contextlib import ExitStack, closing, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from coclo_vio.api.recording import Recording, open_recording
from coclo_vio.api.run import Run, existing_of
from coclo_vio.runs.latency import LatencyRecord
from coclo_vio.runs.modes.registry import mode_of
from coclo_vio.runs.observers import Observers, Progress
from coclo_vio.runs.paced_feed import PacedFeed
from coclo_vio.runs.paced_play import paced_feed, play_mode
from coclo_vio.runs.run_folder import Existing
from coclo_vio.runs.running import Ending
from coclo_vio.values.outputs import Output
from coclo_vio.views.view import View


class OutputSink(Protocol):
    """What gets the outputs while a recording is played: a viewer, a publisher."""

    def take(self, output: Output) -> None:
        """Take one output; the next measurement waits until this returns."""

    def close(self) -> None:
        """No output comes any more."""


@dataclass(frozen=True, slots=True, eq=False)
class Play:
    """A recording that was played.

    Attributes:
        run: its trajectories, events and metrics.
        latency: its times, as in ``latency.json`` of the run folder.
    """

    run: Run
    latency: LatencyRecord


def play(
    recording: Recording | str | Path,
    mode: str | None = None,
    *,
    rate: float | PacedFeed = 1.0,
    seconds: float | None = None,
    folder: str | Path | None = None,
    sink: OutputSink | View | None = None,
    progress: Progress | None = None,
    existing: Existing | Ending | str = Existing.REFUSE,
) -> Play:
    """Play a recording to one mode from another process, each measurement when its stamp is due.

    Frames of ``combined`` are processed beside the filter unless ``bridge.vision`` says otherwise.

    Args:
        recording: what ``open`` gives, or a path.
        mode: its name; the best that the recording is enough for if None.
        rate: seconds of recording per second; or what plays it, made of rate and seconds.
        seconds: of the recording to play; all of it if None.
        folder: run folder; a temporary one if None.
        sink: gets each output as it comes out, and is closed at the end; a view gets measurements too.
        progress: called with the mode and the stamp (ns) of each measurement.
        existing: what becomes of results in the folder: ``refuse`` or ``overwrite``; or an ``Ending``, which may stop
            it. A play cannot be resumed.

    Raises:
        ConfigError: there is no such mode, the rate is not positive, or it is to be resumed.
        CocloError: the folder holds results and ``existing`` refuses them, the recording or the robot is at fault, or
            the mode lacks what it needs.
    """
    if not isinstance(recording, Recording):
        recording = open_recording(recording)
    name = mode_of(recording.default_mode if mode is None else mode).name
    feed = rate if isinstance(rate, PacedFeed) else paced_feed(rate, seconds)
    ending = existing if isinstance(existing, Ending) else Ending(existing_of(existing))
    with ExitStack() as stack:
        target = Path(folder or stack.enter_context(tempfile.TemporaryDirectory(prefix="coclo_vio_")))
        view = sink if isinstance(sink, View) else None
        watch = None if sink is None or view is not None else lambda _, output: sink.take(output)
        with nullcontext() if sink is None else closing(sink):
            record, latency = play_mode(
                recording.path,
                name,
                recording.config,
                target,
                feed,
                observers=Observers(progress, watch, view),
                ending=ending,
            )
        return Play(Run(target, record, remove=stack.pop_all().close), latency)
