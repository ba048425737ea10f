# SPDX-License-Identifier: BSD-3-Clause
"""The legs of a robot: positions, velocities and forces of the feet.

Joint samples go in, foot kinematics and foot forces in the body frame come out, for all legs in one pass: by the
kernels of ``leg_kernels``, or by Pinocchio where these cannot be compiled or a joint is of another kind.
"""

from dataclasses import dataclass

import numpy as np

from coclo_vio.geometry.compiled import IS_COMPILED
from coclo_vio.robot import leg_kernels
from coclo_vio.robot.description import RobotDescription
from coclo_vio.robot.leg_kernels import SINGULAR_M
from coclo_vio.robot.pinocchio_legs import PinocchioLegs, joint_slices
from coclo_vio.robot.sole import soles_of
from coclo_vio.values.arrays import Array


@dataclass(frozen=True, slots=True, eq=False)
class FeetKinematics:
    """The feet at one reading of the joints; rows of a leg with an unknown joint are NaN.

    Attributes:
        position_body: foot centres, m, body frame, (n, 3).
        velocity_body: of the foot centres relative to the body, m/s, body axes, (n, 3).
        angular_velocity_body: of the foot links relative to the body, rad/s, body axes, (n, 3).
        rotation_body_foot: ``R_body_foot``, (n, 3, 3).
        jacobian: (n, 6, J), rows [angular 3, linear 3] in body axes at the foot centre, so that
            ``jacobian @ joint_velocity`` = [angular_velocity_body, velocity_body]; columns of other legs are 0.
    """

    position_body: Array
    velocity_body: Array
    angular_velocity_body: Array
    rotation_body_foot: Array
    jacobian: Array


class RobotModel:
    """Kinematics and dynamics of the legs of a description; joints outside the legs are locked at neutral.

    Not thread-safe: Pinocchio's workspace is reused from call to call.

    Raises:
        RobotModelError: the URDF cannot be read, or lacks a joint or frame that the description names.
    """

    def __init__(self, description: RobotDescription, *, is_compiled: bool = IS_COMPILED) -> None:
        """Read the URDF.

        Args:
            description: of the robot.
            is_compiled: kinematics and forces by ``leg_kernels`` where all joints allow it, not by Pinocchio.
        """
        self.description = description
        self.leg_names = description.leg_names
        self.joint_names = description.joint_names
        self.foot_radii_m: Array = np.array([leg.foot_radius_m for leg in description.legs])
        self.soles = soles_of(description)
        self.leg_joint_slices = joint_slices(description.legs)
        self._legs = PinocchioLegs(description)
        self._chains = self._legs.chains() if is_compiled else None
        self._joints: Array = np.zeros((2, len(self.joint_names)))  # the kernels' input, of one type always
        self.velocity_limits = self._legs.velocity_limits
        self.position_limits = self._legs.position_limits
        self.effort_limits = self._legs.effort_limits
        self.hip_position_body = self._legs.hip_position_body()

    @property
    def mass_kg(self) -> float:
        """Mass of the whole robot, kg."""
        return self._legs.mass_kg

    def centre_of_mass_body(self, position: Array) -> Array:
        """Centre of mass of the whole robot, m, body frame, (3,), at joint positions (J,), rad, all known."""
        return self._legs.centre_of_mass_body(position)

    def feet(self, position: Array, velocity: Array) -> FeetKinematics:
        """Where the feet are and how they move relative to the body.

        Args:
            position: joint positions, rad, (J,) in the order of ``joint_names``; NaN where unknown.
            velocity: joint velocities, rad/s, (J,); NaN where unknown.

        Returns:
            The feet. A joint whose position is NaN makes every row of its leg NaN, one whose velocity is NaN the
            two velocities of its leg.
        """
        return FeetKinematics(*self._kinematics(position, velocity))

    def _kinematics(self, position: Array, velocity: Array) -> tuple[Array, Array, Array, Array, Array]:
        """What ``FeetKinematics`` holds, in its order."""
        if self._chains is not None:
            self._joints[0], self._joints[1] = position, velocity
            return leg_kernels.kinematics(self._joints, self._chains)
        centres, rotations, jacobian = self._legs.kinematics(position)
        rates = jacobian @ np.nan_to_num(velocity, nan=0.0)
        rates[(self._legs.is_own_joint & np.isnan(velocity)).any(axis=1)] = np.nan
        return centres, rates[:, 3:], rates[:, :3], rotations, jacobian

    def foot_forces(
        self,
        position: Array,
        velocity: Array,
        effort: Array,
        *,
        specific_force_body: Array | None = None,
        angular_velocity_body: Array | None = None,
        acceleration: Array | None = None,
        jacobian: Array | None = None,
    ) -> Array:
        """The force that the ground exerts on each foot, N, body frame, (n, 3).

        Solves ``J^T F = h - tau`` for each leg, with h the torques that the leg's own weight and motion need (recursive
        Newton-Euler, and the joint friction of the URDF's ``<dynamics>``) and J the linear Jacobian of the foot centre:
        the paper's eq. (7), ``F = R J^-T tau``, with the sign of the ground's force on the foot, in the body frame, and
        with h, which the paper omits. A leg of other than three joints is solved by least squares, of smallest
        norm where joints are too few: forces that its torques do not determine are zero. A direction in which the
        singular value s of J is below 0.02 m (a stretched leg) is damped, ``1/s -> s / (s^2 + d^2)`` with
        ``d^2 = 0.02^2 - s^2``: its force tends to zero instead of infinity.

        Args:
            position: joint positions, rad, (J,).
            velocity: joint velocities, rad/s, (J,); used only where ``acceleration`` is given.
            effort: torque of the motors on the joints, Nm, (J,).
            specific_force_body: of the body origin, m/s^2, body frame, (3,): 9.81 times "up" compensates gravity, an
                accelerometer's reading the body's acceleration too. None: the legs are taken as massless.
            angular_velocity_body: of the body, rad/s, body frame, (3,); used only where ``acceleration`` is given.
            acceleration: joint accelerations, rad/s^2, (J,): compensates inertia and joint friction. None: the legs
                are taken at rest.
            jacobian: that of ``feet`` at these positions, (n, 6, J), where it is known already.

        Returns:
            Forces; a leg with any NaN among its own readings has NaN.
        """
        if jacobian is None:
            jacobian = self._kinematics(position, velocity)[-1]
        torque = -effort
        if specific_force_body is not None or acceleration is not None:
            torque = torque + self._legs.own_torques(
                position, velocity, specific_force_body, angular_velocity_body, acceleration
            )
        if self._chains is not None:
            return leg_kernels.damped_forces(jacobian, torque, self._chains)
        is_unknown = (self._legs.is_own_joint & np.isnan(torque)).any(axis=1) | np.isnan(jacobian[:, 0, 0])
        torque = np.nan_to_num(torque, copy=False, nan=0.0)
        forces = damped_forces(np.where(is_unknown[:, None, None], 0.0, jacobian[:, 3:]), torque)
        forces[is_unknown] = np.nan
        return forces

    def holding_torques(self, position: Array, foot_force_body: Array, specific_force_body: Array) -> Array:
        """The torques with which the motors hold the legs still while the ground pushes on the feet, Nm, (J,).

        ``tau = h - J^T F``: what ``foot_forces`` solves for F.

        Args:
            position: joint positions, rad, (J,), all known.
            foot_force_body: of the ground on each foot, N, body frame, (n, 3).
            specific_force_body: of the body origin, m/s^2, body frame, (3,): 9.81 times "up" at rest.
        """
        zero = np.zeros(len(position))
        jacobian = self._kinematics(position, zero)[-1]
        own = self._legs.own_torques(position, zero, specific_force_body, None, None)
        return np.asarray(own - np.einsum("nij,ni->j", jacobian[:, 3:], foot_force_body))


def damped_forces(jacobian: Array, torque: Array) -> Array:
    """Foot forces (n, 3) that solve ``J^T F = torque`` (J,), of linear Jacobians (n, 3, J), as ``foot_forces`` does."""
    squared, axes = np.linalg.eigh(jacobian @ np.swapaxes(jacobian, 1, 2))
    projected = np.swapaxes(axes, 1, 2) @ (jacobian @ torque)[:, :, None]
    return np.asarray((axes @ (projected / np.maximum(squared, SINGULAR_M**2)[:, :, None]))[:, :, 0])
