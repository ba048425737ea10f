# SPDX-License-Identifier: BSD-3-Clause
"""A mode: coclo with its velocity low-pass filtered, for a controller that needs it smooth."""

from collections.abc import Iterator
from dataclasses import replace

import coclo_vio as cv
from coclo_vio.filter.odometry import LegOdometryFilter
from coclo_vio.fusion.streaming import StreamingEstimator

NAME, TIME_CONSTANT_S = "coclo_smooth", 0.1


class SmoothOdometry(StreamingEstimator):
    """COCLO whose velocity passes a low-pass filter of first order."""

    def __init__(self, leg_filter: LegOdometryFilter) -> None:
        super().__init__()
        self._filter, self._last = leg_filter, None

    def _process(self, measurement: cv.Measurement) -> Iterator[cv.Output]:
        state = self._filter.push(measurement)
        if state is None:
            return
        if self._last is not None:
            dt_s = (state.stamp_ns - self._last.stamp_ns) * 1e-9
            before, now = self._last.nav.velocity_world, state.nav.velocity_world
            velocity = before + (now - before) * dt_s / (TIME_CONSTANT_S + dt_s)
            state = replace(state, nav=replace(state.nav, velocity_world=velocity))
        self._last = state
        yield cv.Estimate(NAME, state)


def _make(equipment: object, config: cv.RunConfig) -> SmoothOdometry:
    return SmoothOdometry(LegOdometryFilter(equipment.require_robot(), config.filter))


KIND = cv.TrajectoryKind(NAME, "smooth COCLO", "#117733", standalone="coclo")
SUMMARY = "coclo with its velocity low-pass filtered"
cv.register_mode(cv.Mode(NAME, SUMMARY, frozenset({cv.Need.LEGS}), _make, (KIND,), rank=11))
