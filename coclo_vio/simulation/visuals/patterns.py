# SPDX-License-Identifier: BSD-3-Clause
"""Repeated textures: tiles with one motif, and bricks. Each part looks like its neighbour, as on real floors.

The patterns are periodic over the square texture, so it has no seam.
"""

from typing import Final

import numpy as np

from coclo_vio.simulation.visuals.textures import TextureRecipe, dead_leaves
from coclo_vio.values.arrays import Array, ByteImage

REPEATED: Final = ("floor", "ramp", "tread", "riser", "wall")  # recipes that a pattern replaces
_TILES = 12  # along each side of a texture
_BRICK_COLUMNS, _BRICK_ROWS = 10, 20
_JOINT_SHARE = 0.04  # breadth of a joint, share of a tile
_JOINT_DARKER = 0.12  # reflectance
_TONES = 0.02  # standard deviation of the reflectance from tile to tile


def tiles(recipe: TextureRecipe, side_px: int, texel_m: float, contrast_factor: float, seed: int) -> ByteImage:
    """Square tiles (side_px, side_px) that all show the same motif; arguments as for ``dead_leaves``."""
    motif_px = side_px // _TILES
    motif = dead_leaves(recipe, motif_px, texel_m, contrast_factor, seed).astype(np.float64)
    joint = max(1, round(_JOINT_SHARE * motif_px))
    motif[:joint] -= 255.0 * _JOINT_DARKER * contrast_factor
    motif[:, :joint] -= 255.0 * _JOINT_DARKER * contrast_factor
    tones = np.random.default_rng([seed, 1]).normal(0.0, 255.0 * _TONES * contrast_factor, (_TILES + 1, _TILES + 1))
    repeated = np.tile(motif, (_TILES + 1, _TILES + 1)) + np.kron(tones, np.ones((motif_px, motif_px)))
    return _digitised(repeated[:side_px, :side_px])


def bricks(recipe: TextureRecipe, side_px: int, texel_m: float, contrast_factor: float, seed: int) -> ByteImage:
    """Bricks (side_px, side_px), each row shifted by half a brick; arguments as for ``dead_leaves``."""
    rng = np.random.default_rng([seed, 2])
    rows = np.arange(side_px) * _BRICK_ROWS / side_px
    row = rows.astype(int)
    columns = np.arange(side_px) * _BRICK_COLUMNS / side_px + 0.5 * (row % 2)[:, None]
    column = columns.astype(int) % _BRICK_COLUMNS
    tones = rng.normal(0.0, _TONES, (_BRICK_ROWS, _BRICK_COLUMNS))
    is_joint = ((rows % 1.0) < 2.0 * _JOINT_SHARE)[:, None] | ((columns % 1.0) < _JOINT_SHARE)
    grey = recipe.mean + contrast_factor * np.where(is_joint, -_JOINT_DARKER, tones[row[:, None], column])
    return _digitised(255.0 * (grey + rng.normal(0.0, recipe.grain, grey.shape)))


def _digitised(grey: Array) -> ByteImage:
    return np.asarray(np.clip(np.rint(grey), 0, 255), dtype=np.uint8)
