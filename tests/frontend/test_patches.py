# SPDX-License-Identifier: BSD-3-Clause
import cv2
import numpy as np
import pytest
from textured_room import textures

from coclo_vio.frontend.config import PatchConfig, SimilarityConfig
from coclo_vio.frontend.patches import FREE_PX, PatchAligner, are_similar, median_of

TEXTURE = textures()[0][:400, :400]
ALIGNER = PatchAligner(PatchConfig())
FREE = np.array([FREE_PX, FREE_PX, 0.3, 0.3, 0.3, 0.3])
GRID = np.stack(np.meshgrid(np.arange(60.0, 340.0, 40.0), np.arange(60.0, 340.0, 40.0)), axis=-1).reshape(-1, 2)


def warped(warp: np.ndarray, shift: np.ndarray, gain: float = 1.0, offset: float = 0.0, noise: float = 0.0):
    """The texture, warped so that its point x is at warp (x - 200) + 200 + shift."""
    back = np.linalg.inv(warp)
    columns, rows = np.meshgrid(np.arange(400.0), np.arange(400.0))
    source = np.stack((columns, rows), axis=-1) - 200.0 - shift
    maps = (source @ back.T + 200.0).astype(np.float32)
    image = cv2.remap(TEXTURE, maps[..., 0], maps[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    noisy = gain * image + offset + noise * np.random.default_rng(3).standard_normal(image.shape)
    return np.clip(np.rint(noisy), 0, 255).astype(np.uint8)


def plain(gain: float = 1.0) -> np.ndarray:
    return warped(np.eye(2), np.zeros(2), gain)


def aligned(image: np.ndarray, warp: np.ndarray, shift: np.ndarray, sigmas: np.ndarray, off_px: float = 1.0):
    """The texture's patches, aligned from this far off their true centres, and these."""
    templates = ALIGNER.templates(ALIGNER.smooth_image(plain()), GRID, sigmas)
    truth = (GRID - 200.0) @ warp.T + 200.0 + shift
    nominal = np.tile(np.eye(2), (len(GRID), 1, 1))
    start = truth + off_px * np.array([0.8, -0.6])
    return ALIGNER.align(templates, ALIGNER.smooth_image(image), start, nominal), truth


def test_a_shifted_and_sheared_patch_is_found_to_hundredths() -> None:
    warp, shift = np.array([[1.05, 0.12], [-0.04, 0.96]]), np.array([3.37, -2.61])
    found, truth = aligned(warped(warp, shift, noise=1.0), warp, shift, FREE)
    assert found.is_converged.all()
    assert np.abs(found.centres - truth).max() < 0.05
    assert np.abs(found.centres - truth).mean() < 0.015
    np.testing.assert_allclose(found.warps, np.broadcast_to(warp, found.warps.shape), atol=0.02)
    assert found.correlations.min() > 0.98


def test_a_patch_without_shear_is_biased_on_a_slanted_surface() -> None:
    warp = np.array([[1.0, 0.12], [0.0, 1.0]])
    image = warped(warp, np.zeros(2))
    stiff, truth = aligned(image, warp, np.zeros(2), FREE[:2])
    free, _ = aligned(image, warp, np.zeros(2), FREE[:4])
    assert np.abs(stiff.centres - truth).mean() > 10.0 * np.abs(free.centres - truth).mean()


@pytest.mark.parametrize("bend", [(0.0, -0.0015), (0.0015, 0.0), (0.001, 0.001)])
def test_the_perspective_that_an_affine_warp_lacks_is_taken_off_its_shift(bend: tuple[float, float]) -> None:
    """An image in perspective, as of a floor that comes nearer: its point 200 + u was at u / (1 + bend u) + 200."""
    about, b = np.array([[1.0, 0.0, 200.0], [0.0, 1.0, 200.0], [0.0, 0.0, 1.0]]), np.array(bend)
    homography = about @ np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [*bend, 1.0]]) @ np.linalg.inv(about)
    image = cv2.warpPerspective(
        TEXTURE, homography, (400, 400), flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    )
    grid = GRID[np.abs(GRID - 200.0).max(axis=1) < 100.0]
    steps, growth = grid - 200.0, 1.0 + (grid - 200.0) @ b
    truth = steps / growth[:, None] + 200.0
    warps = (np.eye(2) - (truth - 200.0)[:, :, None] * b) / growth[:, None, None]
    bends = b / growth[:, None]
    templates = ALIGNER.templates(ALIGNER.smooth_image(plain()), grid, FREE)
    found = ALIGNER.align(templates, ALIGNER.smooth_image(image), truth + 0.3, warps)
    shifts = np.matmul(found.warps, ALIGNER.bend_shifts(templates, bends)[:, :, None])[:, :, 0]
    along = b / np.linalg.norm(b)
    before, after = (np.mean((centres - truth) @ along) for centres in (found.centres, found.centres - shifts))
    assert before < -0.02
    assert abs(after) < 0.15 * abs(before)


@pytest.mark.parametrize(("gain", "offset"), [(0.5, 10.0), (0.8, 40.0)])
def test_alignment_is_invariant_to_exposure(gain: float, offset: float) -> None:
    shift = np.array([0.4, 0.7])
    found, truth = aligned(warped(np.eye(2), shift, gain, offset), np.eye(2), shift, FREE)
    assert np.abs(found.centres - truth).max() < 0.05


def test_no_sub_pixel_position_is_preferred() -> None:
    errors = []
    for part in np.linspace(0.0, 0.9, 10):
        shift = np.array([part, -part])
        found, truth = aligned(warped(np.eye(2), shift), np.eye(2), shift, FREE[:4], off_px=0.5)
        errors.append((found.centres - truth).mean(axis=0))
    assert np.abs(errors).max() < 0.01


def test_a_patch_that_is_not_there_is_not_similar() -> None:
    elsewhere = warped(np.eye(2), np.array([120.0, 90.0]))
    found, _ = aligned(elsewhere, np.eye(2), np.zeros(2), FREE)
    assert are_similar(found, SimilarityConfig()).mean() < 0.05


def test_an_occlusion_of_half_a_patch_raises_its_residual() -> None:
    image = plain()
    hidden = np.zeros(len(GRID), dtype=bool)
    hidden[::5] = True
    for column, row in GRID[hidden].astype(int):
        image[row - 12 : row + 13, column + 3 : column + 13] = 60
    found, _ = aligned(image, np.eye(2), np.zeros(2), FREE[:4], off_px=0.3)
    is_similar = are_similar(found, SimilarityConfig())
    assert not is_similar[hidden].any()
    assert is_similar[~hidden].all()


def test_without_texture_the_nominal_centre_and_warp_stay() -> None:
    blank = np.full((400, 400), 90.0, dtype=np.float32)
    templates = ALIGNER.templates(blank, GRID, FREE)
    warps = np.tile(np.array([[1.1, 0.0], [0.0, 0.9]]), (len(GRID), 1, 1))
    found = ALIGNER.align(templates, blank, GRID, warps)
    np.testing.assert_allclose(found.centres, GRID)
    np.testing.assert_allclose(found.warps, warps)
    assert not are_similar(found, SimilarityConfig()).any()


def test_no_patches_give_no_patches() -> None:
    none = ALIGNER.templates(ALIGNER.smooth_image(plain()), np.zeros((0, 2)), FREE)
    found = ALIGNER.align(none, ALIGNER.smooth_image(plain()), np.zeros((0, 2)), np.zeros((0, 2, 2)))
    assert found.centres.shape == (0, 2)
    assert not len(are_similar(found, SimilarityConfig()))


def test_memory_that_is_used_again_changes_no_smooth_image() -> None:
    memory = np.full((400, 400), np.nan, dtype=np.float32)
    for image in (plain(), plain(0.5)):
        np.testing.assert_array_equal(ALIGNER.smooth_image(image, memory), ALIGNER.smooth_image(image))
        np.testing.assert_array_equal(memory, ALIGNER.smooth_image(image))


@pytest.mark.parametrize("count", [1, 2, 3, 10, 151])
def test_the_median_by_ranks_is_the_median(count: int) -> None:
    values = np.random.default_rng(count).normal(size=count)
    assert median_of(values) == np.median(values)
