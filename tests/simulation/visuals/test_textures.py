# SPDX-License-Identifier: BSD-3-Clause
import numpy as np
import pytest

from coclo_vio.simulation.visuals.textures import RECIPES, TextureRecipe, dead_leaves


@pytest.mark.parametrize("name", RECIPES)
def test_a_tile_has_the_reflectance_of_its_recipe(name: str) -> None:
    recipe = RECIPES[name]
    tile = dead_leaves(recipe, 512, 0.002 * recipe.coarseness, 1.0, seed=1) / 255.0
    assert tile.mean() == pytest.approx(recipe.mean, abs=0.5 * recipe.contrast)
    share_within = (np.abs(tile - recipe.mean) < recipe.contrast + 4.0 * recipe.grain + 0.005).mean()
    assert share_within > 0.999
    assert tile.std() > 0.4 * recipe.contrast / np.sqrt(3.0)


def test_a_tile_is_periodic_without_a_seam() -> None:
    recipe = TextureRecipe(mean=0.5, contrast=0.3, smallest_m=0.02, largest_m=0.2, grain=0.0)
    for axis in (0, 1):
        tile = dead_leaves(recipe, 256, 0.004, 1.0, seed=2).astype(float)
        seam = np.abs(np.take(tile, 0, axis) - np.take(tile, -1, axis)).mean()
        inside = np.abs(np.diff(tile, axis=axis)).mean()
        assert seam < 2.0 * inside  # a cut through unrelated leaves differs by more than ten times that


def test_leaves_come_in_all_sizes() -> None:
    """Power-law sizes: averaged over 8 px blocks, the tile keeps much of its contrast; white noise keeps an eighth."""
    tile = dead_leaves(RECIPES["floor"], 512, 0.002, 1.0, seed=3).astype(float)
    blocks = tile.reshape(64, 8, 64, 8).mean(axis=(1, 3))
    assert 0.4 < blocks.std() / tile.std() < 0.95


def test_same_seed_same_tile() -> None:
    first, again, other = (dead_leaves(RECIPES["floor"], 128, 0.004, 1.0, seed) for seed in (4, 4, 5))
    np.testing.assert_array_equal(first, again)
    assert (first != other).mean() > 0.5
