# SPDX-License-Identifier: BSD-3-Clause
import numpy as np
import pytest
from textured_room import BASELINE_M, FOCAL_PX, HEIGHT, WIDTH, Room, rig

from coclo_vio.frontend.config import DetectionConfig, PairConfig, PatchConfig, SimilarityConfig, StereoConfig
from coclo_vio.frontend.detection import CornerDetector
from coclo_vio.frontend.pair_calibration import PairCalibration
from coclo_vio.frontend.patches import PatchAligner, SmoothPair
from coclo_vio.frontend.rectification import RectifiedPair, Rectifier
from coclo_vio.frontend.stereo_matching import StereoMatcher
from coclo_vio.frontend.tracks import ActiveTracks
from coclo_vio.values.measurements import StereoFrame

ALIGNER = PatchAligner(PatchConfig())
RIG = Rectifier(rig()).rig
EVERYWHERE = np.full((HEIGHT, WIDTH), 255, dtype=np.uint8)


def matched(left: np.ndarray, right: np.ndarray, points: np.ndarray | None = None, **config: object) -> ActiveTracks:
    """New points of the left image, or these points, matched in the right one."""
    smooth = SmoothPair(ALIGNER.smooth_image(left), ALIGNER.smooth_image(right))
    if points is None:
        points = CornerDetector(DetectionConfig(), EVERYWHERE).find(left, np.zeros((0, 2)))
    tracks = ActiveTracks.new(0, points, ALIGNER.templates(smooth.left, points, np.ones(6)))
    stereo, pair = StereoConfig.parse(config, "stereo"), PairCalibration(RIG, PairConfig())
    matcher = StereoMatcher(RIG, EVERYWHERE, ALIGNER, stereo, SimilarityConfig(), pair)
    return matcher.match(RectifiedPair(left, right), smooth, tracks)


@pytest.fixture(scope="module")
def first(walked: tuple[list[StereoFrame], np.ndarray]) -> StereoFrame:
    return walked[0][0]


def errors(room: Room, camera: np.ndarray, tracks: ActiveTracks) -> np.ndarray:
    """Measured minus true disparity of the matched points, px."""
    known = tracks.select(tracks.has_right)
    return known.disparity - FOCAL_PX * BASELINE_M / room.depth(camera, known.left_px)


def test_disparity_is_true_to_depth_on_floor_and_wall(room: Room, walked: tuple[list[StereoFrame], np.ndarray]) -> None:
    frames, cameras = walked
    tracks = matched(frames[0].left, frames[0].right)
    error = errors(room, cameras[0], tracks)
    assert len(error) > 130
    assert (np.abs(error) < 0.1).mean() > 0.95
    assert abs(np.median(error)) < 0.01
    rows = (tracks.left_px - tracks.right_px)[tracks.has_right, 1]
    assert np.abs(rows).max() < 0.2


def test_the_slant_is_that_of_the_floor(first: StereoFrame) -> None:
    """Disparity on a level floor grows by cos(tilt) B / h per row."""
    tracks = matched(first.left, first.right)
    on_floor = tracks.has_right & (tracks.left_px[:, 1] > 250)
    assert on_floor.sum() > 20
    expected = [0.0, np.cos(0.26) * BASELINE_M / 0.4]
    np.testing.assert_allclose(np.median(tracks.slants[on_floor], axis=0), expected, atol=0.005)


@pytest.mark.parametrize(("gain", "offset"), [(0.6, 10.0), (1.2, -20.0)])
def test_matching_is_invariant_to_the_exposure_of_the_right_camera(
    room: Room, walked: tuple[list[StereoFrame], np.ndarray], gain: float, offset: float
) -> None:
    frames, cameras = walked
    right = np.clip(np.rint(gain * frames[0].right + offset), 0, 255).astype(np.uint8)
    error = errors(room, cameras[0], matched(frames[0].left, right))
    assert len(error) > 120
    assert (np.abs(error) < 0.1).mean() > 0.95


def test_a_repeated_pattern_is_not_matched() -> None:
    columns, rows = np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT))
    board = np.where((columns // 12 + rows // 12) % 2 == 0, 60, 180).astype(np.uint8)
    points = np.stack(np.meshgrid(np.arange(156.0, 400.0, 36.0), np.arange(60.0, 300.0, 36.0)), axis=-1).reshape(-1, 2)
    assert not matched(board, np.roll(board, -7, axis=1), points).has_right.any()


def test_matches_in_other_rows_are_rejected(first: StereoFrame) -> None:
    assert matched(first.left, np.roll(first.right, 1, axis=0)).has_right.mean() > 0.8
    assert matched(first.left, np.roll(first.right, 1, axis=0), max_row_difference_px=0.8).has_right.mean() < 0.05
    assert matched(first.left, np.roll(first.right, 4, axis=0)).has_right.mean() < 0.05


def test_disparities_out_of_bounds_are_rejected(first: StereoFrame) -> None:
    known = matched(first.left, first.right)
    near = matched(first.left, first.right, known.left_px, min_depth_m=1.0)
    assert np.nanmax(known.disparity) > 20.0
    assert np.nanmax(near.disparity) < FOCAL_PX * BASELINE_M / 1.0
    far = matched(first.left, first.right, known.left_px, min_disparity_px=8.0)
    assert np.nanmin(known.disparity) < 7.0
    assert np.nanmin(far.disparity) > 8.0


def test_points_hidden_from_the_right_camera_are_not_matched(first: StereoFrame) -> None:
    covered = first.right.copy()
    covered[:, : WIDTH // 2] = 0
    tracks = matched(first.left, covered)
    hidden = tracks.left_px[:, 0] < WIDTH // 2 - 25
    assert not tracks.has_right[hidden].any()
    assert tracks.has_right[tracks.left_px[:, 0] > WIDTH // 2 + 50].mean() > 0.85


def test_a_point_of_known_disparity_is_searched_there(first: StereoFrame) -> None:
    known = matched(first.left, first.right)
    known = known.select(known.has_right)
    smooth = SmoothPair(ALIGNER.smooth_image(first.left), ALIGNER.smooth_image(first.right))
    stereo, pair = StereoConfig(min_block_correlation=0.99), PairCalibration(RIG, PairConfig())
    matcher = StereoMatcher(RIG, EVERYWHERE, ALIGNER, stereo, SimilarityConfig(), pair)
    again = matcher.match(RectifiedPair(first.left, first.right), smooth, known)
    assert again.has_right.mean() > 0.95
    np.testing.assert_allclose(again.disparity[again.has_right], known.disparity[again.has_right], atol=0.05)


def test_no_points_give_no_points(first: StereoFrame) -> None:
    assert len(matched(first.left, first.right, np.zeros((0, 2)))) == 0
