# SPDX-License-Identifier: BSD-3-Clause
"""The robot for the physics, from the same URDF that the estimators read: actuators, collision bodies, differences.

Joints are series-elastic: a motor holds an angle behind a spring, and the torque that is measured is the spring's.
"""

from typing import Annotated, Any

import mujoco
import numpy as np
from pydantic import Field

from coclo_vio.robot.description import RobotDescription
from coclo_vio.robot.model import RobotModel
from coclo_vio.simulation.trial.bodies import (
    GROUND,
    LEG,
    add_ground,
    add_sole,
    add_touch_sensor,
    contact_settings,
    set_physics,
    urdf_with_own_links,
)
from coclo_vio.simulation.trial.imperfection import Imperfection
from coclo_vio.simulation.trial.terrain import Terrain
from coclo_vio.values.arrays import Array
from coclo_vio.values.config import StageConfig
from coclo_vio.values.units import GRAVITY_MPS2

_STANDING_LEGS = 5  # of six carry the weight in a wave gait


class BodyConfig(StageConfig):
    """Joint springs and dampers, feet and contact: what the URDF does not hold."""

    spring_nm_per_rad: Annotated[
        tuple[float, float, float], Field(description="series springs of base, shoulder, elbow, Nm/rad")
    ] = (100.0, 150.0, 100.0)
    spring_damping: Annotated[float, Field(gt=0, description="damping inside the spring, Nm/(rad/s)")] = 3.0
    motor_lag_s: Annotated[float, Field(gt=0, description="time constant of the motor's position loop, s")] = 0.01
    bearing_friction_nm: Annotated[
        float, Field(ge=0, le=5, description="dry friction of a joint's output bearing, not measured by the spring, Nm")
    ] = 0.05
    friction: Annotated[float, Field(gt=0, le=2, description="Coulomb coefficient between foot and ground")] = 0.7
    foot_radius_m: Annotated[
        float | None, Field(gt=0, le=0.1, description="radius of the spherical feet, m; null: as described")
    ] = None
    capsule_radius_m: Annotated[float, Field(gt=0, le=0.1, description="of the legs' collision bodies, m")] = 0.025
    time_step_s: Annotated[float, Field(gt=0, le=0.005, description="step of the physics, s")] = 0.001


def make_spec(
    description: RobotDescription, config: BodyConfig, imperfection: Imperfection, terrain: Terrain
) -> mujoco.MjSpec:
    """The robot on its terrain: URDF, differences, actuators, collision bodies, foot sensors.

    Every foot hangs on a stiff spring along its lower link where the imperfection gives it compliance. Actuators are,
    for each joint in the description's order, the spring and then, for each joint, its damping.
    """
    spec = mujoco.MjSpec.from_string(urdf_with_own_links(description))
    set_physics(spec, config.time_step_s)
    base = spec.bodies[1]
    base.add_freejoint()
    for geom in list(spec.geoms):
        geom.group, geom.contype, geom.conaffinity = 1, 0, 0
    base.mass *= imperfection.body_mass_scale
    base.fullinertia = np.array(base.fullinertia) * imperfection.body_mass_scale
    add_ground(spec, terrain.boxes, config.friction)
    mass = RobotModel(description).mass_kg
    for leg_index in range(len(description.legs)):
        _shape_leg(spec, description, leg_index, config, imperfection)
        _add_foot(spec, description, leg_index, config, imperfection, mass)
    _add_actuators(spec, description, config)
    return spec


def _shape_leg(
    spec: mujoco.MjSpec,
    description: RobotDescription,
    leg_index: int,
    config: BodyConfig,
    imperfection: Imperfection,
) -> None:
    """One leg's true lengths and masses, and its collision capsules."""
    leg = description.legs[leg_index]
    joints = [spec.joint(name) for name in leg.joints]
    links = [joint.parent for joint in joints]
    first = len(leg.joints) * leg_index
    links[0].pos = np.array(links[0].pos) + imperfection.leg_base_m[leg_index]
    ends = [*links[1:], spec.body(leg.foot_frame)]
    for offset, (link, end, joint) in enumerate(zip(links, ends, joints, strict=True)):
        scale = imperfection.link_mass_scale[first + offset]
        link.mass *= scale
        link.fullinertia = np.array(link.fullinertia) * scale
        end.pos = np.array(end.pos) * imperfection.link_scale[first + offset]
        joint.frictionloss = config.bearing_friction_nm
        joint.actfrclimited = mujoco.mjtLimited.mjLIMITED_FALSE
        if offset > 0:
            _add_capsule(link, np.array(end.pos), config)


def _add_capsule(link: Any, end: Array, config: BodyConfig) -> None:
    """A capsule along a link, ended before the joints so that neighbours in one leg do not touch."""
    is_lower = abs(end[1]) > 0.0
    link.add_geom(
        type=mujoco.mjtGeom.mjGEOM_CAPSULE,
        fromto=[*(0.1 * end), *((0.75 if is_lower else 0.95) * end)],
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
    description: RobotDescription,
    leg_index: int,
    config: BodyConfig,
    imperfection: Imperfection,
    mass_kg: float,
) -> None:
    leg = description.legs[leg_index]
    foot = spec.body(leg.foot_frame)
    radius = (config.foot_radius_m or leg.foot_radius_m) + imperfection.foot_radius_m[leg_index]
    add_sole(foot, leg.foot_frame, radius, contact_settings(config.friction))
    add_touch_sensor(spec, leg.foot_frame)
    compliance_m = imperfection.foot_compliance_m[leg_index]
    if compliance_m > 0.0:
        stiffness = mass_kg * GRAVITY_MPS2 / _STANDING_LEGS / compliance_m
        foot.add_joint(
            name=f"{leg.foot_frame}_compliance",
            type=mujoco.mjtJoint.mjJNT_SLIDE,
            axis=[1.0, 0.0, 0.0],
            stiffness=stiffness,
            damping=2.0 * float(np.sqrt(stiffness * foot.mass)),
        )


def _add_actuators(spec: mujoco.MjSpec, description: RobotDescription, config: BodyConfig) -> None:
    """For each joint its spring, then for each joint the damping inside the spring."""
    for leg in description.legs:
        for name, stiffness in zip(leg.joints, config.spring_nm_per_rad, strict=True):
            spring = spec.add_actuator(name=f"{name}_spring", target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
            spring.set_to_position(kp=stiffness, timeconst=config.motor_lag_s)
    for name in description.joint_names:
        damper = spec.add_actuator(name=f"{name}_damper", target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        damper.set_to_velocity(kv=config.spring_damping)
