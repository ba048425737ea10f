# SPDX-License-Identifier: BSD-3-Clause
"""Textures of the "dead leaves" model: opaque discs and polygons of all sizes, each over the earlier ones.

With radii distributed as r^-3 such images have the power spectrum of natural ones and corners at every scale (Lee,
Mumford, Huang, "Occlusion models for natural images", IJCV 41, 2001). The tiles are periodic, without a seam.
"""

from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np

from coclo_vio.values.arrays import Array, ByteImage

_COVERAGE = 3.0  # area of all leaves over that of the tile: exp(-3) = 5 % of the background stays
_SUBPIXEL_BITS = 4


@dataclass(frozen=True, slots=True)
class TextureRecipe:
    """Appearance of a kind of surface.

    Attributes:
        mean: mean reflectance, 0..1.
        contrast: the leaves' reflectances are uniform within ``mean`` plus or minus this.
        smallest_m: radius of the smallest leaves, m.
        largest_m: radius of the largest leaves, m.
        grain: standard deviation of white noise over the tile, reflectance.
        coarseness: factor on the size of its pixels, and so of its tile.
    """

    mean: float
    contrast: float
    smallest_m: float
    largest_m: float
    grain: float = 0.012
    coarseness: float = 1.0


RECIPES: Final[dict[str, TextureRecipe]] = {
    "floor": TextureRecipe(mean=0.42, contrast=0.16, smallest_m=0.010, largest_m=0.25),
    "ramp": TextureRecipe(mean=0.55, contrast=0.18, smallest_m=0.008, largest_m=0.15),
    "tread": TextureRecipe(mean=0.50, contrast=0.18, smallest_m=0.008, largest_m=0.15),
    "riser": TextureRecipe(mean=0.62, contrast=0.16, smallest_m=0.010, largest_m=0.12),
    "side": TextureRecipe(mean=0.58, contrast=0.14, smallest_m=0.012, largest_m=0.20),
    "wall": TextureRecipe(mean=0.66, contrast=0.06, smallest_m=0.040, largest_m=0.60, grain=0.008, coarseness=3.0),
    "poster": TextureRecipe(mean=0.50, contrast=0.34, smallest_m=0.012, largest_m=0.20),
    "clutter": TextureRecipe(mean=0.46, contrast=0.24, smallest_m=0.012, largest_m=0.25),
    "plain": TextureRecipe(mean=0.60, contrast=0.03, smallest_m=0.050, largest_m=0.40, grain=0.006),
}
CONTRAST_FACTOR: Final = {"rich": 1.0, "normal": 0.55, "poor": 0.3}


def dead_leaves(recipe: TextureRecipe, side_px: int, texel_m: float, contrast_factor: float, seed: int) -> ByteImage:
    """A square grey tile (side_px, side_px) of reflectance times 255.

    Args:
        recipe: of the surface.
        side_px: its side, px.
        texel_m: side of a pixel on the surface, m.
        contrast_factor: multiplies the recipe's contrast.
        seed: same seed, same tile.
    """
    rng = np.random.default_rng(seed)
    radii = _radii(rng, recipe, side_px, texel_m)
    contrast = min(recipe.contrast * contrast_factor, recipe.mean - 0.02, 0.98 - recipe.mean)
    greys = np.rint(255.0 * (recipe.mean + contrast * rng.uniform(-1.0, 1.0, len(radii)))).astype(int)
    tile = np.full((side_px, side_px), round(255.0 * recipe.mean), dtype=np.uint8)
    for radius, grey in zip(radii, greys, strict=True):
        _drop_leaf(tile, _outline(rng, radius), rng.uniform(0.0, side_px, 2), int(grey))
    grain = rng.normal(0.0, 255.0 * recipe.grain, tile.shape)
    return np.clip(np.rint(tile + grain), 0, 255).astype(np.uint8)


def _radii(rng: np.random.Generator, recipe: TextureRecipe, side_px: int, texel_m: float) -> Array:
    """Radii in px with density r^-3 between the recipe's limits, enough of them to cover the tile."""
    low = recipe.smallest_m / texel_m
    high = max(min(recipe.largest_m / texel_m, 0.25 * side_px), 1.01 * low)
    mean_square = 2.0 * np.log(high / low) / (low**-2 - high**-2)
    count = int(np.ceil(_COVERAGE * side_px**2 / (np.pi * mean_square)))
    radii: Array = (rng.uniform(0.0, 1.0, count) * (high**-2 - low**-2) + low**-2) ** -0.5
    return radii


def _outline(rng: np.random.Generator, radius: float) -> Array:
    """Corners (n, 2) of a leaf about its centre, px: a disc, or a polygon of 3 to 6 corners."""
    if rng.uniform() < 0.3:
        angles = np.linspace(0.0, 2.0 * np.pi, max(8, int(2.0 * radius**0.5) * 4), endpoint=False)
        reach = np.full(len(angles), radius)
    else:
        corners = int(rng.integers(3, 7))
        angles = 2.0 * np.pi * (np.arange(corners) + rng.uniform(-0.3, 0.3, corners)) / corners
        angles += rng.uniform(0.0, 2.0 * np.pi)
        reach = radius * rng.uniform(0.7, 1.3, corners)
    outline: Array = reach[:, None] * np.column_stack((np.cos(angles), np.sin(angles)))
    return outline


def _drop_leaf(tile: ByteImage, outline: Array, centre: Array, grey: int) -> None:
    """Draw the leaf, and again on the opposite side where it crosses an edge."""
    side, reach = len(tile), float(np.abs(outline).max())
    shifts = [[0.0] + [step * side for step in (-1.0, 1.0) if -reach < c + step * side < side + reach] for c in centre]
    for dx in shifts[0]:
        for dy in shifts[1]:
            corners = np.rint((outline + centre + (dx, dy)) * 2**_SUBPIXEL_BITS).astype(np.int32)
            cv2.fillPoly(tile, [corners], (grey,), cv2.LINE_AA, _SUBPIXEL_BITS)
