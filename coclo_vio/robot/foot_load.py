# SPDX-License-Identifier: BSD-3-Clause
"""The load on each foot, from foot sensors or joint torques: the input of a contact estimator."""

import numpy as np

from coclo_vio.robot.contact import ContactConfig
from coclo_vio.robot.model import RobotModel
from coclo_vio.values.arrays import Array
from coclo_vio.values.errors import RobotModelError
from coclo_vio.values.measurements import FootForceSample, JointSample
from coclo_vio.values.units import GRAVITY_MPS2, NS_PER_S


class FootLoad:
    """Holds the last foot forces, or turns joint torques into forces along the vertical.

    Args:
        robot: the legs.
        config: where the load comes from and which part of the legs' own dynamics is compensated.
        force_timeout_s: foot forces older than this count as missing, s.
    """

    def __init__(self, robot: RobotModel, config: ContactConfig, force_timeout_s: float) -> None:
        self._robot = robot
        self._config = config
        self._timeout_ns = round(force_timeout_s * NS_PER_S)
        self._force: FootForceSample | None = None
        self._joints: JointSample | None = None

    def push(self, sample: FootForceSample) -> bool:
        """Take foot forces; False, and they are refused, where their stamp is not later than the last one's.

        Raises:
            RobotModelError: another number of legs.
        """
        legs = len(self._robot.leg_names)
        if len(sample.force) != legs:
            raise RobotModelError(
                f"a foot force sample has {len(sample.force)} entries, robot {self._robot.description.name!r} has "
                f"{legs} legs; give them in the order of its legs"
            )
        if self._force is not None and sample.stamp_ns <= self._force.stamp_ns:
            return False
        self._force = sample
        return True

    def loads_at(
        self,
        sample: JointSample,
        up_body: Array,
        angular_velocity_body: Array | None,
        jacobian: Array | None = None,
    ) -> Array:
        """Loads at a joint sample, N or counts, (legs,); NaN where unknown.

        Args:
            sample: the joints, newer than those of the last call.
            up_body: upward direction in the body frame, (3,).
            angular_velocity_body: of the body, rad/s, (3,), for the inertia of the legs.
            jacobian: of the feet at the sample, (n, 6, J), where it is known already.
        """
        before, self._joints = self._joints, sample
        if self._config.source == "kinematic":
            return np.full(len(self._robot.leg_names), np.nan)
        if self._config.source == "force_sensor":
            if self._force is None or sample.stamp_ns - self._force.stamp_ns > self._timeout_ns:
                return np.full(len(self._robot.leg_names), np.nan)
            return self._force.force
        acceleration = None
        if self._config.compensation == "inertia" and before is not None:
            acceleration = (sample.velocity - before.velocity) / ((sample.stamp_ns - before.stamp_ns) / NS_PER_S)
        return self._by_torques(sample, up_body, angular_velocity_body, acceleration, jacobian)

    def by_torques(self, sample: JointSample, up_body: Array, jacobian: Array) -> Array:
        """Vertical loads by joint torques and the legs' weight, whatever the source, N, (legs,); NaN without torques.

        Args:
            sample: the joints.
            up_body: upward direction in the body frame, (3,).
            jacobian: of the feet at the sample, (n, 6, J).
        """
        return self._by_torques(sample, up_body, None, None, jacobian)

    def _by_torques(
        self,
        sample: JointSample,
        up_body: Array,
        angular_velocity_body: Array | None,
        acceleration: Array | None,
        jacobian: Array | None,
    ) -> Array:
        forces = self._robot.foot_forces(
            sample.position,
            sample.velocity,
            sample.effort,
            specific_force_body=None if self._config.compensation == "none" else GRAVITY_MPS2 * up_body,
            angular_velocity_body=angular_velocity_body,
            acceleration=acceleration,
            jacobian=jacobian,
        )
        return np.linalg.norm(forces, axis=1) if self._config.method == "paper" else forces @ up_body
