# SPDX-License-Identifier: BSD-3-Clause
import cv2
import numpy as np
import pytest

from coclo_vio.frontend import patch_kernels, patch_sampling
from coclo_vio.geometry.compiled import IS_COMPILED

ROWS, COLUMNS = 120, 160
IMAGE = np.random.default_rng(0).uniform(0.0, 255.0, (ROWS, COLUMNS)).astype(np.float32)
STEPS = np.stack(np.meshgrid(np.arange(-10.0, 11.0, 2.0), np.arange(-10.0, 11.0, 2.0))).reshape(2, -1)
STEPS = STEPS.astype(np.float32)
CPU_FMA3 = 12  # of OpenCV's enumeration, which its Python module does not hold
HAS_FUSED_PRODUCTS = cv2.checkHardwareSupport(CPU_FMA3)
ROUNDING = 0.0 if HAS_FUSED_PRODUCTS else 1e-3  # grey levels

is_compiled = pytest.mark.skipif(not IS_COMPILED, reason="numba is not there: only the readable form is used")


def centres(where: str, count: int = 400) -> np.ndarray:
    """Centres inside the image, at its borders, or far outside, (N, 2)."""
    low, high = {"inside": (20.0, 100.0), "at the border": (-15.0, 175.0), "outside": (-1e5, 1e5)}[where]
    return np.random.default_rng(1).uniform(low, high, (count, 2))


def warps(count: int = 400) -> np.ndarray:
    return np.eye(2) + np.random.default_rng(2).normal(0.0, 0.2, (count, 2, 2))


@is_compiled
@pytest.mark.parametrize("where", ["inside", "at the border", "outside"])
def test_compiled_and_readable_form_have_the_same_derivatives(where: str) -> None:
    arguments = (IMAGE, centres(where), STEPS)
    found, expected = (
        patch_kernels.patches_and_shifts(*arguments),
        patch_sampling.patches_and_shifts_by_opencv(*arguments),
    )
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_allclose(one, other, rtol=0.0, atol=ROUNDING)


def test_a_plane_of_brightness_is_interpolated_without_error() -> None:
    columns, rows = np.meshgrid(np.arange(COLUMNS, dtype=np.float32), np.arange(ROWS, dtype=np.float32))
    image, at, warp = 0.5 * columns + 0.25 * rows, centres("inside"), warps()
    at[:, 1] = np.clip(at[:, 1], 40.0, 80.0)
    at[:, 0] = np.clip(at[:, 0], 40.0, 120.0)
    places = warp @ STEPS + at[:, :, None]
    expected = 0.5 * places[:, 0] + 0.25 * places[:, 1]
    np.testing.assert_allclose(patch_sampling.warped_patches(image, at, warp, STEPS), expected, atol=1e-4)
    brightness, shifts = patch_sampling.patches_and_shifts(image, at, STEPS)
    np.testing.assert_allclose(brightness, 0.5 * (at[:, :1] + STEPS[0]) + 0.25 * (at[:, 1:] + STEPS[1]), atol=1e-4)
    np.testing.assert_allclose(shifts, np.broadcast_to([[0.5], [0.25]], shifts.shape), atol=1e-4)


def test_no_patches_are_sampled_at_no_centres() -> None:
    nothing = np.zeros((0, 2))
    assert patch_sampling.warped_patches(IMAGE, nothing, np.zeros((0, 2, 2)), STEPS).shape == (0, STEPS.shape[1])
    brightness, shifts = patch_sampling.patches_and_shifts(IMAGE, nothing, STEPS)
    assert (brightness.shape, shifts.shape) == ((0, STEPS.shape[1]), (0, 2, STEPS.shape[1]))


@pytest.mark.parametrize("pixels", [1, 7, 121, 500])
def test_patches_are_compared_whatever_their_gain_and_offset(pixels: int) -> None:
    rng = np.random.default_rng(5)
    template = rng.standard_normal((50, pixels)).astype(np.float32)
    weights = np.full(pixels, 1.0 / pixels, dtype=np.float32)
    template -= (template @ weights)[:, None]
    weighted = template * weights
    variances = np.maximum((weighted * template).sum(axis=1), patch_kernels.MIN_VARIANCE)
    _, gains, correlations, residuals = patch_sampling.compared(2.0 * template + 50.0, weights, weighted, variances)
    if pixels > 1:
        np.testing.assert_allclose(gains, 2.0, rtol=0.02)
        np.testing.assert_allclose(correlations, 1.0, rtol=0.02)
    assert (residuals < 0.5).all()
