# SPDX-License-Identifier: BSD-3-Clause
"""The compiled iterations against the readable ones."""

import cv2
import numpy as np
import pytest

from coclo_vio.frontend import patch_alignment
from coclo_vio.frontend.config import PatchConfig
from coclo_vio.frontend.patch_alignment import Iterations, Templates
from coclo_vio.frontend.patches import FREE_PX, PatchAligner
from coclo_vio.geometry.compiled import IS_COMPILED

ROWS, COLUMNS, COUNT = 200, 240, 300
CPU_FMA3 = 12  # of OpenCV's enumeration, which its Python module does not hold
ROUNDING = 0.0 if cv2.checkHardwareSupport(CPU_FMA3) else 1e-3
SIGMAS = np.array([FREE_PX, FREE_PX, 0.3, 0.3, 0.3, 0.3])

is_compiled = pytest.mark.skipif(not IS_COMPILED, reason="numba is not there: only the readable form is used")


def texture(seed: int) -> np.ndarray:
    """A smooth random image, (rows, columns), uint8."""
    noise = np.random.default_rng(seed).uniform(0.0, 255.0, (ROWS, COLUMNS)).astype(np.float32)
    smooth = cv2.GaussianBlur(noise, (0, 0), 2.5)
    return np.clip(128.0 + 8.0 * (smooth - smooth.mean()), 0, 255).astype(np.uint8)


def both(aligner: PatchAligner, count: int, where: str, image: np.ndarray) -> list[tuple[np.ndarray, ...]]:
    """Parameters, correlations, residuals and convergence, (N, ...), by the compiled form and by the readable one."""
    low, high = {"inside": (30.0, 170.0), "at the border": (-15.0, 255.0), "outside": (-1e5, 1e5)}[where]
    rng = np.random.default_rng(1)
    centres = rng.uniform(low, high, (COUNT, 2))
    templates = aligner.templates(aligner.smooth_image(texture(0)), centres, SIGMAS[:count])
    warps = np.eye(2) + rng.normal(0.0, 0.05, (COUNT, 2, 2))
    start = np.zeros((COUNT, 6))
    start[:, :count] = rng.normal(0.0, 0.5, (COUNT, 6))[:, :count] * np.array([1.0, 1.0, 0.1, 0.1, 0.1, 0.1])[:count]
    window, iterations = (aligner._steps, aligner._weights), Iterations(8, 0.05)
    results = []
    for align in (patch_alignment.align, patch_alignment.aligned_by_numpy):
        parameters = start.copy()
        places = (centres, warps)
        results.append(
            (parameters, *align(templates, aligner.smooth_image(image), places, parameters, window, iterations))
        )
    return results


@is_compiled
@pytest.mark.parametrize("count", [2, 4, 6])
@pytest.mark.parametrize("where", ["inside", "at the border", "outside"])
def test_compiled_and_readable_form_align_alike(count: int, where: str) -> None:
    """With patches that converge at once, late or never, and gains beyond the limits."""
    images = texture(0), (0.1 * texture(0)).astype(np.uint8), texture(7), np.full((ROWS, COLUMNS), 90, np.uint8)
    for image in images:
        compiled, readable = both(PatchAligner(PatchConfig()), count, where, image)
        for one, other in zip(compiled, readable, strict=True):
            np.testing.assert_allclose(one, other, rtol=1e-12, atol=1e-12 + ROUNDING)
    is_converged = both(PatchAligner(PatchConfig()), count, "inside", images[0])[0][-1]
    assert is_converged.mean() > 0.5


@is_compiled
@pytest.mark.parametrize("window_px", [7, 13])
def test_the_compiled_form_takes_patches_of_other_sizes(window_px: int) -> None:
    aligner = PatchAligner(PatchConfig(window_px=window_px, weight_sigma_px=4.0))
    compiled, readable = both(aligner, 4, "inside", texture(0))
    for one, other in zip(compiled, readable, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-12, atol=1e-12 + ROUNDING)


@is_compiled
def test_a_place_that_is_no_number_reads_no_memory_outside_the_image() -> None:
    aligner = PatchAligner(PatchConfig())
    image = aligner.smooth_image(texture(0))
    templates = aligner.templates(image, np.array([[50.0, 50.0]]), SIGMAS)
    parameters, places = np.zeros((1, 6)), (np.full((1, 2), np.nan), np.eye(2)[None])
    window = (aligner._steps, aligner._weights)
    correlation, *_ = patch_alignment.align(templates, image, places, parameters, window, Iterations(1, 0.05))
    assert np.isfinite(correlation).all()


def test_templates_are_chosen_joined_and_replaced() -> None:
    aligner = PatchAligner(PatchConfig())
    image, centres = aligner.smooth_image(texture(0)), np.random.default_rng(2).uniform(40.0, 160.0, (20, 2))
    every = aligner.templates(image, centres, SIGMAS)
    is_even = np.arange(20) % 2 == 0
    even, odd = every.select(is_even), every.select(~is_even)
    for templates, expected in (
        (even, aligner.templates(image, centres[is_even], SIGMAS)),
        (even.joined(odd), every.select(np.argsort(~is_even, kind="stable"))),
        (every.replaced(is_even, odd), every.select(np.arange(20) // 2 * 2 + 1)),
    ):
        _assert_equal(templates, expected)


def _assert_equal(one: Templates, other: Templates) -> None:
    for name in ("weighted", "variances", "gradients", "inverses", "prior"):
        np.testing.assert_allclose(getattr(one, name), getattr(other, name), rtol=1e-4, atol=1e-4)
