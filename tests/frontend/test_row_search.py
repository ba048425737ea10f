# SPDX-License-Identifier: BSD-3-Clause
import numpy as np
import pytest
from textured_room import textures

from coclo_vio.frontend import row_search
from coclo_vio.frontend.row_search import RowSearch, found_by_opencv
from coclo_vio.values.arrays import ByteImage

TEXTURE = np.rint(textures()[0][:120, :400]).astype(np.uint8)
SEARCH = RowSearch(half_px=8, max_disparity=60, min_correlation=0.6, uniqueness_ratio=0.98)


def shifted(disparity: int, rows: int = 0) -> ByteImage:
    return np.ascontiguousarray(np.roll(TEXTURE, (rows, -disparity), axis=(0, 1)))


def pixels(count: int = 400) -> np.ndarray:
    """Points inside the image and beyond its border, (N, 2)."""
    return np.random.default_rng(3).uniform((-20.0, -20.0), (420.0, 140.0), (count, 2))


def both(search: RowSearch, left: ByteImage, right: ByteImage) -> tuple[np.ndarray, np.ndarray]:
    """Disparities as they are found, and by the readable form."""
    points = pixels()
    readable = [found_by_opencv(search, left, right, *pixel) for pixel in np.rint(points).astype(int).tolist()]
    return search.disparities(left, right, points), np.array(readable)


@pytest.mark.parametrize("disparity", [0, 7, 59])
def test_the_disparity_is_found(disparity: int) -> None:
    points = np.stack(np.meshgrid(np.arange(100.0, 300.0, 20.0), np.arange(20.0, 100.0, 15.0)), axis=-1).reshape(-1, 2)
    found = SEARCH.disparities(TEXTURE, shifted(disparity, rows=1), points)
    assert np.isfinite(found).mean() > 0.8
    np.testing.assert_array_equal(found[np.isfinite(found)], disparity)


@pytest.mark.parametrize("block_px", [5, 17, 31])
def test_the_kernel_finds_what_opencv_finds(block_px: int) -> None:
    search = RowSearch(block_px // 2, 60, 0.6, 0.98)
    rng = np.random.default_rng(0)
    noisy = np.clip(shifted(21) + rng.normal(0.0, 12.0, TEXTURE.shape), 0, 255).astype(np.uint8)
    found, expected = both(search, TEXTURE, noisy)
    assert 0.1 < np.isfinite(expected).mean() < 0.95
    np.testing.assert_array_equal(found, expected)


def test_a_blank_block_or_a_blank_row_is_not_matched() -> None:
    blank = np.full_like(TEXTURE, 200)
    for left, right in ((blank, TEXTURE), (TEXTURE, blank), (blank, blank)):
        found, expected = both(SEARCH, left, right)
        assert np.isnan(found[pixels()[:, 0] > 30]).all()
        np.testing.assert_array_equal(found, expected)


def test_a_repeated_pattern_is_ambiguous() -> None:
    pattern = np.tile(TEXTURE[:, :23], (1, 18))[:, :400].copy()
    found, _ = both(SEARCH, pattern, pattern)
    assert np.isnan(found[pixels()[:, 0] > 100]).mean() > 0.95


def test_the_brightest_images_are_summed_without_rounding(monkeypatch: pytest.MonkeyPatch) -> None:
    """Sums of the widest block stay whole numbers that float32 holds: no other sums than those in float64."""
    search = RowSearch(15, 40, 0.1, 0.999)
    left = np.where(np.random.default_rng(1).random(TEXTURE.shape) < 0.97, 255, 250).astype(np.uint8)
    expected = search.disparities(left, np.roll(left, -9, axis=1), np.array([[200.0, 60.0]]))
    monkeypatch.setattr(row_search, "IS_COMPILED", False)
    np.testing.assert_array_equal(
        search.disparities(left, np.roll(left, -9, axis=1), np.array([[200.0, 60.0]])), expected
    )
    assert expected[0] == 9.0
