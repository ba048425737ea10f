# SPDX-License-Identifier: BSD-3-Clause
"""The process that plays a recording: it reads it, and gives each measurement when its stamp says that it is due.

It stands for the drivers of a robot: it does not wait for the estimator, except where the connection is full.
"""

import time
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import dataclass, replace
from itertools import groupby, islice
from multiprocessing.connection import Connection
from operator import itemgetter
from pathlib import Path

from coclo_vio.datasets.dataset import open_dataset
from coclo_vio.datasets.read_ahead import read_ahead
from coclo_vio.fusion.shared_images import SharedFrame, SharedImages
from coclo_vio.runs.faults import Faults
from coclo_vio.runs.plugins import load_plugins
from coclo_vio.runs.run_config import RunConfig
from coclo_vio.values.errors import CocloError
from coclo_vio.values.measurements import Measurement, StereoFrame
from coclo_vio.values.units import NS_PER_S

_SOON_S = 0.3  # from the beginning to the first measurement
_LONGEST_WAIT_S = 5.0  # a stamp further ahead is taken as a clock that was set
_MOST_AT_ONCE = 6  # measurements in a message: fewer than images in the memory
_FULL_FOR_S = 0.001  # how long to wait for a free slot at a time


@dataclass(frozen=True, slots=True)
class Pace:
    """What is played of a recording, and how fast.

    Attributes:
        rate: seconds of recording per second.
        seconds: of recording to play, all rounds together; all of it if None.
        rounds: how often the recording is played, one round after the other.
        pause_s: between two rounds, s.
    """

    rate: float = 1.0
    seconds: float | None = None
    rounds: int = 1
    pause_s: float = 0.5


@dataclass(frozen=True, slots=True)
class Due:
    """Measurements, and when they were due by the system's monotonic clock, in nanoseconds."""

    due_ns: int
    measurements: tuple[Measurement | SharedFrame, ...]


@dataclass(frozen=True, slots=True)
class Ended:
    """No measurement comes any more; the error that ended them, if there was one."""

    error: CocloError | None = None


def serve_recording(
    connection: Connection,
    path: Path,
    config: RunConfig,
    sensors: frozenset[type],
    pace: Pace,
    images: tuple[int, int, int] | None,
) -> None:
    """What the process does; ``images``: size, number of slots and descriptor of the memory for images."""
    memory = None if images is None else SharedImages(*images)
    try:
        load_plugins()
        dataset = open_dataset(path, config.robot, config.dataset)
        faults = Faults(config.faults, config.robot)
        played = limited(in_rounds(lambda: faults.measurements(dataset.measurements, sensors), pace), pace.seconds)
        with closing(read_ahead(played)) as ahead:
            connection.recv()  # the word to begin
            for due_ns, measurements in paced(ahead, pace.rate):
                connection.send(Due(due_ns, tuple(_shared(each, memory, connection) for each in measurements)))
    except CocloError as error:
        connection.send(Ended(error))
        return
    connection.send(Ended())


def _shared(measurement: Measurement, memory: SharedImages | None, connection: Connection) -> Measurement | SharedFrame:
    """The measurement, its images in the memory, once there is room.

    Raises:
        EOFError: the other side is gone.
    """
    if memory is None or not isinstance(measurement, StereoFrame) or not memory.fits(measurement):
        return measurement
    while memory.is_full:
        if connection.poll(_FULL_FOR_S):  # nothing is sent here any more: it is closed
            raise EOFError
    return memory.write(measurement)


def paced(measurements: Iterator[Measurement], rate: float) -> Iterator[tuple[int, tuple[Measurement, ...]]]:
    """The measurements of one time once they are due, a few at once, and when that was by the monotonic clock, ns."""
    for due_ns, group in groupby(_scheduled(measurements, rate), itemgetter(0)):
        while due := tuple(measurement for _, measurement in islice(group, _MOST_AT_ONCE)):
            wait_ns = due_ns - time.monotonic_ns()
            if wait_ns > 0:
                time.sleep(wait_ns / NS_PER_S)
            yield due_ns, due


def _scheduled(measurements: Iterator[Measurement], rate: float) -> Iterator[tuple[int, Measurement]]:
    """Each measurement, and when it is due by the monotonic clock, in nanoseconds.

    A stamp that is more than five seconds ahead does not hold up the others, and one in the past is due at once.
    """
    start_ns: int | None = None
    begin_ns = due_ns = time.monotonic_ns() + round(_SOON_S * NS_PER_S)
    for measurement in measurements:
        if start_ns is None:
            start_ns = measurement.stamp_ns
        planned_ns = begin_ns + round((measurement.stamp_ns - start_ns) / rate)
        if abs(planned_ns - due_ns) > _LONGEST_WAIT_S * NS_PER_S:
            start_ns, begin_ns, planned_ns = measurement.stamp_ns, due_ns, due_ns
        due_ns = max(due_ns, planned_ns)
        yield due_ns, measurement


def in_rounds(read: Callable[[], Iterator[Measurement]], pace: Pace) -> Iterator[Measurement]:
    """The recording played several times: stamps go on after a pause where it ended."""
    shift_ns = last_ns = 0
    for number in range(pace.rounds):
        is_first = True
        for measurement in read():
            if is_first and number:
                shift_ns = last_ns + round(pace.pause_s * NS_PER_S) - measurement.stamp_ns
            is_first = False
            moved = replace(measurement, stamp_ns=measurement.stamp_ns + shift_ns) if shift_ns else measurement
            last_ns = max(last_ns, moved.stamp_ns)
            yield moved


def limited(measurements: Iterator[Measurement], seconds: float | None) -> Iterator[Measurement]:
    """The measurements of the first seconds by their stamps; all of them if None."""
    start_ns: int | None = None
    for measurement in measurements:
        if start_ns is None:
            start_ns = measurement.stamp_ns
        if seconds is not None and measurement.stamp_ns - start_ns > seconds * NS_PER_S:
            return
        yield measurement
