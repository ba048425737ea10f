# SPDX-License-Identifier: BSD-3-Clause
"""The quadruped for the physics: its URDF's links, motors of torques, collision bodies, differences."""

from typing import Annotated, Any

import mujoco
import numpy as np
from pydantic import Field

from coclo_vio.robot.description import LegDescription, RobotDescription
from coclo_vio.robot.model import RobotModel
from coclo_vio.simulation.trial.bodies import (
    GROUND,
    LEG,
    TRUNK,
    add_ground,
    add_sole,
    add_touch_sensor,
    contact_settings,
    set_physics,
    urdf_with_own_links,
)
from coclo_vio.simulation.trot.ground import TrotGround
from coclo_vio.simulation.trot.trot_imperfection import TrotImperfection
from coclo_vio.values.arrays import Array
from coclo_vio.values.config import StageConfig
from coclo_vio.values.units import GRAVITY_MPS2

_STANDING_LEGS = 2  # of four carry the weight in a trot
_BENDING_DAMPING = 0.1  # of a joint's bearing, share of critical
_LEAST_FOOT_KG = 0.05  # for the damping of a foot's rubber
_CREEP_ARMATURE_KG = 0.02  # makes the two springs of a foot in series two coordinates


class TrotBodyConfig(StageConfig):
    """Joints, feet and contact: what the URDF does not hold. The defaults are a Go1's."""

    armature_kgm2: Annotated[
        tuple[float, float, float], Field(description="rotor inertia of hip, thigh, knee, at the joint, kg m^2")
    ] = (0.01, 0.01, 0.02)
    joint_damping: Annotated[float, Field(ge=0, le=10, description="viscous, Nm/(rad/s)")] = 0.1
    dry_friction_nm: Annotated[
        float, Field(ge=0, le=5, description="dry friction of a joint, overcome by the motor's torque, Nm")
    ] = 0.2
    motor_lag_s: Annotated[float, Field(gt=0, le=0.02, description="time constant of a motor's torque, s")] = 0.002
    friction: Annotated[float, Field(gt=0, le=2, description="Coulomb coefficient between foot and ground")] = 0.7
    torsional_friction_m: Annotated[
        float,
        Field(ge=0, le=0.1, description="torque about a foot's normal for its normal force, m; 0: it turns freely"),
    ] = 0.0
    foot_radius_m: Annotated[
        float | None, Field(gt=0, le=0.1, description="radius of the spherical feet, m; null: as described")
    ] = None
    capsule_radius_m: Annotated[float, Field(gt=0, le=0.1, description="of the legs' collision bodies, m")] = 0.015
    time_step_s: Annotated[float, Field(gt=0, le=0.002, description="step of the physics, s")] = 0.001


def make_trot_spec(
    description: RobotDescription, config: TrotBodyConfig, imperfection: TrotImperfection, ground: TrotGround
) -> mujoco.MjSpec:
    """The robot on its ground; actuator ``<joint>_motor`` gives each joint's torque.

    A joint that bends is two hinges about one axis, the motor's (with the joint's name) and a stiff spring. A foot
    that gives way slides along the lower link, and where it creeps a second, damped spring is in series.
    """
    spec = mujoco.MjSpec.from_string(urdf_with_own_links(description, with_shapes=False))
    set_physics(spec, config.time_step_s)
    spec.bodies[1].add_freejoint()
    trunk = _trunk(spec, description)
    trunk.mass *= imperfection.body_mass_scale
    trunk.fullinertia = np.array(trunk.fullinertia) * imperfection.body_mass_scale
    add_ground(spec, ground.boxes, config.friction)
    model = RobotModel(description, is_compiled=False)
    _add_trunk_box(spec.bodies[1], model, config)
    for leg_index, leg in enumerate(description.legs):
        _shape_leg(spec, leg, leg_index, config, imperfection)
        _add_foot(spec, leg, leg_index, config, imperfection, model.mass_kg)
    for name, limit in zip(description.joint_names, model.effort_limits, strict=True):
        _add_motor(spec, name, float(limit), config)
    return spec


def _trunk(spec: mujoco.MjSpec, description: RobotDescription) -> Any:
    """The link that holds the trunk's mass: the heaviest of the links that no joint moves."""
    first = {spec.joint(leg.joints[0]).parent.name for leg in description.legs}
    fixed, pending = [], [spec.bodies[1]]
    while pending:
        body = pending.pop()
        fixed.append(body)
        pending += [child for child in body.bodies if child.name not in first]
    return max(fixed, key=lambda body: float(body.mass))


def _add_trunk_box(base: Any, model: RobotModel, config: TrotBodyConfig) -> None:
    """A box between the hips, which touches the ground when the robot has fallen."""
    half = np.array([np.ptp(model.hip_position_body[:, 0]) / 2.0, np.ptp(model.hip_position_body[:, 1]) / 2.0, 0.05])
    base.add_geom(
        name="trunk_box",
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=half,
        contype=TRUNK,
        conaffinity=GROUND,
        **contact_settings(config.friction),
        mass=0.0,
        group=1,
        rgba=[0.3, 0.3, 0.32, 1.0],
    )


def _shape_leg(
    spec: mujoco.MjSpec, leg: LegDescription, leg_index: int, config: TrotBodyConfig, imperfection: TrotImperfection
) -> None:
    """One leg's true lengths and masses, its joints' losses and bending, and its collision capsules."""
    joints = [spec.joint(name) for name in leg.joints]
    links = [joint.parent for joint in joints]
    first = len(leg.joints) * leg_index
    links[0].pos = np.array(links[0].pos) + imperfection.leg_base_m[leg_index]
    ends = [*links[1:], _end_of_lower_link(spec, leg)]
    for offset, (link, end, joint) in enumerate(zip(links, ends, joints, strict=True)):
        scale = imperfection.link_mass_scale[first + offset]
        link.mass *= scale
        link.fullinertia = np.array(link.fullinertia) * scale
        end.pos = np.array(end.pos) * imperfection.link_scale[first + offset]
        joint.armature = config.armature_kgm2[offset]
        joint.damping = np.array([config.joint_damping, 0.0, 0.0])
        joint.frictionloss = config.dry_friction_nm
        joint.actfrclimited = mujoco.mjtLimited.mjLIMITED_FALSE
        bending = float(imperfection.joint_bending_rad_per_nm[first + offset])
        if bending > 0.0:
            _add_bending(link, joint, bending, config.armature_kgm2[offset])
        if offset > 0:
            _add_capsule(link, np.array(end.pos), config)


def _end_of_lower_link(spec: mujoco.MjSpec, leg: LegDescription) -> Any:
    """The body at the end of the lower link, in which the foot is or to which it is fixed."""
    body, lower = spec.body(leg.foot_frame), spec.joint(leg.joints[-1]).parent.name
    while body.parent.name != lower:
        body = body.parent
    return body


def _add_bending(link: Any, joint: Any, rad_per_nm: float, armature: float) -> None:
    """A spring behind the motor, about the same axis."""
    stiffness = 1.0 / rad_per_nm
    link.add_joint(
        name=f"{joint.name}_bending",
        type=mujoco.mjtJoint.mjJNT_HINGE,
        axis=joint.axis,
        pos=joint.pos,
        stiffness=stiffness,
        damping=2.0 * _BENDING_DAMPING * float(np.sqrt(stiffness * armature)),
    )


def _add_capsule(link: Any, end: Array, config: TrotBodyConfig) -> None:
    """A capsule along a link, ended before the joints so that neighbours in one leg do not touch."""
    link.add_geom(
        type=mujoco.mjtGeom.mjGEOM_CAPSULE,
        fromto=[*(0.15 * end), *(0.75 * end)],
        size=[config.capsule_radius_m, 0.0, 0.0],
        contype=LEG,
        conaffinity=LEG | GROUND,
        **contact_settings(config.friction),
        mass=0.0,
        group=1,
        rgba=[0.25, 0.25, 0.27, 1.0],
    )


def _add_foot(
    spec: mujoco.MjSpec,
    leg: LegDescription,
    leg_index: int,
    config: TrotBodyConfig,
    imperfection: TrotImperfection,
    mass_kg: float,
) -> None:
    foot, name = spec.body(leg.foot_frame), leg.foot_frame
    radius = (config.foot_radius_m or leg.foot_radius_m) + imperfection.foot_radius_m[leg_index]
    settings = contact_settings(config.friction, config.torsional_friction_m)
    add_sole(foot, name, radius, settings, leg.foot_centre_m)
    add_touch_sensor(spec, name)
    body = _end_of_lower_link(spec, leg)
    along = np.array(body.pos) / np.linalg.norm(body.pos)
    forwards = np.cross(np.array(spec.joint(leg.joints[-1]).axis), along)
    lengthwise_m = float(imperfection.foot_compliance_m[leg_index])
    kinds = (("compliance", along, lengthwise_m), ("shear", forwards, imperfection.foot_shear_m))
    for kind, axis, deflection_m in kinds:
        if deflection_m > 0.0:
            stiffness = mass_kg * GRAVITY_MPS2 / _STANDING_LEGS / deflection_m
            _add_rubber(body, f"{name}_{kind}", axis, stiffness, imperfection)


def _add_rubber(body: Any, name: str, axis: Array, stiffness: float, imperfection: TrotImperfection) -> None:
    """A spring along an axis, and in series with it the damped one that creeps, where there is creep."""
    _add_slide(body, name, axis, stiffness, float(np.sqrt(stiffness * max(body.mass, _LEAST_FOOT_KG))), 0.0)
    if imperfection.foot_creep > 0.0:
        slow = stiffness / imperfection.foot_creep
        _add_slide(body, f"{name}_creep", axis, slow, slow * imperfection.foot_creep_s, _CREEP_ARMATURE_KG)


def _add_slide(body: Any, name: str, axis: Array, stiffness: float, damping: float, armature: float) -> None:
    kind = mujoco.mjtJoint.mjJNT_SLIDE
    body.add_joint(name=name, type=kind, axis=axis, stiffness=stiffness, damping=damping, armature=armature)


def _add_motor(spec: mujoco.MjSpec, joint: str, limit_nm: float, config: TrotBodyConfig) -> None:
    """A motor of torques with a first-order lag."""
    motor = spec.add_actuator(name=f"{joint}_motor", target=joint, trntype=mujoco.mjtTrn.mjTRN_JOINT)
    motor.dyntype = mujoco.mjtDyn.mjDYN_FILTEREXACT
    motor.dynprm[0] = config.motor_lag_s
    motor.ctrllimited = mujoco.mjtLimited.mjLIMITED_TRUE
    motor.ctrlrange = np.array([-limit_nm, limit_nm])
