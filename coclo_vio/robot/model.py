# SPDX-License-Identifier: BSD-3-Clause
"""The legs of a robot: positions, velocities and forces of the feet. The only importer of Pinocchio in this room.

Joint samples go in, foot kinematics and foot forces in the body frame come out, for all legs in one pass.
"""

from dataclasses import dataclass
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin

from coclo_vio.geometry import so3
from coclo_vio.robot.description import LegDescription, RobotDescription, urdf_path
from coclo_vio.values.arrays import Array, BoolArray
from coclo_vio.values.errors import RobotModelError, listing

_BASE = 6  # the free base comes first in every Pinocchio vector, with six velocities
_ROOT_JOINT = 1
_STICTION_RADPS = 0.1  # dry friction grows to its full value over about this joint speed
_SINGULAR = 0.02  # singular value (m for revolute joints) of a foot Jacobian below which a direction is damped


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

    def __init__(self, description: RobotDescription) -> None:
        self.description = description
        self.leg_names = description.leg_names
        self.joint_names = description.joint_names
        self.foot_radii_m: Array = np.array([leg.foot_radius_m for leg in description.legs])
        self.leg_joint_slices = _slices(description.legs)
        self._model = _legs_only(_read_urdf(description), description)
        self._model.gravity.linear = np.zeros(3)  # gravity enters through the specific force of the base
        self._data = self._model.createData()
        T_body_root = _body_to_root(self._model, self._data, description)
        self._T_root_body = T_body_root.inverse()
        joints = [self._model.joints[self._model.getJointId(name)] for name in self.joint_names]
        self._q_index = np.array([joint.idx_q for joint in joints])
        self._v_index = np.array([joint.idx_v for joint in joints])
        self._damping: Array = np.array(self._model.damping)[self._v_index]
        self._dry_friction: Array = np.array(self._model.upperDryFrictionLimit)[self._v_index]
        self.velocity_limits: Array = np.array(self._model.velocityLimit)[self._v_index]
        self._q = pin.neutral(self._model)
        self._q[:7] = pin.SE3ToXYZQUAT(T_body_root)
        pin.forwardKinematics(self._model, self._data, self._q)
        first_joints = [self._model.getJointId(leg.joints[0]) for leg in description.legs]
        self.hip_position_body: Array = np.array([self._data.oMi[joint].translation for joint in first_joints])
        self._frames = [_frame_id(self._model, leg.foot_frame, description) for leg in description.legs]
        self._is_own_joint: BoolArray = np.zeros((len(self.leg_names), len(self.joint_names)), dtype=np.bool_)
        for row, joints_of_leg in enumerate(self.leg_joint_slices):
            self._is_own_joint[row, joints_of_leg] = True
        self._check_chains()

    @property
    def mass_kg(self) -> float:
        """Mass of the whole robot, kg."""
        return float(sum(inertia.mass for inertia in self._model.inertias))

    def centre_of_mass_body(self, position: Array) -> Array:
        """Centre of mass of the whole robot, m, body frame, (3,), at joint positions (J,), rad, all known."""
        self._q[self._q_index] = position
        return np.array(pin.centerOfMass(self._model, self._data, self._q))

    def feet(self, position: Array, velocity: Array) -> FeetKinematics:
        """Where the feet are and how they move relative to the body.

        Args:
            position: joint positions, rad, (J,) in the order of ``joint_names``; NaN where unknown.
            velocity: joint velocities, rad/s, (J,); NaN where unknown.

        Returns:
            The feet. A joint whose position is NaN makes every row of its leg NaN, one whose velocity is NaN the
            two velocities of its leg.
        """
        centres, rotations, jacobian = self._kinematics(position)
        unknown = np.isnan(velocity)
        is_incomplete = bool(unknown.any())
        rates = jacobian @ (np.where(unknown, 0.0, velocity) if is_incomplete else velocity)
        if is_incomplete:
            rates[(self._is_own_joint & unknown).any(axis=1)] = np.nan
        return FeetKinematics(centres, rates[:, 3:], rates[:, :3], rotations, jacobian)

    def foot_forces(
        self,
        position: Array,
        velocity: Array,
        effort: Array,
        *,
        specific_force_body: Array | None = None,
        angular_velocity_body: Array | None = None,
        acceleration: Array | None = None,
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

        Returns:
            Forces; a leg with any NaN among its own readings has NaN.
        """
        _, _, jacobian = self._kinematics(position)
        torque = -effort
        if specific_force_body is not None or acceleration is not None:
            torque = torque + self._own_torques(velocity, specific_force_body, angular_velocity_body, acceleration)
        is_unknown = (self._is_own_joint & np.isnan(torque)).any(axis=1) | np.isnan(jacobian[:, 0, 0])
        torque = np.nan_to_num(torque, copy=False, nan=0.0)
        linear = np.where(is_unknown[:, None, None], 0.0, jacobian[:, 3:])
        squared, axes = np.linalg.eigh(linear @ np.swapaxes(linear, 1, 2))
        projected = np.swapaxes(axes, 1, 2) @ (linear @ torque)[:, :, None]
        forces: Array = (axes @ (projected / np.maximum(squared, _SINGULAR**2)[:, :, None]))[:, :, 0]
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
        _, _, jacobian = self._kinematics(position)
        own = self._own_torques(np.zeros(len(position)), specific_force_body, None, None)
        return np.asarray(own - np.einsum("nij,ni->j", jacobian[:, 3:], foot_force_body))

    def _kinematics(self, position: Array) -> tuple[Array, Array, Array]:
        """Foot centres (n, 3), rotations (n, 3, 3) and Jacobians (n, 6, J); sets the configuration ``_q``."""
        unknown = np.isnan(position)
        is_incomplete = bool(unknown.any())
        self._q[self._q_index] = np.where(unknown, 0.0, position) if is_incomplete else position
        model, data = self._model, self._data
        pin.computeJointJacobians(model, data, self._q)
        placements = [pin.updateFramePlacement(model, data, frame) for frame in self._frames]
        centres: Array = np.array([placement.translation for placement in placements])
        rotations: Array = np.array([placement.rotation for placement in placements])
        columns = data.J[:, self._v_index]  # [linear at the body origin, angular] in body axes
        jacobian = np.empty((len(placements), 6, len(self._v_index)))
        jacobian[:, :3] = columns[3:]
        jacobian[:, 3:] = columns[:3] - so3.hat(centres) @ columns[3:]
        jacobian *= self._is_own_joint[:, None, :]
        if is_incomplete:
            legs = (self._is_own_joint & unknown).any(axis=1)
            centres[legs], rotations[legs], jacobian[legs] = np.nan, np.nan, np.nan
        return centres, rotations, jacobian

    def _own_torques(
        self,
        velocity: Array,
        specific_force_body: Array | None,
        angular_velocity_body: Array | None,
        acceleration: Array | None,
    ) -> Array:
        """Torques (J,) that weight and motion of the legs need at configuration ``_q``, without forces on the feet."""
        zero, friction = np.zeros(3), np.zeros(len(self._v_index))
        rates, accelerations = np.zeros(self._model.nv), np.zeros(self._model.nv)
        force = zero if specific_force_body is None else specific_force_body
        accelerations[:_BASE] = self._T_root_body.act(pin.Motion(force, zero)).vector
        if acceleration is not None:
            rate = zero if angular_velocity_body is None else angular_velocity_body
            rates[:_BASE] = self._T_root_body.act(pin.Motion(zero, rate)).vector
            rates[self._v_index] = velocity
            accelerations[self._v_index] = acceleration
            friction = self._damping * velocity + self._dry_friction * np.tanh(velocity / _STICTION_RADPS)
        torques: Array = pin.rnea(self._model, self._data, self._q, rates, accelerations)[self._v_index]
        return torques + friction

    def _check_chains(self) -> None:
        for leg, frame in zip(self.description.legs, self._frames, strict=True):
            support = self._model.supports[self._model.frames[frame].parentJoint]
            chain = {self._model.names[joint] for joint in support if joint > _ROOT_JOINT}
            if chain != set(leg.joints):
                raise RobotModelError(
                    f"robot {self.description.name!r}, leg {leg.name!r}: its joints are listed as "
                    f"{listing(leg.joints)}, but the joints of legs between the body and {leg.foot_frame!r} are: "
                    f"{listing(chain)}; correct the leg's `joints` or `foot_frame`"
                )


def _slices(legs: tuple[LegDescription, ...]) -> tuple[slice, ...]:
    ends = np.cumsum([len(leg.joints) for leg in legs]).tolist()
    return tuple(slice(end - len(leg.joints), end) for leg, end in zip(legs, ends, strict=True))


def _read_urdf(description: RobotDescription) -> pin.Model:
    """The URDF on a free base, with continuous joints as unbounded revolute ones: one angle each, not two."""
    path = urdf_path(description)
    try:
        root = ElementTree.parse(path).getroot()
        for joint in root.iter("joint"):
            if joint.get("type") == "continuous":
                joint.set("type", "revolute")
                if joint.find("limit") is None:
                    ElementTree.SubElement(joint, "limit", {"effort": "0", "velocity": "0"})
        return pin.buildModelFromXML(ElementTree.tostring(root, encoding="unicode"), pin.JointModelFreeFlyer())
    except (ElementTree.ParseError, ValueError, RuntimeError) as error:
        raise RobotModelError(f"robot {description.name!r}: {path} is not a URDF that can be read: {error}") from error


def _legs_only(model: pin.Model, description: RobotDescription) -> pin.Model:
    """The model with every joint that belongs to no leg locked at neutral."""
    names = list(model.names)[_ROOT_JOINT + 1 :]
    missing = [joint for joint in description.joint_names if joint not in names]
    if missing:
        raise RobotModelError(
            f"robot {description.name!r}: the URDF has no moving joint {listing(missing)}; it has: {listing(names)}"
        )
    locked = [model.getJointId(name) for name in names if name not in description.joint_names]
    model = pin.buildReducedModel(model, locked, pin.neutral(model))
    for name in description.joint_names:
        if model.joints[model.getJointId(name)].nv != 1:
            raise RobotModelError(
                f"robot {description.name!r}: joint {name!r} has more than one degree of freedom; "
                "a leg is made of revolute, continuous and prismatic joints"
            )
    return model


def _frame_id(model: pin.Model, name: str, description: RobotDescription) -> int:
    if not model.existFrame(name):
        frames = [frame.name for frame in model.frames if frame.type == pin.FrameType.BODY]
        raise RobotModelError(
            f"robot {description.name!r}: the URDF has no link or frame {name!r}; its links are: {listing(frames)}"
        )
    return int(model.getFrameId(name))


def _body_to_root(model: pin.Model, data: pin.Data, description: RobotDescription) -> pin.SE3:
    """``T_body_root``: maps coordinates of the URDF's root link to the body frame."""
    if description.body_frame is None:
        return pin.SE3.Identity()
    frame = _frame_id(model, description.body_frame, description)
    if model.frames[frame].parentJoint != _ROOT_JOINT:
        raise RobotModelError(
            f"robot {description.name!r}: body_frame {description.body_frame!r} moves with a leg; "
            "take a link that is fixed to the root link"
        )
    pin.framesForwardKinematics(model, data, pin.neutral(model))
    return data.oMf[frame].inverse()
