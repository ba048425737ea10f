# SPDX-License-Identifier: BSD-3-Clause
"""A foot that slides: its joints read what they would if it moved over the ground while it carries the robot.

The foot is moved by d(t) in body axes: backwards at the given speed while it is as low as the other feet, and back to
where it should be while it is lifted. The angles are those of the moved foot (Newton's method on the leg's
kinematics), the velocities those that move it so: ``J(q') dq' = J(q) dq + d'``. Torques and foot forces stay.
"""

from collections.abc import Sequence

import numpy as np

from coclo_vio.robot.description import RobotDescription
from coclo_vio.robot.model import RobotModel
from coclo_vio.runs.fault_kinds.fault_form import TimedFault
from coclo_vio.runs.fault_kinds.joint_faults import SLIDING, joints_of_leg, leg_number
from coclo_vio.values.arrays import Array
from coclo_vio.values.errors import ConfigError
from coclo_vio.values.measurements import JointSample
from coclo_vio.values.units import NS_PER_S

_LIFTED_M = 0.015  # above the lowest foot: it is in the air
_RETURNS_PER_S = 20.0  # rate at which a lifted foot comes back
_LONGEST_M = 0.15  # a foot slides at most this far
_ITERATIONS = 3


class SlidingFeet:
    """Feet that slide in some spans of time."""

    def __init__(self, texts: Sequence[str], robot: RobotDescription | None) -> None:
        """Take the faults.

        Args:
            texts: ``LEG:START:SECONDS:MPS`` each.
            robot: whose legs these are.

        Raises:
            ConfigError: a leg that the robot does not have, or no robot.
        """
        faults = SLIDING.parsed(texts)
        self._feet = [
            _SlidingFoot(fault, leg_number("sliding_legs", fault, robot), joints_of_leg("sliding_legs", fault, robot))
            for fault in faults
        ]
        if faults and robot is None:
            raise ConfigError(f"faults.sliding_legs = {faults[0].text!r}: no robot is given; name it with --robot")
        self._model = RobotModel(robot) if faults and robot is not None else None

    def applied(self, sample: JointSample, after_ns: int) -> JointSample:
        """The sample with the feet moved that slide now."""
        if self._model is None:
            return sample
        for foot in self._feet:
            sample = foot.applied(sample, after_ns, self._model)
        return sample


class _SlidingFoot:
    """One foot, its displacement so far, and when it was moved last."""

    def __init__(self, fault: TimedFault, leg: int, joints: tuple[int, ...]) -> None:
        self._fault, self._leg, self._joints = fault, leg, list(joints)
        self._moved_m = np.zeros(3)
        self._last_ns: int | None = None

    def applied(self, sample: JointSample, after_ns: int, model: RobotModel) -> JointSample:
        dt_s = 0.0 if self._last_ns is None else (after_ns - self._last_ns) / NS_PER_S
        self._last_ns = after_ns
        is_on = after_ns in self._fault.span
        if not is_on and not self._moved_m.any():
            return sample
        feet = model.feet(sample.position, sample.velocity)
        heights = feet.position_body[:, 2]
        if np.isnan(heights).any() or np.isnan(sample.velocity).any():
            return sample
        is_lifted = heights[self._leg] > heights.min() + _LIFTED_M
        velocity = -_RETURNS_PER_S * self._moved_m
        if is_on and not is_lifted:
            is_far = np.linalg.norm(self._moved_m) >= _LONGEST_M
            velocity = np.zeros(3) if is_far else np.array([-self._fault.values[0], 0.0, 0.0])
        self._moved_m = self._moved_m + dt_s * velocity
        if not is_on and np.linalg.norm(self._moved_m) < 1e-4:
            self._moved_m = np.zeros(3)
        goal, speed = feet.position_body[self._leg] + self._moved_m, feet.velocity_body[self._leg] + velocity
        return self._reaching(sample, goal, speed, model)

    def _reaching(self, sample: JointSample, goal: Array, speed: Array, model: RobotModel) -> JointSample:
        """The sample with the leg's joints such that its foot is at a place, m, and moves so, m/s, both body frame."""
        position, velocity = np.array(sample.position), np.array(sample.velocity)
        for _ in range(_ITERATIONS):
            feet = model.feet(position, velocity)
            jacobian = feet.jacobian[self._leg, 3:, self._joints].T
            position[self._joints] += np.linalg.lstsq(jacobian, goal - feet.position_body[self._leg], rcond=0.02)[0]
        jacobian = model.feet(position, velocity).jacobian[self._leg, 3:, self._joints].T
        velocity[self._joints] = np.linalg.lstsq(jacobian, speed, rcond=0.02)[0]
        return JointSample(sample.stamp_ns, position, velocity, sample.effort)
