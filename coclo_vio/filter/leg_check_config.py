# SPDX-License-Identifier: BSD-3-Clause
"""Parameters of the comparison of each leg with the others."""

from typing import Annotated

from pydantic import Field

from coclo_vio.values.config import StageConfig


class LegCheckConfig(StageConfig):
    """When a leg counts as inconsistent with the others, is set aside, and is used again."""

    is_enabled: Annotated[bool, Field(description="whether legs that contradict the others are set aside")] = True
    interval_s: Annotated[
        float, Field(gt=0, le=1, description="legs are compared over intervals of this length, s")
    ] = 0.1
    memory_s: Annotated[float, Field(gt=0, description="residuals are forgotten with this time constant, s")] = 5.0
    persistent_share: Annotated[
        float,
        Field(
            gt=0, lt=1, description="one sigma of a leg's lasting error as a share of the way: geometry, rolling, slip"
        ),
    ] = 0.05
    limit: Annotated[
        float, Field(gt=1, description="a leg is inconsistent whose mean squared normalised residual exceeds this")
    ] = 5.0
    least_ratio: Annotated[
        float, Field(gt=1, description="it must also exceed the next leg's by this factor, or no leg is named")
    ] = 2.5
    duration_s: Annotated[float, Field(ge=0, description="a leg is set aside once inconsistent for so long, s")] = 1.0
    least_legs: Annotated[int, Field(ge=2, description="so many legs are always left in use")] = 3
    return_s: Annotated[
        float, Field(gt=0, description="a leg is watched over so much stance, and used again if it agreed, s")
    ] = 5.0
    return_path_m: Annotated[
        float, Field(ge=0, description="... and while the body travelled so far, m; at rest all legs agree")
    ] = 0.2
    offset_memory_s: Annotated[
        float, Field(gt=0, description="time constant of the estimated offset of an encoder, s of stance")
    ] = 30.0
    offset_share: Annotated[
        float, Field(gt=0, lt=1, description="as persistent_share, of legs without such an offset, at least")
    ] = 0.02
    offset_sigmas: Annotated[float, Field(gt=1, description="an offset is reported beyond so many sigmas")] = 4.0
    least_offset_rad: Annotated[
        float, Field(gt=0, lt=1, description="smaller offsets of an encoder are left alone, rad")
    ] = 0.035
