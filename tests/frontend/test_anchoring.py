# SPDX-License-Identifier: BSD-3-Clause
from dataclasses import replace

import cv2
import numpy as np
from textured_room import textures

from coclo_vio.frontend.anchoring import Anchoring
from coclo_vio.frontend.config import AnchorConfig, LikenessConfig, PatchConfig
from coclo_vio.frontend.patches import FloatArray, PatchAligner
from coclo_vio.frontend.tracks import LiveTracks

ALIGNER = PatchAligner(PatchConfig())
ANCHORING = Anchoring(ALIGNER, AnchorConfig(), LikenessConfig())
TEXTURE = textures()[0][:400, :400]
GRID = np.stack(np.meshgrid(np.arange(80.0, 340.0, 40.0), np.arange(80.0, 340.0, 40.0)), axis=-1).reshape(-1, 2)

ALL = np.ones(len(GRID), dtype=np.bool_)
NONE = np.zeros(len(GRID), dtype=np.bool_)


def grown(factor: float) -> FloatArray:
    """The texture, larger about its middle, smoothed."""
    columns, rows = np.meshgrid(np.arange(400.0), np.arange(400.0))
    maps = [((value - 200.0) / factor + 200.0).astype(np.float32) for value in (columns, rows)]
    image = cv2.remap(TEXTURE, *maps, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return ALIGNER.smoothed(np.rint(image).astype(np.uint8))


def anchored() -> LiveTracks:
    return LiveTracks.new(0, GRID, ALIGNER.templates(grown(1.0), GRID))


def grown_tracks(factor: float, off_px: float, shapes: float | None = None) -> tuple[LiveTracks, np.ndarray]:
    """The points about where they are in the grown texture, with the shapes that are expected; and where they are."""
    truth = (GRID - 200.0) * factor + 200.0
    stretch = np.tile((shapes or factor) * np.eye(2), (len(GRID), 1, 1))
    return replace(anchored(), left_px=truth + off_px * np.array([0.8, -0.6]), shapes=stretch), truth


def test_a_point_that_crept_away_is_put_back() -> None:
    tracks, truth = grown_tracks(1.1, off_px=0.8)
    corrected, same = ANCHORING.corrected(grown(1.1), tracks, NONE)
    assert same.all()
    assert np.abs(corrected.left_px - truth).max() < 0.05


def test_the_shape_may_be_a_little_other_than_expected() -> None:
    tracks, truth = grown_tracks(1.1, off_px=0.5, shapes=1.06)
    corrected, same = ANCHORING.corrected(grown(1.1), tracks, NONE)
    assert same.all()
    assert np.abs(corrected.left_px - truth).max() < 0.1
    assert np.linalg.det(corrected.shapes).mean() > 1.15 > 1.06**2


def test_a_point_that_looks_different_is_told() -> None:
    image = grown(1.0)
    hidden = np.arange(len(GRID)) % 4 == 0
    for column, row in GRID[hidden].astype(int):
        image[row - 14 : row + 15, column - 14 : column + 15] = ALIGNER.smoothed(
            np.rint(TEXTURE[row - 54 : row - 25, column - 54 : column - 25]).astype(np.uint8)
        )
    _, same = ANCHORING.corrected(image, anchored(), NONE)
    np.testing.assert_array_equal(same, ~hidden)


def test_a_place_too_far_off_is_not_believed() -> None:
    near = Anchoring(ALIGNER, AnchorConfig(correction_px=0.5), LikenessConfig())
    tracks, _ = grown_tracks(1.0, off_px=1.5)
    strange = np.arange(len(GRID)) % 4 == 0
    mixed = replace(tracks, left_px=np.where(strange[:, None], tracks.left_px, GRID))
    _, same = near.corrected(grown(1.0), mixed, NONE)
    np.testing.assert_array_equal(same, ~strange)


def test_a_point_that_has_grown_much_is_anchored_anew() -> None:
    image = grown(1.6)
    inside = (np.abs(GRID - 200.0) < 110.0).all(axis=1)
    tracks, _ = grown_tracks(1.6, off_px=0.2)
    tracks = tracks.select(inside)
    corrected, same = ANCHORING.corrected(image, tracks, NONE[inside])
    assert same.all()
    np.testing.assert_array_equal(corrected.shapes, np.tile(np.eye(2), (len(tracks), 1, 1)))
    expected = ALIGNER.templates(image, corrected.left_px)
    np.testing.assert_array_equal(corrected.templates.values, expected.values)


def test_where_hardly_any_point_looks_the_same_all_are_anchored_where_they_are() -> None:
    """A blurred or very dark frame: better go on from where Lucas-Kanade has them than lose them all."""
    tracks, _ = grown_tracks(1.0, off_px=0.0)
    upside_down = np.ascontiguousarray(grown(1.0)[::-1])
    corrected, same = ANCHORING.corrected(upside_down, tracks, ALL)
    assert same.all()
    np.testing.assert_array_equal(corrected.left_px, tracks.left_px)
    np.testing.assert_array_equal(corrected.templates.values, ALIGNER.templates(upside_down, tracks.left_px).values)


def test_points_that_no_motion_explains_and_that_look_different_are_lost() -> None:
    tracks, _ = grown_tracks(1.0, off_px=0.0)
    _, same = ANCHORING.corrected(np.ascontiguousarray(grown(1.0)[::-1]), tracks, NONE)
    assert same.mean() < 0.1


def test_no_points_are_no_trouble() -> None:
    none = anchored().select(np.zeros(len(GRID), dtype=bool))
    corrected, same = ANCHORING.corrected(grown(1.0), none, NONE[:0])
    assert len(corrected) == len(same) == 0
