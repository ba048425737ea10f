# SPDX-License-Identifier: BSD-3-Clause
"""Naive leg odometry: the baseline that shows what each part of the filter contributes.

Attitude is the integrated gyroscope, velocity the mean of the velocities that the stance legs measure, position its
integral. There is no estimate of the uncertainty: the reported covariance grows with the path only to fill the format.
"""

from collections import Counter
from collections.abc import Mapping

import numpy as np

from coclo_vio.filter.config import FilterConfig
from coclo_vio.geometry import se3, so3
from coclo_vio.robot.leg_sensing import LegSensing, Reading
from coclo_vio.robot.model import RobotModel
from coclo_vio.robot.standstill import StartRule
from coclo_vio.values.arrays import Array
from coclo_vio.values.estimates import FootState, NavState, StateEstimate
from coclo_vio.values.measurements import Measurement
from coclo_vio.values.units import NS_PER_S

_DRIFT_RATIO = 0.1  # of the travelled distance, for the covariance


class NaiveLegOdometry:
    """Mean over the stance feet, attitude from the gyroscope; started from rest like the filter.

    Args:
        robot: the legs.
        config: start and standstill are those of the filter.
        rolls_feet: whether the contact point is at rest rather than the centre of the spherical foot.
        weighs_load: whether a leg counts in proportion to its load.
    """

    def __init__(self, robot: RobotModel, config: FilterConfig, *, rolls_feet: bool, weighs_load: bool) -> None:
        self._counts: Counter[str] = Counter()
        contact = robot.description.contact
        self._sensing = LegSensing(
            robot, contact, config.standstill, force_timeout_s=config.force_timeout_s, rocks_soles=rolls_feet
        )
        self._start_rule = StartRule(config.rest_timeout_s)
        self._radii_m = robot.foot_radii_m * rolls_feet
        self._weighs_load = weighs_load
        self._averages_rest = robot.description.has_flat_feet  # a sway begins slowly, within the last window of rest
        self._rests = 0  # readings of the present standstill
        self._stamp_ns: int | None = None
        self._rotation: Array = np.eye(3)
        self._bias: Array = np.zeros(3)
        self._rate: Array = np.zeros(3)
        self._velocity_world: Array = np.zeros(3)
        self._position: Array = np.zeros(3)
        self._travelled_m = 0.0

    @property
    def counts(self) -> Mapping[str, int]:
        """How often each unusual thing happened."""
        counts = {**self._counts, **self._sensing.counts}
        return {name: count for name, count in sorted(counts.items()) if count}

    def push(self, measurement: Measurement) -> StateEstimate | None:
        """Take one measurement; a joint sample in order gives an estimate after the start."""
        reading = self._sensing.push(measurement, None if self._stamp_ns is None else self._rotation[2])
        if reading is None or not self._has_started(reading):
            return None
        self._advance(reading)
        return self._estimate(reading)

    def _has_started(self, reading: Reading) -> bool:
        rest = self._sensing.rest
        self._rests = 0 if rest is None else self._rests + 1
        if rest is not None:
            earlier = self._rests - 1 if self._averages_rest else 0
            self._bias = (earlier * self._bias + rest.angular_velocity) / (earlier + 1)
        if self._stamp_ns is not None:
            return True
        force = reading.specific_force if rest is None else rest.specific_force
        if not self._start_rule.is_met(reading.stamp_ns, rest) or force is None:
            return False
        self._rotation = so3.from_gravity(force)
        self._stamp_ns = reading.stamp_ns
        return True

    def _advance(self, reading: Reading) -> None:
        assert self._stamp_ns is not None
        dt_s = (reading.stamp_ns - self._stamp_ns) / NS_PER_S
        rate = self._rate if reading.angular_velocity is None else reading.angular_velocity - self._bias
        self._rotation = self._rotation @ so3.exp(0.5 * (self._rate + rate) * dt_s)
        velocity = self._velocity(reading, rate)
        step = 0.5 * (self._velocity_world + velocity) * dt_s
        self._position = self._position + step
        self._travelled_m += float(np.linalg.norm(step))
        self._rate, self._velocity_world, self._stamp_ns = rate, velocity, reading.stamp_ns

    def _velocity(self, reading: Reading, rate: Array) -> Array:
        """World velocity, m/s, (3,): the mean over the stance legs, or the last one where no leg stands."""
        stance = reading.is_stance
        if not stance.any():
            self._counts["no_stance_leg"] += 1
            return self._velocity_world
        feet = reading.feet
        arm = self._radii_m[stance, None] * self._rotation[2]
        turning = np.cross(rate + feet.angular_velocity_body[stance], arm)
        velocity = turning - feet.velocity_body[stance] - np.cross(rate, feet.position_body[stance])
        load = np.nan_to_num(reading.contact.load[stance])
        weights = np.maximum(load, 1e-6) if self._weighs_load else np.ones(len(velocity))
        return np.asarray(self._rotation @ (weights @ velocity / weights.sum()))

    def _estimate(self, reading: Reading) -> StateEstimate:
        nav = NavState(
            se3.transform(self._rotation, self._position), self._velocity_world, self._rate, self._bias, np.zeros(3)
        )
        sigma = 1e-3 + _DRIFT_RATIO * self._travelled_m
        covariance = np.diag(np.repeat((0.05**2, sigma**2, 0.2**2), 3))
        feet_world = self._position + np.nan_to_num(reading.feet.position_body) @ self._rotation.T
        feet = FootState(feet_world, reading.contact.probability, reading.is_stance)
        return StateEstimate(reading.stamp_ns, nav, covariance, feet)
