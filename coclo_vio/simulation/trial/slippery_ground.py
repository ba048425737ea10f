# SPDX-License-Identifier: BSD-3-Clause
"""Ground of low friction: the tile, random patches, edges of steps, and the first moments of a foot's contact.

None of it is visible in the images or known to the controller.
"""

from dataclasses import dataclass
from typing import Annotated, Protocol

import numpy as np
from pydantic import Field

from coclo_vio.simulation.trial.slippery_tile import SlipperyTile
from coclo_vio.simulation.visuals.room import RoomBounds
from coclo_vio.values.arrays import Array
from coclo_vio.values.config import StageConfig


class WalkedGround(Protocol):
    """The ground on which areas of low friction are drawn."""

    @property
    def bounds(self) -> RoomBounds:
        """The walked area."""

    @property
    def risers_m(self) -> tuple[float, ...]:
        """x of the vertical faces."""


class SlipConfig(StageConfig):
    """Where and when feet slip. The defaults are ground of one friction."""

    patches_per_m2: Annotated[float, Field(ge=0, le=10, description="round patches of low friction, 1/m^2")] = 0.0
    patch_radius_m: Annotated[float, Field(gt=0, le=1, description="largest radius of a patch, m; least: a third")] = (
        0.3
    )
    patch_friction: Annotated[float, Field(gt=0, le=2, description="Coulomb coefficient on a patch")] = 0.25
    edge_m: Annotated[
        float, Field(ge=0, le=0.3, description="breadth of the slippery edge of each step, from its riser on, m")
    ] = 0.0
    edge_friction: Annotated[float, Field(gt=0, le=2, description="Coulomb coefficient on that edge")] = 0.2
    touch_down_s: Annotated[
        float, Field(ge=0, le=2, description="time after touch-down in which a foot has a friction of its own, s")
    ] = 0.0
    touch_down_friction: Annotated[float, Field(gt=0, le=2, description="Coulomb coefficient in that time")] = 0.15

    @property
    def is_active(self) -> bool:
        """Whether any foot can slip more than on ground of one friction."""
        return self.patches_per_m2 > 0.0 or self.edge_m > 0.0 or self.touch_down_s > 0.0


@dataclass(frozen=True, slots=True, eq=False)
class SlipperyGround:
    """All areas of low friction of a trial.

    Attributes:
        config: the frictions.
        tile: the slippery tile, if there is one.
        patch_centre_m: x and y of the patches, world, m, (P, 2).
        patch_radius_m: their radii, m, (P,).
        risers_m: x of the risers, m, (R,).
    """

    config: SlipConfig
    tile: SlipperyTile | None
    patch_centre_m: Array
    patch_radius_m: Array
    risers_m: Array

    @classmethod
    def draw(
        cls, config: SlipConfig, tile: SlipperyTile | None, terrain: WalkedGround, generator: np.random.Generator
    ) -> "SlipperyGround":
        """The ground of one trial: patches anywhere on the walked area."""
        bounds = terrain.bounds
        low, high = np.array([bounds.xmin, bounds.ymin]), np.array([bounds.xmax, bounds.ymax])
        count = round(config.patches_per_m2 * float(np.prod(high - low)))
        centres = generator.uniform(low, high, (count, 2))
        radii = config.patch_radius_m * generator.uniform(1.0 / 3.0, 1.0, count)
        return cls(config, tile, centres, radii, np.array(terrain.risers_m))

    def friction(self, feet: Array, in_contact_s: Array, nominal: Array) -> Array:
        """The Coulomb coefficient of each foot, the least of all that hold, (n,).

        Args:
            feet: their positions, world, m, (n, 3).
            in_contact_s: time since each was in the air, s, (n,).
            nominal: coefficient on the rest of the ground, (n,).
        """
        result = nominal if self.tile is None else np.where(self.tile.contains(feet), self.tile.friction, nominal)
        config = self.config
        apart = np.linalg.norm(feet[:, None, :2] - self.patch_centre_m, axis=2)
        is_on_patch = (apart <= self.patch_radius_m).any(axis=1)
        beyond = feet[:, :1] - self.risers_m
        is_on_edge = ((beyond >= 0.0) & (beyond < config.edge_m)).any(axis=1)
        has_landed = in_contact_s < config.touch_down_s
        for holds, friction in (
            (is_on_patch, config.patch_friction),
            (is_on_edge, config.edge_friction),
            (has_landed, config.touch_down_friction),
        ):
            result = np.where(holds, np.minimum(result, friction), result)
        return np.asarray(result)
