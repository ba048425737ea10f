# SPDX-License-Identifier: BSD-3-Clause
"""The legs of a URDF through Pinocchio: kinematics, dynamics, and the constants of the compiled form.

The only importer of Pinocchio in this room.
"""

import logging
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin

from coclo_vio.geometry import so3
from coclo_vio.robot.description import LegDescription, RobotDescription, urdf_path
from coclo_vio.robot.leg_kernels import LegChains
from coclo_vio.robot.urdf_messages import caught_messages
from coclo_vio.values.arrays import Array, BoolArray, has_nan
from coclo_vio.values.errors import RobotModelError, listing

_log = logging.getLogger(__name__)
_BASE = 6  # the free base comes first in every Pinocchio vector, with six velocities
_ROOT_JOINT = 1
_STICTION_RADPS = 0.1  # dry friction grows to its full value over about this joint speed


class PinocchioLegs:
    """The legs of a description on a free base; joints outside the legs are locked at neutral.

    Not thread-safe: Pinocchio's workspace is reused from call to call.

    Raises:
        RobotModelError: the URDF cannot be read, or lacks a joint or frame that the description names.
    """

    def __init__(self, description: RobotDescription) -> None:
        self._description = description
        self._model = _read_urdf(description)
        self._model.gravity.linear = np.zeros(3)  # gravity enters through the specific force of the base
        self._frames = [_foot_frame(self._model, leg, description) for leg in description.legs]
        self._data = self._model.createData()
        self._T_body_root = _body_to_root(self._model, self._data, description)
        self._root_from_body: Array = self._T_body_root.inverse().action  # of [linear, angular] motions
        joints = [self._model.joints[self._model.getJointId(name)] for name in description.joint_names]
        self._q_index = np.array([joint.idx_q for joint in joints])
        self._v_index = np.array([joint.idx_v for joint in joints])
        self._damping: Array = np.array(self._model.damping)[self._v_index]
        self._dry_friction: Array = np.array(self._model.upperDryFrictionLimit)[self._v_index]
        self._q = pin.neutral(self._model)
        self._q[:7] = pin.SE3ToXYZQUAT(self._T_body_root)
        self.is_own_joint: BoolArray = np.zeros((len(description.legs), len(joints)), dtype=np.bool_)
        for row, joints_of_leg in enumerate(joint_slices(description.legs)):
            self.is_own_joint[row, joints_of_leg] = True
        self._check_chains()

    @property
    def velocity_limits(self) -> Array:
        """Of the joints, rad/s, (J,)."""
        return np.asarray(np.array(self._model.velocityLimit)[self._v_index])

    @property
    def position_limits(self) -> Array:
        """Lower and upper limits of the joints, rad, (2, J); both infinite where the URDF has none."""
        bounds = (self._model.lowerPositionLimit, self._model.upperPositionLimit)
        lower, upper = (np.array(bound)[self._q_index] for bound in bounds)
        has_none = lower >= upper
        return np.array([np.where(has_none, -np.inf, lower), np.where(has_none, np.inf, upper)])

    @property
    def effort_limits(self) -> Array:
        """Of the joints, Nm, (J,); infinite where the URDF has none."""
        limits = np.array(self._model.effortLimit)[self._v_index]
        return np.asarray(np.where(limits > 0.0, limits, np.inf))

    @property
    def mass_kg(self) -> float:
        """Mass of the whole robot, kg."""
        return float(sum(inertia.mass for inertia in self._model.inertias))

    def hip_position_body(self) -> Array:
        """Where the first joint of each leg is, m, body frame, (n, 3)."""
        pin.forwardKinematics(self._model, self._data, self._q)
        first_joints = [self._model.getJointId(leg.joints[0]) for leg in self._description.legs]
        return np.array([self._data.oMi[joint].translation for joint in first_joints])

    def centre_of_mass_body(self, position: Array) -> Array:
        """Centre of mass of the whole robot, m, body frame, (3,), at joint positions (J,), all known."""
        self._q[self._q_index] = position
        return np.array(pin.centerOfMass(self._model, self._data, self._q))

    def kinematics(self, position: Array) -> tuple[Array, Array, Array]:
        """Foot centres (n, 3), rotations (n, 3, 3) and Jacobians (n, 6, J), as in ``FeetKinematics``."""
        self._set_position(position)
        model, data = self._model, self._data
        pin.computeJointJacobians(model, data, self._q)
        placements = [pin.updateFramePlacement(model, data, frame) for frame in self._frames]
        centres: Array = np.array([placement.translation for placement in placements])
        rotations: Array = np.array([placement.rotation for placement in placements])
        columns = data.J[:, self._v_index]  # [linear at the body origin, angular] in body axes
        jacobian = np.empty((len(placements), 6, len(self._v_index)))
        jacobian[:, :3] = columns[3:]
        jacobian[:, 3:] = columns[:3] - so3.hat(centres) @ columns[3:]
        jacobian *= self.is_own_joint[:, None, :]
        if has_nan(position):
            legs = (self.is_own_joint & np.isnan(position)).any(axis=1)
            centres[legs], rotations[legs], jacobian[legs] = np.nan, np.nan, np.nan
        return centres, rotations, jacobian

    def own_torques(
        self,
        position: Array,
        velocity: Array,
        specific_force_body: Array | None,
        angular_velocity_body: Array | None,
        acceleration: Array | None,
    ) -> Array:
        """Torques (J,) that weight and motion of the legs need, without forces on the feet; as in ``foot_forces``."""
        self._set_position(position)
        rates, accelerations = np.zeros(self._model.nv), np.zeros(self._model.nv)
        if specific_force_body is not None:
            accelerations[:_BASE] = self._root_from_body[:, :3] @ specific_force_body
        if acceleration is None:
            return np.asarray(pin.rnea(self._model, self._data, self._q, rates, accelerations)[self._v_index])
        if angular_velocity_body is not None:
            rates[:_BASE] = self._root_from_body[:, 3:] @ angular_velocity_body
        rates[self._v_index], accelerations[self._v_index] = velocity, acceleration
        friction = self._damping * velocity + self._dry_friction * np.tanh(velocity / _STICTION_RADPS)
        return np.asarray(pin.rnea(self._model, self._data, self._q, rates, accelerations)[self._v_index] + friction)

    def _set_position(self, position: Array) -> None:
        """Set the joints, those of unknown position to zero."""
        self._q[self._q_index] = np.nan_to_num(position, nan=0.0) if has_nan(position) else position

    def chains(self) -> LegChains | None:
        """The constants of the legs for ``leg_kernels``; None where a joint is neither revolute nor prismatic."""
        model, names = self._model, self._description.joint_names
        pin.computeJointJacobians(model, self._data, self._q)
        first, joints, feet = [0], [], []
        for frame in (model.frames[index] for index in self._frames):
            joints += [joint for joint in model.supports[frame.parentJoint] if joint > _ROOT_JOINT]
            first.append(len(joints))
            feet.append(_matrix(frame.placement))
        axes = np.array([self._axis_of(joint) for joint in joints])
        if (axes.any(axis=2).sum(axis=1) != 1).any():  # it turns and slides at once
            return None
        steps = np.zeros((len(joints), 4, 3, 4))
        for step, joint, (angular, linear) in zip(steps, joints, axes, strict=True):
            placement, axis_hat = model.jointPlacements[joint], so3.hat(angular)
            is_first = model.parents[joint] == _ROOT_JOINT
            step[0] = _matrix(self._T_body_root * placement if is_first else placement)
            step[1, :, :3], step[2, :, :3] = step[0, :, :3] @ axis_hat, step[0, :, :3] @ axis_hat @ axis_hat
            step[3, :, 3] = step[0, :, :3] @ linear
        columns = np.array([names.index(model.names[joint]) for joint in joints])
        return LegChains(np.array(first), columns, steps, axes, np.array(feet))

    def _axis_of(self, joint: int) -> Array:
        """Angular and linear axis of a joint in the axes of its link, (2, 3)."""
        jacobian = pin.getJointJacobian(self._model, self._data, joint, pin.ReferenceFrame.LOCAL)
        column = jacobian[:, self._model.joints[joint].idx_v]
        return np.array([column[3:], column[:3]])

    def _check_chains(self) -> None:
        for leg, frame in zip(self._description.legs, self._frames, strict=True):
            support = self._model.supports[self._model.frames[frame].parentJoint]
            chain = {self._model.names[joint] for joint in support if joint > _ROOT_JOINT}
            if chain != set(leg.joints):
                raise RobotModelError(
                    f"robot {self._description.name!r}, leg {leg.name!r}: its joints are listed as "
                    f"{listing(leg.joints)}, but the joints of legs between the body and {leg.foot_frame!r} are: "
                    f"{listing(chain)}; correct the leg's `joints` or `foot_frame`"
                )


def joint_slices(legs: tuple[LegDescription, ...]) -> tuple[slice, ...]:
    """Where the joints of each leg are among those of the robot."""
    ends = np.cumsum([len(leg.joints) for leg in legs]).tolist()
    return tuple(slice(end - len(leg.joints), end) for leg, end in zip(legs, ends, strict=True))


def _matrix(placement: pin.SE3) -> Array:
    """A placement as [rotation, translation], (3, 4)."""
    return np.asarray(placement.homogeneous[:3])


def _read_urdf(description: RobotDescription) -> pin.Model:
    """The URDF on a free base, with every joint that belongs to no leg fixed at zero.

    Continuous joints become unbounded revolute ones: one angle each, not two.
    """
    path = urdf_path(description)
    try:
        root = ElementTree.parse(path).getroot()
    except (ElementTree.ParseError, OSError) as error:
        raise RobotModelError(f"robot {description.name!r}: {path} is not a URDF that can be read: {error}") from error
    moving = _fix_other_joints(root, description)
    for joint in moving:
        if joint.get("type") == "continuous":
            joint.set("type", "revolute")
            if joint.find("limit") is None:
                ElementTree.SubElement(joint, "limit", {"effort": "0", "velocity": "0"})
    with caught_messages() as messages:
        try:
            model = pin.buildModelFromXML(ElementTree.tostring(root, encoding="unicode"), pin.JointModelFreeFlyer())
            failure = None
        except (ValueError, RuntimeError) as error:
            failure = error
    if failure is not None:
        reasons = "; ".join(messages) if messages else failure
        raise RobotModelError(
            f"robot {description.name!r}: {path} is not a URDF that can be read: {reasons}; correct the URDF"
        ) from failure
    if messages:
        _log.warning("robot %r: parts of %s are ignored: %s", description.name, path, "; ".join(messages))
    for name in description.joint_names:
        if model.joints[model.getJointId(name)].nv != 1:
            raise RobotModelError(
                f"robot {description.name!r}: joint {name!r} has more than one degree of freedom; "
                "a leg is made of revolute, continuous and prismatic joints"
            )
    return model


def _fix_other_joints(root: ElementTree.Element, description: RobotDescription) -> list[ElementTree.Element]:
    """Fix every joint that belongs to no leg; returns those that do."""
    moving = {str(joint.get("name")): joint for joint in root.findall("joint") if joint.get("type") != "fixed"}
    missing = [name for name in description.joint_names if name not in moving]
    if missing and root.find("link") is not None:
        raise RobotModelError(
            f"robot {description.name!r}: the URDF has no moving joint {listing(missing)}; it has: {listing(moving)}"
        )
    for name in moving.keys() - set(description.joint_names):
        moving[name].set("type", "fixed")
    return [moving[name] for name in description.joint_names if name in moving]


def _frame_id(model: pin.Model, name: str, description: RobotDescription) -> int:
    """The frame of a link, or of a joint where no link has its name."""
    for kind in (pin.FrameType.BODY, pin.FrameType.FIXED_JOINT, pin.FrameType.JOINT):
        if model.existFrame(name, kind):
            return int(model.getFrameId(name, kind))
    frames = [frame.name for frame in model.frames if frame.type == pin.FrameType.BODY]
    raise RobotModelError(
        f"robot {description.name!r}: the URDF has no link or frame {name!r}; its links are: {listing(frames)}"
    )


def _foot_frame(model: pin.Model, leg: LegDescription, description: RobotDescription) -> int:
    """The frame at the centre of a foot; one is added where no frame of the URDF is there."""
    frame = _frame_id(model, leg.foot_frame, description)
    if not any(leg.foot_centre_m):
        return frame
    link = model.frames[frame]
    centre = link.placement * pin.SE3(np.eye(3), np.array(leg.foot_centre_m))
    return int(model.addFrame(pin.Frame(f"{leg.name} foot centre", link.parentJoint, centre, pin.FrameType.OP_FRAME)))


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
