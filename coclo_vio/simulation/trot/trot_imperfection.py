# SPDX-License-Identifier: BSD-3-Clause
"""How a simulated quadruped differs from its description: as a Daisy does, and by causes of a path that is too short.

Each cause can be simulated alone: ``IDEAL`` of the Daisy sets the spreads to zero, and what is here is zero unless set.
"""

from dataclasses import dataclass, fields
from typing import Annotated

import numpy as np
from pydantic import Field

from coclo_vio.simulation.trial.imperfection import Imperfection, ImperfectionConfig, draw_imperfection
from coclo_vio.values.arrays import Array


class TrotImperfectionConfig(ImperfectionConfig):
    """Standard deviations of what is drawn, and exact errors that all legs share."""

    foot_compliance_m: Annotated[
        float,
        Field(ge=0, le=0.02, description="deflection of a foot along the lower link under half of the weight, m"),
    ] = 0.003
    link_length_error: Annotated[
        float, Field(ge=-0.2, le=0.2, description="of all links, exactly so much, relative; negative: too short")
    ] = 0.0
    foot_radius_error_m: Annotated[
        float, Field(ge=-0.02, le=0.03, description="of all feet, exactly so much; their rolling radius, m")
    ] = 0.0
    foot_shear_m: Annotated[
        float,
        Field(ge=0, le=0.02, description="deflection of a foot forwards and backwards under half of the weight, m"),
    ] = 0.0
    foot_creep: Annotated[
        float, Field(ge=0, le=10, description="further deflection of a loaded foot in time, share of the immediate one")
    ] = 0.0
    foot_creep_s: Annotated[float, Field(gt=0.01, le=10, description="time constant of that deflection, s")] = 0.1
    joint_bending_rad_per_nm: Annotated[
        tuple[float, float, float],
        Field(description="compliance of hip, thigh and knee beyond the encoder, which does not see it, rad/Nm"),
    ] = (0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True, eq=False)
class TrotImperfection(Imperfection):
    """One quadruped's differences from its description.

    Attributes:
        foot_shear_m: deflection of a foot forwards and backwards under half of the weight, m.
        foot_creep: further deflection of a loaded foot in time, share of the immediate one.
        foot_creep_s: time constant of that deflection, s.
        joint_bending_rad_per_nm: compliance of each joint beyond its encoder, (joints,).
    """

    foot_shear_m: float
    foot_creep: float
    foot_creep_s: float
    joint_bending_rad_per_nm: Array


def draw_trot_imperfection(
    config: TrotImperfectionConfig, legs: int, generator: np.random.Generator
) -> TrotImperfection:
    """One quadruped, with three joints a leg, from the population that ``config`` describes."""
    drawn = draw_imperfection(config, legs, 3 * legs, generator)
    values = {each.name: getattr(drawn, each.name) for each in fields(drawn)}
    values["link_scale"] = drawn.link_scale * (1.0 + config.link_length_error)
    values["foot_radius_m"] = drawn.foot_radius_m + config.foot_radius_error_m
    bending = np.tile(config.joint_bending_rad_per_nm, legs)
    return TrotImperfection(
        foot_shear_m=config.foot_shear_m,
        **values,
        foot_creep=config.foot_creep,
        foot_creep_s=config.foot_creep_s,
        joint_bending_rad_per_nm=bending,
    )
