# SPDX-License-Identifier: BSD-3-Clause
from dataclasses import replace

import numpy as np
import pytest
from textured_room import rig

from coclo_vio.frontend.config import PatchConfig
from coclo_vio.frontend.patches import PatchAligner
from coclo_vio.frontend.prediction import PointPredictor, predicted_warps
from coclo_vio.frontend.rectification import Rectifier
from coclo_vio.frontend.tracks import ActiveTracks
from coclo_vio.geometry import se3

RIG = Rectifier(rig()).rig
MOTION = se3.exp(np.array([0.02, -0.03, 0.05, 0.04, -0.02, 0.15]))  # T_previous_current
LEFT_PX = np.array([[100.0, 80.0], [240.0, 180.0], [400.0, 300.0], [60.0, 330.0]])
DISPARITY = np.array([6.0, 9.0, 20.0, 15.0])
SLANTS = np.array([[0.0, 0.0], [0.02, 0.1], [-0.05, 0.14], [0.0, 0.15]])


def tracks(disparity: np.ndarray = DISPARITY) -> ActiveTracks:
    ids = np.arange(len(LEFT_PX), dtype=np.int64)
    right_px = LEFT_PX - np.column_stack((disparity, np.zeros(len(ids))))
    templates = PatchAligner(PatchConfig()).templates(np.zeros((4, 4), np.float32), np.zeros((0, 2)), np.ones(6))
    return replace(ActiveTracks.new(0, LEFT_PX, templates), right_px=right_px, slants=SLANTS)


def test_pixels_are_predicted_from_depth_and_motion() -> None:
    pixels, disparity = PointPredictor(RIG, tracks()).pixels(MOTION)
    points = se3.apply(se3.inverse(MOTION), RIG.points(LEFT_PX, DISPARITY))
    expected, expected_disparity = RIG.pixels(points)
    np.testing.assert_allclose(pixels, expected)
    np.testing.assert_allclose(disparity, expected_disparity)


def test_without_motion_nothing_moves() -> None:
    pixels, disparity = PointPredictor(RIG, tracks()).pixels(np.eye(4))
    np.testing.assert_allclose(pixels, LEFT_PX)
    np.testing.assert_allclose(disparity, DISPARITY)
    warps, bends = predicted_warps(RIG, tracks(), np.eye(4))
    np.testing.assert_allclose(warps, np.tile(np.eye(2), (4, 1, 1)), atol=1e-12)
    np.testing.assert_array_equal(bends, 0.0)


def test_a_point_of_unknown_depth_moves_with_the_median_and_stays_unknown() -> None:
    unknown = DISPARITY.copy()
    unknown[0] = np.nan
    pixels, disparity = PointPredictor(RIG, tracks(unknown)).pixels(MOTION)
    as_median = DISPARITY.copy()
    as_median[0] = np.median(DISPARITY[1:])
    np.testing.assert_allclose(pixels[0], PointPredictor(RIG, tracks(as_median)).pixels(MOTION)[0][0])
    assert np.isnan(disparity[0])


def test_a_point_that_would_be_behind_the_camera_keeps_its_pixel() -> None:
    ahead = se3.transform(np.eye(3), np.array([0.0, 0.0, 50.0]))
    pixels, disparity = PointPredictor(RIG, tracks()).pixels(ahead)
    np.testing.assert_allclose(pixels, LEFT_PX)
    assert np.isfinite(disparity).all()
    assert all(np.isfinite(each).all() for each in predicted_warps(RIG, tracks(), ahead))


def moved(offset: np.ndarray) -> np.ndarray:
    """Pixels of the neighbours of the points, on the same planes, after the motion."""
    points = RIG.points(LEFT_PX + offset, DISPARITY + SLANTS @ offset)
    return RIG.pixels(se3.apply(se3.inverse(MOTION), points))[0]


def test_the_warp_is_the_derivative_of_the_motion_of_the_plane() -> None:
    step = 1e-4
    columns = [(moved(step * axis) - moved(-step * axis)) / (2.0 * step) for axis in np.eye(2)]
    np.testing.assert_allclose(predicted_warps(RIG, tracks(), MOTION)[0], np.stack(columns, axis=2), atol=1e-7)


@pytest.mark.parametrize("offset", [(8.0, 0.0), (0.0, -8.0), (5.0, 6.0)])
def test_warp_and_bend_are_the_whole_motion_of_the_plane(offset: tuple[float, float]) -> None:
    warps, bends = predicted_warps(RIG, tracks(), MOTION)
    step = np.array(offset)
    expected = moved(np.zeros(2)) + warps @ step / (1.0 + bends @ step)[:, None]
    np.testing.assert_allclose(moved(step), expected, atol=1e-9)
