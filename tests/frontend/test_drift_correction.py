# SPDX-License-Identifier: BSD-3-Clause
from dataclasses import replace

import cv2
import numpy as np
from textured_room import textures

from coclo_vio.frontend.config import DriftConfig, PatchConfig, SimilarityConfig
from coclo_vio.frontend.drift_correction import DriftCorrector
from coclo_vio.frontend.patches import PatchAligner
from coclo_vio.frontend.tracks import ActiveTracks
from coclo_vio.values.arrays import FloatImage

ALIGNER = PatchAligner(PatchConfig())
CORRECTOR = DriftCorrector(ALIGNER, DriftConfig(), SimilarityConfig())
TEXTURE = textures()[0][:400, :400]
GRID = np.stack(np.meshgrid(np.arange(80.0, 340.0, 40.0), np.arange(80.0, 340.0, 40.0)), axis=-1).reshape(-1, 2)

ALL = np.ones(len(GRID), dtype=np.bool_)
NONE = np.zeros(len(GRID), dtype=np.bool_)


def grown(factor: float) -> FloatImage:
    """The texture, enlarged about its centre, smoothed."""
    columns, rows = np.meshgrid(np.arange(400.0), np.arange(400.0))
    maps = [((value - 200.0) / factor + 200.0).astype(np.float32) for value in (columns, rows)]
    image = cv2.remap(TEXTURE, *maps, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return ALIGNER.smooth_image(np.rint(image).astype(np.uint8))


def new_tracks() -> ActiveTracks:
    return ActiveTracks.new(0, GRID, CORRECTOR.templates(grown(1.0), GRID))


def grown_tracks(factor: float, off_px: float, warp: float | None = None) -> tuple[ActiveTracks, np.ndarray]:
    """The points near their positions in the enlarged texture, with the predicted warps, and their true positions."""
    truth = (GRID - 200.0) * factor + 200.0
    warps = np.tile((warp or factor) * np.eye(2), (len(GRID), 1, 1))
    return replace(new_tracks(), left_px=truth + off_px * np.array([0.8, -0.6]), warps=warps), truth


def test_a_drifted_point_is_corrected() -> None:
    tracks, truth = grown_tracks(1.1, off_px=0.8)
    corrected, is_similar = CORRECTOR.correct(grown(1.1), tracks, NONE)
    assert is_similar.all()
    assert np.abs(corrected.left_px - truth).max() < 0.05


def test_the_warp_may_differ_a_little_from_the_prediction() -> None:
    tracks, truth = grown_tracks(1.1, off_px=0.5, warp=1.06)
    corrected, is_similar = CORRECTOR.correct(grown(1.1), tracks, NONE)
    assert is_similar.all()
    assert np.abs(corrected.left_px - truth).max() < 0.1
    assert np.linalg.det(corrected.warps).mean() > 1.15 > 1.06**2


def test_an_occluded_point_is_dissimilar() -> None:
    image = grown(1.0)
    hidden = np.arange(len(GRID)) % 4 == 0
    for column, row in GRID[hidden].astype(int):
        image[row - 14 : row + 15, column - 14 : column + 15] = ALIGNER.smooth_image(
            np.rint(TEXTURE[row - 54 : row - 25, column - 54 : column - 25]).astype(np.uint8)
        )
    _, is_similar = CORRECTOR.correct(image, new_tracks(), NONE)
    np.testing.assert_array_equal(is_similar, ~hidden)


def test_a_correction_beyond_the_limit_is_rejected() -> None:
    strict = DriftCorrector(ALIGNER, DriftConfig(max_correction_px=0.5), SimilarityConfig())
    tracks, _ = grown_tracks(1.0, off_px=1.5)
    is_far = np.arange(len(GRID)) % 4 == 0
    mixed = replace(tracks, left_px=np.where(is_far[:, None], tracks.left_px, GRID))
    _, is_similar = strict.correct(grown(1.0), mixed, NONE)
    np.testing.assert_array_equal(is_similar, ~is_far)


def test_a_point_that_has_grown_much_gets_a_new_template() -> None:
    image = grown(1.6)
    inside = (np.abs(GRID - 200.0) < 110.0).all(axis=1)
    tracks, _ = grown_tracks(1.6, off_px=0.2)
    tracks = tracks.select(inside)
    corrected, is_similar = CORRECTOR.correct(image, tracks, NONE[inside])
    assert is_similar.all()
    np.testing.assert_array_equal(corrected.warps, np.tile(np.eye(2), (len(tracks), 1, 1)))
    expected = CORRECTOR.templates(image, corrected.left_px)
    np.testing.assert_array_equal(corrected.templates.weighted, expected.weighted)


def test_if_most_points_are_dissimilar_all_get_new_templates_where_they_are() -> None:
    """A blurred or very dark frame: the positions from Lucas-Kanade are kept instead of losing all tracks."""
    tracks, _ = grown_tracks(1.0, off_px=0.0)
    upside_down = np.ascontiguousarray(grown(1.0)[::-1])
    corrected, is_similar = CORRECTOR.correct(upside_down, tracks, ALL)
    assert is_similar.all()
    np.testing.assert_array_equal(corrected.left_px, tracks.left_px)
    np.testing.assert_array_equal(
        corrected.templates.weighted, CORRECTOR.templates(upside_down, tracks.left_px).weighted
    )


def test_dissimilar_points_without_a_confirmed_motion_are_rejected() -> None:
    tracks, _ = grown_tracks(1.0, off_px=0.0)
    _, is_similar = CORRECTOR.correct(np.ascontiguousarray(grown(1.0)[::-1]), tracks, NONE)
    assert is_similar.mean() < 0.1


def test_no_points_give_no_points() -> None:
    none = new_tracks().select(np.zeros(len(GRID), dtype=bool))
    corrected, is_similar = CORRECTOR.correct(grown(1.0), none, NONE[:0])
    assert len(corrected) == len(is_similar) == 0


def test_a_template_is_outdated_by_the_singular_values_of_its_warp() -> None:
    warps = np.random.default_rng(4).normal(0.0, 1.0, (1000, 2, 2))
    scales = np.linalg.svd(warps, compute_uv=False)
    is_stretched = CORRECTOR._is_stretched(warps)
    np.testing.assert_array_equal(is_stretched, (scales[:, 0] > 1.5) | (scales[:, 1] < 1.0 / 1.5))
    assert 0 < is_stretched.sum() < 1000
