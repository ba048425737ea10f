# SPDX-License-Identifier: BSD-3-Clause
"""Imu topics that have only rates or only accelerations, as a RealSense publishes its IMU, and their union.

A reading is absent where its covariance begins with -1 (REP 145), where all first messages have exactly zero or NaN,
or by the name of the topic. Accelerations are interpolated linearly to the stamps of the rates.
"""

import re
from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import takewhile

import numpy as np

from coclo_vio.datasets.read_report import ReadTally
from coclo_vio.values.arrays import Array
from coclo_vio.values.units import NS_PER_S

MOST_LOOKED_AT = 5000
"""Messages of a topic that are looked at for a reading other than zero: a robot in a simulator may stand at first."""

_LEAST_ZEROS = 50
_NAMED_HALF = re.compile(r"/(accel|gyro)/(sample|imu_info)")
_LONGEST_NS = NS_PER_S // 5  # between two accelerations; beyond it none is interpolated
_MOST_HELD = 5000  # rates that wait for an acceleration


@dataclass(frozen=True, slots=True)
class ImuHalves:
    """What the messages of an Imu topic have.

    Attributes:
        has_rates: whether there are angular velocities.
        has_accelerations: whether there are linear accelerations.
        why: why one is taken to be absent; empty where both are there.
        remark: what else is odd, as a sentence; empty where nothing is.
    """

    has_rates: bool = True
    has_accelerations: bool = True
    why: str = ""
    remark: str = ""

    @property
    def is_complete(self) -> bool:
        """Whether both are there."""
        return self.has_rates and self.has_accelerations

    @property
    def absent(self) -> str:
        """What is absent, in words."""
        if not self.has_rates and not self.has_accelerations:
            return "neither rates nor accelerations"
        return "no accelerations" if self.has_rates else "no rates"


BOTH = ImuHalves()


@dataclass(slots=True)
class HalfTally:
    """Finds out from its first messages what an Imu topic has."""

    topic: str
    messages: int = 0
    is_turning: bool = False
    is_accelerated: bool = False
    says_no_rate: bool = True
    says_no_acceleration: bool = True

    def add(self, rate: Array, force: Array, rate_variance: float, force_variance: float) -> None:
        """Take a message: its readings (3,) each, and the first element of each covariance."""
        self.messages += 1
        self.is_turning |= bool(np.nan_to_num(rate).any())
        self.is_accelerated |= bool(np.nan_to_num(force).any())
        self.says_no_rate &= rate_variance == -1.0
        self.says_no_acceleration &= force_variance == -1.0

    @property
    def is_settled(self) -> bool:
        """Whether more messages cannot change the result."""
        if _NAMED_HALF.search(self.topic.lower()) or self.messages >= MOST_LOOKED_AT:
            return True
        has_rate, has_force = self.is_turning or self.says_no_rate, self.is_accelerated or self.says_no_acceleration
        return self.messages > 0 and has_rate and has_force

    def halves(self) -> ImuHalves:
        """What the topic has."""
        named = _NAMED_HALF.search(self.topic.lower())
        if named:
            return ImuHalves(named[1] == "gyro", named[1] == "accel", "by its name")
        if self.messages == 0:
            return BOTH
        if self.says_no_rate and self.says_no_acceleration and self.is_turning and self.is_accelerated:
            return ImuHalves(
                remark=f"{self.topic}: both covariances begin with -1, which means no reading (REP 145), but readings "
                "are there and are used"
            )
        if self.says_no_rate or self.says_no_acceleration:
            why = "the covariance begins with -1: no reading (REP 145)"
            return ImuHalves(not self.says_no_rate, not self.says_no_acceleration, why)
        if self.messages < _LEAST_ZEROS or (self.is_turning and self.is_accelerated):
            return BOTH
        return ImuHalves(self.is_turning, self.is_accelerated, f"zero or NaN in the first {self.messages} messages")


def nearest_by_name(topic: str, candidates: Sequence[str]) -> str | None:
    """The candidate whose name shares most parts with ``topic``, from the first on; None without candidates."""

    def rank(other: str) -> tuple[int, str]:
        pairs = zip(topic.split("/"), other.split("/"), strict=False)
        return -sum(1 for _ in takewhile(lambda pair: pair[0] == pair[1], pairs)), other

    return min(candidates, key=rank, default=None)


class ImuUnion:
    """Rates and accelerations of one IMU that come apart; each in time order, in any order between them."""

    def __init__(self, rate_topic: str, tally: ReadTally) -> None:
        self._rate_topic = rate_topic
        self._tally = tally
        self._rates: deque[tuple[int, Array]] = deque()
        self._before: tuple[int, Array] | None = None
        self._after: tuple[int, Array] | None = None

    def add_rate(self, stamp_ns: int, rate: Array) -> Iterator[tuple[int, Array, Array]]:
        """Take a rate; yields stamp, rate and acceleration (3,) each of what is complete."""
        self._rates.append((stamp_ns, rate))
        if len(self._rates) > _MOST_HELD:
            self._drop()
        yield from self._complete()

    def add_acceleration(self, stamp_ns: int, acceleration: Array) -> Iterator[tuple[int, Array, Array]]:
        """Take an acceleration; yields what is complete."""
        self._before, self._after = self._after, (stamp_ns, acceleration)
        yield from self._complete()

    def finish(self) -> None:
        """Count the rates that are left without an acceleration after them."""
        while self._rates:
            self._drop()

    def _complete(self) -> Iterator[tuple[int, Array, Array]]:
        while self._rates and self._after is not None and self._rates[0][0] <= self._after[0]:
            stamp_ns, rate = self._rates[0]
            acceleration = self._at(stamp_ns)
            if acceleration is None:
                self._drop()
                continue
            self._rates.popleft()
            yield stamp_ns, rate, acceleration

    def _at(self, stamp_ns: int) -> Array | None:
        after_ns, after = self._after or (0, np.zeros(3))
        if stamp_ns == after_ns:
            return after
        if self._before is None or not self._before[0] <= stamp_ns or after_ns - self._before[0] > _LONGEST_NS:
            return None
        before_ns, before = self._before
        share = (stamp_ns - before_ns) / (after_ns - before_ns)
        return np.asarray(before + share * (after - before))

    def _drop(self) -> None:
        self._rates.popleft()
        self._tally.dropped[f"{self._rate_topic}: no acceleration before and after this rate"] += 1
