# SPDX-License-Identifier: BSD-3-Clause
"""Modes for tests: one fails half-way, one keeps the body at rest, one estimates a trajectory it does not declare."""

from collections.abc import Iterator, Mapping

import numpy as np

from coclo_vio.filter.naive import NaiveLegOdometry
from coclo_vio.fusion.leg_odometry import LegOdometry
from coclo_vio.runs.equipment import Equipment
from coclo_vio.runs.modes.mode import Compared, Mode, Need
from coclo_vio.runs.run_config import RunConfig
from coclo_vio.values.errors import FilterError
from coclo_vio.values.estimates import NavState, StateEstimate
from coclo_vio.values.measurements import Measurement, StereoFrame
from coclo_vio.values.outputs import Calibration, Estimate, Estimator, Event, KeyframeHealth, Output, Picture

FAILURE = "no foot is left on the ground; look at the samples before"
FAILS_AT_NS = 1_500_000_000


class FailingFilter:
    """The naive filter until a stamp."""

    def __init__(self, naive: NaiveLegOdometry, fails_at_ns: int) -> None:
        self._naive, self._fails_at_ns = naive, fails_at_ns

    @property
    def counts(self) -> Mapping[str, int]:
        return self._naive.counts

    def push(self, measurement: Measurement) -> StateEstimate | None:
        if measurement.stamp_ns >= self._fails_at_ns:
            raise FilterError(FAILURE)
        return self._naive.push(measurement)


class Resting:
    """Estimates at each frame that the body has not moved; with an event, keyframe, calibration and picture each."""

    def __init__(self, name: str, *, draws: bool) -> None:
        self._name, self._draws = name, draws
        self._frames = 0

    @property
    def counts(self) -> Mapping[str, int]:
        return {"frames": self._frames}

    def push(self, measurement: Measurement) -> Iterator[Output]:
        if not isinstance(measurement, StereoFrame):
            return
        stamp_ns = measurement.stamp_ns
        self._frames += 1
        if self._draws:
            yield Picture(stamp_ns, np.zeros((4, 8, 3), dtype=np.uint8))
        yield Event(stamp_ns, "vision_lost", "it is dark")
        yield KeyframeHealth(stamp_ns, 1, 20, 30, 40, 0.5, 6, 0.007, 8.0)
        yield Calibration(stamp_ns, np.full(3, 0.01), np.full(3, 0.1 / self._frames), 1.02, 0.03)
        nav = NavState(np.eye(4), *(np.zeros(3) for _ in range(4)))
        yield Estimate(self._name, StateEstimate(stamp_ns, nav, np.eye(9)))

    def finish(self) -> Iterator[Output]:
        return iter(())


def _failing(name: str, fails_at_ns: int) -> Mode:
    def make(equipment: Equipment, config: RunConfig) -> Estimator:
        naive = NaiveLegOdometry(equipment.require_robot(), config.filter, rolls_feet=True, weighs_load=False)
        return LegOdometry(name, FailingFilter(naive, fails_at_ns))

    return Mode(name, "fails at a stamp", frozenset({Need.LEGS}), make, compared=Compared.ON_REQUEST)


def _resting(equipment: Equipment, config: RunConfig) -> Estimator:
    assert equipment.robot is None
    equipment.require_cameras()
    return Resting("resting", draws=equipment.pictures_every is not None)


def _undeclared(equipment: Equipment, config: RunConfig) -> Estimator:
    equipment.require_cameras()
    return Resting("elsewhere", draws=False)


FAILING, FAILING_AT_ONCE = _failing("failing", FAILS_AT_NS), _failing("failing_at_once", 0)
RESTING = Mode("resting", "keeps the body at rest", frozenset({Need.CAMERAS}), _resting, compared=Compared.ON_REQUEST)
UNDECLARED = Mode(
    "undeclared", "estimates another trajectory", frozenset({Need.CAMERAS}), _undeclared, compared=Compared.ON_REQUEST
)
STAND_INS = (FAILING, FAILING_AT_ONCE, RESTING, UNDECLARED)
