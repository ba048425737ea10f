# SPDX-License-Identifier: BSD-3-Clause
"""Joint samples that were delivered in bursts get the stamps at which they were taken.

A logger that stamps what it receives writes a pause and then several samples within a fraction of a period, as many as
the pause is long: the joints were read at an even rate and waited in a buffer. Taken as they stand, such stamps make a
foot jump by what it moved in the pause, and a pause of 0.1 s ends every foothold. Here the samples of a burst are
spread over the pause before it. Foot forces and IMU samples that share their stamps are of the same rows and move with
them; all other samples keep their own.

Nothing changes where there is no burst: a pause without the samples that it lacks, samples that repeat one another
(held readings) and uneven stamps in general stay as recorded.
"""

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from itertools import pairwise

import numpy as np

from coclo_vio.datasets.sequencer import order_key
from coclo_vio.values.measurements import FootForceSample, ImuSample, JointSample, Measurement
from coclo_vio.values.units import NS_PER_S

_PAUSE = 2.5  # times the median step: a longer one may be followed by a burst
_WITHIN = 0.5  # times the median step: shorter ones belong to the burst
_SHORT = 0.25  # times the median step: so short is the second step of a burst at most
_LEAST_SAMPLES = 3
_SURPLUS = 1.3  # times as many samples as the pause has room for are no burst
_STEPS = 64  # of which the median step is taken
_LEAST_STEPS = 16
_MOST_HELD = 4096


def spread_bursts(measurements: Iterable[Measurement], note: Callable[[str], None]) -> Iterator[Measurement]:
    """The same measurements in time order, joint samples of a burst spread over the pause before it.

    Args:
        measurements: in time order.
        note: called at the end with what was changed, where anything was.
    """
    spreader = _Spreader()
    for measurement in measurements:
        yield from spreader.push(measurement)
    yield from spreader.finish()
    if spreader.bursts:
        note(
            f"{spreader.samples} joint samples came in {spreader.bursts} bursts after a pause, the longest of "
            f"{spreader.longest_ns / NS_PER_S:.2f} s: they were stamped on arrival, and are spread evenly over the "
            "pause (dataset.spreads_bursts=false keeps the stamps)"
        )


class _Spreader:
    """Holds what follows the last joint sample until it is known whether a burst began.

    Attributes:
        bursts: that were spread.
        samples: in them.
        longest_ns: the longest pause before one.
    """

    def __init__(self) -> None:
        self.bursts = self.samples = self.longest_ns = 0
        self._held: list[Measurement] = []
        self._joints: list[JointSample] = []  # of what may be a burst, among those held
        self._last_ns: int | None = None  # of the joints before
        self._steps_ns: deque[int] = deque(maxlen=_STEPS)
        self._period_ns = 0.0
        self._since_median = 0

    def push(self, measurement: Measurement) -> Iterator[Measurement]:
        """Take one measurement; gives those that are ready."""
        self._held.append(measurement)
        if not isinstance(measurement, JointSample):
            if len(self._held) > _MOST_HELD:
                yield from self.finish()
            return
        last = self._joints[-1].stamp_ns if self._joints else self._last_ns
        step_ns = 0 if last is None else measurement.stamp_ns - last
        if self._joints and 0 <= step_ns < _WITHIN * self._period_ns and len(self._held) <= _MOST_HELD:
            self._joints.append(measurement)
            return
        if self._joints:
            self._held.pop()
            newest_ns = self._joints[-1].stamp_ns
            following = [each for each in self._held if each.stamp_ns > newest_ns]  # of the new joint sample's row
            self._held = [each for each in self._held if each.stamp_ns <= newest_ns]
            yield from self.finish()
            self._held = [*following, measurement]
        if self._period_ns and step_ns > _PAUSE * self._period_ns:
            self._joints = [measurement]
            return
        self._learn(step_ns)
        yield from self.finish()
        self._last_ns = measurement.stamp_ns

    def finish(self) -> Iterator[Measurement]:
        """What is still held, spread where it is a burst."""
        held, joints, self._held, self._joints = self._held, self._joints, [], []
        if joints:
            if self._is_burst(joints):
                held = self._spread(held, joints)
            self._last_ns = joints[-1].stamp_ns
        yield from held

    def _learn(self, step_ns: int) -> None:
        if step_ns <= 0:
            return
        self._steps_ns.append(step_ns)
        self._since_median += 1
        if len(self._steps_ns) >= _LEAST_STEPS and self._since_median >= _LEAST_STEPS:
            self._period_ns, self._since_median = float(np.median(self._steps_ns)), 0

    def _is_burst(self, joints: list[JointSample]) -> bool:
        if self._last_ns is None or len(joints) < _LEAST_SAMPLES:
            return False
        room = (joints[-1].stamp_ns - self._last_ns) / self._period_ns
        is_short = joints[1].stamp_ns - joints[0].stamp_ns < _SHORT * self._period_ns
        moves = any(
            not np.array_equal(one.position, other.position, equal_nan=True)
            or not np.array_equal(one.velocity, other.velocity, equal_nan=True)
            for one, other in pairwise(joints)
        )
        return is_short and len(joints) <= _SURPLUS * room + 1.0 and moves

    def _spread(self, held: list[Measurement], joints: list[JointSample]) -> list[Measurement]:
        assert self._last_ns is not None
        newest_ns, count = joints[-1].stamp_ns, len(joints)
        step_ns = min(self._period_ns, (newest_ns - self._last_ns) / count)
        stamps_ns = [newest_ns - round((count - 1 - number) * step_ns) for number in range(count)]
        of_sample = {id(joint): stamp_ns for joint, stamp_ns in zip(joints, stamps_ns, strict=True)}
        of_stamp = {joint.stamp_ns: stamp_ns for joint, stamp_ns in zip(joints, stamps_ns, strict=True)}
        self.bursts, self.samples = self.bursts + 1, self.samples + count
        self.longest_ns = max(self.longest_ns, joints[0].stamp_ns - self._last_ns)
        moved: list[Measurement] = []
        for each in held:
            if isinstance(each, JointSample):
                moved.append(replace(each, stamp_ns=of_sample[id(each)]))
            elif isinstance(each, FootForceSample | ImuSample):
                moved.append(replace(each, stamp_ns=of_stamp.get(each.stamp_ns, each.stamp_ns)))
            else:
                moved.append(each)
        return sorted(moved, key=order_key)
