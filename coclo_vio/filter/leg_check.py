# SPDX-License-Identifier: BSD-3-Clause
"""Each leg against the others and the gyroscope: a leg that contradicts them for long is named and set aside.

The innovation gate sees one sample, and a wrong leg is partly accepted sample by sample. Here residuals of intervals
(``LegIntervals``) are summed with a fading memory: noise averages out, an error of a leg's geometry does not. In the
sum of a leg's residuals ``D``, with the variance ``N`` of noise and the path ``l``,

    z = |D|^2 / (3 (N + (s l)^2)),

``s`` is the share of the way by which good legs differ for long. A zero of an encoder that is off by a few degrees
turns a leg's motion by as much; it is found by a regression on each joint (``JointOffsets``).
"""

from collections import deque
from collections.abc import Sequence

import numpy as np

from coclo_vio.filter.joint_hypotheses import best_hypotheses
from coclo_vio.filter.joint_offsets import JointOffset, JointOffsets
from coclo_vio.filter.leg_check_config import LegCheckConfig
from coclo_vio.filter.leg_consistency import ConsistencyMeter, LegConsistency
from coclo_vio.filter.leg_intervals import IntervalNoise, LegInterval, LegIntervals
from coclo_vio.robot.leg_sensing import Reading
from coclo_vio.robot.model import RobotModel
from coclo_vio.values.arrays import Array, BoolArray, IntArray
from coclo_vio.values.outputs import Event

_KEPT = 10  # intervals of each leg for the hypotheses
_LEAST_VARIANCE = 1e-12  # m^2
_RETURN_LIMIT = 1.0  # z at which a leg is consistent again
_OFFSET_WINDOWS = 4.0  # a leg with an offset is watched so many times longer before it is used again
_MOST_DOUBLINGS = 4  # the stretch doubles each time that a leg is set aside
_DISAGREEMENT = 3.0  # legs disagree without a name for so many times duration_s before that is reported


class LegCheck:
    """Compares legs over intervals, decides which are set aside, and reports it.

    Invariant: at least ``least_legs`` legs are in use.
    """

    def __init__(self, robot: RobotModel, config: LegCheckConfig, noise: IntervalNoise) -> None:
        """Take a robot.

        Args:
            robot: the legs.
            config: limits.
            noise: of what a leg measures over an interval.
        """
        self._robot, self._config = robot, config
        legs = len(robot.leg_names)
        self._intervals = LegIntervals(robot.foot_radii_m, noise, config.interval_s)
        self._offsets = JointOffsets(robot, config)
        self._meter = ConsistencyMeter(legs)
        self._sum, self._variance, self._path_m = np.zeros((legs, 3)), np.zeros(legs), np.zeros(legs)
        self._inconsistent_s, self._consistent_s = np.zeros(legs), np.zeros(legs)
        self._consistent_m = np.zeros(legs)
        self._watch_s, self._times_aside = np.zeros(legs), np.zeros(legs, dtype=np.int64)
        self._offset_s = 0.0
        self._recent: list[deque[LegInterval]] = [deque(maxlen=_KEPT) for _ in range(legs)]
        self._is_disagreement_reported = False
        self._events: list[Event] = []
        self.is_aside: BoolArray = np.zeros(legs, dtype=np.bool_)
        """Legs that are set aside, (n,)."""
        self.any_aside = False

    @property
    def consistency(self) -> LegConsistency:
        """How well the legs in use agree."""
        return self._meter.value

    @property
    def normalised(self) -> Array:
        """Mean squared normalised residual ``z`` of each leg, (n,)."""
        expected = self._variance + (self._config.persistent_share * self._path_m) ** 2 + _LEAST_VARIANCE
        return np.asarray(np.sum(self._sum**2, axis=1) / (3.0 * expected))

    def take_events(self) -> Sequence[Event]:
        """What was reported since the last call."""
        events, self._events = self._events, []
        return events

    def clear(self) -> None:
        """Forget the interval that has begun, as after a gap."""
        self._intervals.clear()

    def push(self, reading: Reading, rotation: Array) -> None:
        """Take a reading and the filter's ``R_world_body``, (3, 3)."""
        interval = self._intervals.push(reading, rotation, self.is_aside)
        if interval is not None:
            self._take(interval)

    def _take(self, interval: LegInterval) -> None:
        compared = interval.is_compared
        if not compared.any():
            return
        kept = np.where(compared & ~self.is_aside, np.exp(-interval.duration_s / self._config.memory_s), 1.0)
        self._sum = kept[:, None] * self._sum + interval.residual
        self._variance = kept**2 * self._variance + interval.variance
        self._path_m = kept * self._path_m + interval.step_m
        for leg in np.flatnonzero(compared):
            self._recent[leg].append(interval)
        self._meter.push(interval, ~self.is_aside)
        self._offsets.push(interval, self._meter.value)
        normalised = self.normalised
        offset = self._offsets.worst(~self.is_aside)
        self._find_inconsistent(interval, normalised, offset)
        if self.any_aside:
            self._find_consistent(interval, normalised)

    def _find_inconsistent(self, interval: LegInterval, normalised: Array, offset: JointOffset | None) -> None:
        config, stamp_ns = self._config, interval.end.stamp_ns
        in_use = np.where(self.is_aside, 0.0, normalised)
        is_over = in_use > config.limit
        self._offset_s = 0.0 if offset is None else self._offset_s + interval.duration_s
        if not is_over.any() and offset is None:
            self._inconsistent_s[:] = 0.0
            self._is_disagreement_reported &= bool(in_use.max() > 0.5 * config.limit)
            return
        self._inconsistent_s = np.where(is_over, self._inconsistent_s + interval.duration_s, 0.0)
        order = np.argsort(in_use)
        worst = int(order[-1])
        if self._inconsistent_s[worst] >= config.duration_s:
            if in_use[worst] > config.least_ratio * in_use[order[-2]] and self._may_set_aside():
                self._set_aside(worst, stamp_ns, self._gross_sentence(worst, normalised[worst]), config.return_s)
            elif (
                self._inconsistent_s[worst] >= _DISAGREEMENT * config.duration_s and not self._is_disagreement_reported
            ):
                self._report_disagreement(stamp_ns, in_use, order)
        elif offset is not None and self._offset_s >= config.duration_s and self._may_set_aside():
            sentence = f"{offset}, and turns the motion that the leg measures by as much"
            self._set_aside(offset.leg, stamp_ns, sentence, _OFFSET_WINDOWS * config.return_s)

    def _may_set_aside(self) -> bool:
        return int(np.count_nonzero(~self.is_aside)) > self._config.least_legs

    def _gross_sentence(self, leg: int, normalised: float) -> str:
        share = float(np.linalg.norm(self._sum[leg]) / max(self._path_m[leg], 1e-6))
        causes = best_hypotheses(self._robot, leg, list(self._recent[leg]))
        cause = " or ".join(str(one) for one in causes) or "no wrong sign or zero of one joint explains it"
        return (
            f"its residual against the other legs is {100.0 * share:.0f} % of the way, {normalised:.0f} times the "
            f"expected square (limit {self._config.limit:g}); {cause}"
        )

    def _set_aside(self, leg: int, stamp_ns: int, sentence: str, watch_s: float) -> None:
        name = self._robot.leg_names[leg]
        action = "the leg is set aside until it agrees again; check its encoders, foot frame and contact"
        self._events.append(Event(stamp_ns, "leg_inconsistent", f"leg {name}: {sentence}; {action}"))
        self.is_aside = self.is_aside.copy()
        self.is_aside[leg] = self.any_aside = True
        self._watch_s[leg] = watch_s * 2.0 ** min(self._times_aside[leg], _MOST_DOUBLINGS)
        self._times_aside[leg] += 1
        self._inconsistent_s[:] = self._offset_s = 0.0
        self._forget(~self.is_aside)  # their residuals were against a wrong leg too
        self._forget(np.arange(len(self.is_aside)) == leg)

    def _forget(self, legs: BoolArray) -> None:
        """Begin the sums of these legs (n,) anew."""
        self._sum[legs], self._variance[legs], self._path_m[legs] = 0.0, 0.0, 0.0
        self._consistent_s[legs], self._consistent_m[legs] = 0.0, 0.0
        self._offsets.forget(legs)

    def _report_disagreement(self, stamp_ns: int, normalised: Array, order: IntArray) -> None:
        names = " and ".join(self._robot.leg_names[leg] for leg in order[:-3:-1])
        self._is_disagreement_reported = True
        self._events.append(
            Event(
                stamp_ns,
                "legs_disagree",
                f"legs {names} contradict each other: {normalised[order[-1]]:.0f} times the expected square (limit "
                f"{self._config.limit:g}); none of them contradicts all others, so both stay in use; check their "
                "encoders, foot frames and contacts",
            )
        )

    def _find_consistent(self, interval: LegInterval, normalised: Array) -> None:
        """A leg that is set aside is watched over stretches of stance; after one in which it agrees it is used."""
        stood = interval.is_compared & self.is_aside
        self._consistent_s += np.where(stood, interval.duration_s, 0.0)
        self._consistent_m += np.where(stood, interval.step_m, 0.0)
        ends = self.is_aside & (self._consistent_s >= self._watch_s)
        ends &= self._consistent_m >= self._config.return_path_m
        returns = ends & (normalised < _RETURN_LIMIT) & ~self._offsets.exceeds
        for leg in np.flatnonzero(returns):
            detail = (
                f"leg {self._robot.leg_names[leg]} agreed with the other legs over {self._consistent_s[leg]:.1f} s of "
                f"stance and {self._consistent_m[leg]:.2f} m: it is used again"
            )
            self._events.append(Event(interval.end.stamp_ns, "leg_consistent", detail))
        if ends.any():
            self._forget(ends)
            self.is_aside = self.is_aside & ~returns
            self.any_aside = bool(self.is_aside.any())
