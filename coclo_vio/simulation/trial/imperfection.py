# SPDX-License-Identifier: BSD-3-Clause
"""How a simulated robot differs from its description: drawn from the seed, never given to an estimator.

A real robot's legs are not those of its drawing (a Go1's are up to 17 % shorter), so an ideal robot tests little.
"""

from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
from pydantic import Field

from coclo_vio.geometry import so3
from coclo_vio.values.arrays import Array
from coclo_vio.values.config import StageConfig

_TRUNCATED_AT = 2.0  # standard deviations: a part further off would not have passed inspection


class ImperfectionConfig(StageConfig):
    """Standard deviations of what is drawn; Gaussian, cut at two sigma. All zero is the ideal robot."""

    link_length: Annotated[float, Field(ge=0, le=0.1, description="of each link's length, relative")] = 0.01
    joint_zero_rad: Annotated[float, Field(ge=0, le=0.1, description="of each encoder's zero, rad (0.5 deg)")] = 0.00873
    leg_base_m: Annotated[float, Field(ge=0, le=0.05, description="of each leg's base, each axis, m")] = 0.002
    foot_radius_m: Annotated[float, Field(ge=0, le=0.01, description="of each foot's radius, m")] = 0.001
    foot_compliance_m: Annotated[
        float,
        Field(
            ge=0,
            le=0.02,
            description="deflection of a leg along its lower link under its share of weight, m",
        ),
    ] = 0.003
    foot_compliance_spread: Annotated[float, Field(ge=0, le=0.45, description="of that, leg by leg, relative")] = 0.2
    mass: Annotated[float, Field(ge=0, le=0.3, description="of each link's mass and inertia, relative")] = 0.03
    camera_position_m: Annotated[
        float, Field(ge=0, le=0.05, description="of the stereo camera on the robot, each axis, m")
    ] = 0.002
    camera_rotation_rad: Annotated[
        float, Field(ge=0, le=0.1, description="of the stereo camera on the robot, each axis, rad (0.2 deg)")
    ] = 0.00349
    baseline_m: Annotated[
        float,
        Field(ge=0, le=0.01, description="of the right imager against the left, each axis, m; one bar holds both"),
    ] = 0.0002
    baseline_rotation_rad: Annotated[
        float, Field(ge=0, le=0.01, description="of the right imager against the left, each axis, rad (0.02 deg)")
    ] = 0.00035
    camera_turn_rad: Annotated[
        float,
        Field(ge=0, le=0.5, description="further rotation of the camera, exactly so far, about a drawn axis, rad"),
    ] = 0.0
    wrong_zero_rad: Annotated[
        float,
        Field(ge=-1, le=1, description="further error of the zero of one encoder, a drawn one, exactly so far, rad"),
    ] = 0.0


IDEAL = ImperfectionConfig(
    link_length=0.0,
    joint_zero_rad=0.0,
    leg_base_m=0.0,
    foot_radius_m=0.0,
    foot_compliance_m=0.0,
    foot_compliance_spread=0.0,
    mass=0.0,
    camera_position_m=0.0,
    camera_rotation_rad=0.0,
    baseline_m=0.0,
    baseline_rotation_rad=0.0,
)


@dataclass(frozen=True, slots=True, eq=False)
class Imperfection:
    """One robot's differences from its description, legs and joints in the order of the description.

    Attributes:
        link_scale: factor on the length of each joint's link, (joints,).
        joint_zero_rad: reading of each encoder at a true angle of zero, rad, (joints,).
        leg_base_m: shift of each leg's first joint, m, body frame, (legs, 3).
        foot_radius_m: added to each foot's radius, m, (legs,).
        foot_compliance_m: deflection of each leg along its lower link under its share of weight, m, (legs,).
        body_mass_scale: factor on the trunk's mass.
        link_mass_scale: factor on the mass of each joint's link, (joints,).
        camera_move: twist [rotation rad, translation m] of the stereo camera, left camera's axes, (6,).
        baseline_move: twist of the right camera against the left, its own axes, (6,).
    """

    link_scale: Array
    joint_zero_rad: Array
    leg_base_m: Array
    foot_radius_m: Array
    foot_compliance_m: Array
    body_mass_scale: float
    link_mass_scale: Array
    camera_move: Array
    baseline_move: Array


def draw_imperfection(
    config: ImperfectionConfig, legs: int, joints: int, generator: np.random.Generator
) -> Imperfection:
    """One robot from the population that ``config`` describes."""

    def spread(sigma: float, *shape: int) -> Array:
        return sigma * np.clip(generator.standard_normal(shape), -_TRUNCATED_AT, _TRUNCATED_AT)

    drawn = Imperfection(
        link_scale=1.0 + spread(config.link_length, joints),
        joint_zero_rad=spread(config.joint_zero_rad, joints),
        leg_base_m=spread(config.leg_base_m, legs, 3),
        foot_radius_m=spread(config.foot_radius_m, legs),
        foot_compliance_m=config.foot_compliance_m * (1.0 + spread(config.foot_compliance_spread, legs)),
        body_mass_scale=1.0 + float(spread(config.mass, 1)[0]),
        link_mass_scale=1.0 + spread(config.mass, joints),
        camera_move=np.concatenate((spread(config.camera_rotation_rad, 3), spread(config.camera_position_m, 3))),
        baseline_move=np.concatenate((spread(config.baseline_rotation_rad, 3), spread(config.baseline_m, 3))),
    )
    return _with_exact_errors(drawn, config, generator)


def _with_exact_errors(drawn: Imperfection, config: ImperfectionConfig, generator: np.random.Generator) -> Imperfection:
    """The robot with errors whose size is given; only where they are is drawn."""
    if config.camera_turn_rad > 0.0:
        axis = generator.standard_normal(3)
        turned = so3.exp(drawn.camera_move[:3]) @ so3.exp(config.camera_turn_rad * axis / np.linalg.norm(axis))
        drawn = replace(drawn, camera_move=np.concatenate((so3.log(turned), drawn.camera_move[3:])))
    if config.wrong_zero_rad != 0.0:
        wrong = np.zeros_like(drawn.joint_zero_rad)
        wrong[generator.integers(len(wrong))] = config.wrong_zero_rad
        drawn = replace(drawn, joint_zero_rad=drawn.joint_zero_rad + wrong)
    return drawn
