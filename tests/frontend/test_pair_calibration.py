# SPDX-License-Identifier: BSD-3-Clause
from dataclasses import replace

import numpy as np
import pytest
from textured_room import FOCAL_PX, HEIGHT, WIDTH, rig

from coclo_vio.frontend.config import FrontendConfig, PairConfig
from coclo_vio.frontend.frontend import StereoFrontend
from coclo_vio.frontend.pair_calibration import PairCalibration
from coclo_vio.frontend.pair_rows import row_difference
from coclo_vio.geometry import se3, so3
from coclo_vio.values.arrays import Array
from coclo_vio.values.calibration import RectifiedStereo
from coclo_vio.values.measurements import StereoFrame

RIG = RectifiedStereo((FOCAL_PX, FOCAL_PX), (WIDTH / 2, HEIGHT / 2), 0.1, np.eye(4))


def matches(rng: np.random.Generator, turn: Array, moved: Array, count: int = 3000) -> tuple[Array, ...]:
    """Pixels of points in the left image, in the right one of a camera that is turned and moved, and in that of RIG."""
    left_px = rng.uniform((0.0, 0.0), (WIDTH, HEIGHT), (count, 2))
    points = RIG.points(left_px, rng.uniform(2.0, 30.0, count))
    right = se3.transform(so3.exp(turn), np.array([RIG.baseline_m, 0.0, 0.0]) + moved)

    def seen(T_left_right: Array) -> Array:
        x, y, z = se3.apply(se3.inverse(T_left_right), points).T
        return np.column_stack((x / z, y / z)) * FOCAL_PX + RIG.principal_point_px

    return left_px, seen(right), seen(se3.transform(np.eye(3), np.array([RIG.baseline_m, 0.0, 0.0])))


def test_roll_and_displacement_are_found_by_rows_and_corrected_in_columns() -> None:
    rng, calibration = np.random.default_rng(1), PairCalibration(RIG, PairConfig())
    left_px, right_px, exact_px = matches(rng, np.array([0.0, 0.0, 6e-4]), np.array([0.0, 2e-4, -4e-4]))
    noisy = right_px + rng.normal(scale=0.15, size=right_px.shape)
    for at in range(0, len(left_px), 50):
        calibration.learn(left_px[at : at + 50], noisy[at : at + 50])
    assert calibration.errors[2] == pytest.approx(6e-4, abs=5e-5)
    assert np.abs(calibration.errors[3:5] - (2e-3, -4e-3)).max() < 2.5e-3
    before, after = (each - exact_px for each in (right_px, calibration.corrected(left_px, right_px)))
    assert np.abs(before).mean() > 0.05
    assert np.abs(after).mean() < 0.2 * np.abs(before).mean()


def test_a_turn_about_the_vertical_is_found_by_rows_but_moves_no_column() -> None:
    """The principal point may make up for it: ``disparity_offset`` finds what is left."""
    calibration = PairCalibration(RIG, PairConfig())
    left_px, right_px, _ = matches(np.random.default_rng(2), np.array([0.0, 2e-3, 0.0]), np.zeros(3))
    calibration.learn(left_px, right_px)
    assert calibration.errors[1] == pytest.approx(2e-3, abs=2e-4)
    corrected = calibration.corrected(left_px, right_px)
    np.testing.assert_allclose(corrected[:, 0], right_px[:, 0], atol=0.05)
    np.testing.assert_allclose(corrected[:, 1], left_px[:, 1], atol=0.05)


def test_a_point_without_a_match_stays_without_one() -> None:
    calibration = PairCalibration(RIG, PairConfig())
    calibration.learn(*matches(np.random.default_rng(3), np.array([0.0, 0.0, 1e-3]), np.zeros(3))[:2])
    corrected = calibration.corrected(np.array([[10.0, 20.0]]), np.full((1, 2), np.nan))
    assert np.isnan(corrected).all()


def test_the_front_end_finds_a_roll_that_its_calibration_lacks(walked: tuple[list[StereoFrame], Array]) -> None:
    """The images are of a pair without it; the calibration is of one with it, so the estimate is its negative."""
    exact, roll = rig(), 1e-3
    turned = exact.T_body_right_camera @ se3.transform(so3.exp(np.array([0.0, 0.0, roll])), np.zeros(3))
    calibration = exact.model_copy(update={"body_right_camera": tuple(map(tuple, turned.tolist()))})
    offsets = {}
    for is_estimated in (False, True):
        config = FrontendConfig(pair=PairConfig(is_estimated=is_estimated))
        frontend = StereoFrontend(calibration, config)
        tracks = [frontend.track(frame) for frame in walked[0][:5]][-1]
        offsets[is_estimated] = np.nanmean(np.abs(tracks.right_px[:, 1] - tracks.left_px[:, 1]))
    assert offsets[False] > 0.1
    assert offsets[True] < 0.4 * offsets[False]


def test_interchanged_images_teach_nothing(walked: tuple[list[StereoFrame], Array]) -> None:
    frontend, frame = StereoFrontend(rig()), walked[0][0]
    frontend.track(replace(frame, left=frame.right, right=frame.left))
    np.testing.assert_array_equal(frontend.pair_calibration.errors, 0.0)


@pytest.mark.parametrize("roll", [0.0, 4e-3, -4e-3])
def test_rows_differ_in_the_corners_by_a_roll(walked: tuple[list[StereoFrame], Array], roll: float) -> None:
    exact = rig()
    turned = exact.T_body_right_camera @ se3.transform(so3.exp(np.array([0.0, 0.0, roll])), np.zeros(3))
    calibration = exact.model_copy(update={"body_right_camera": tuple(map(tuple, turned.tolist()))})
    found = row_difference(calibration, walked[0][:4])
    assert found.roll_rad == pytest.approx(-roll, abs=0.4e-3)
    assert abs(found.rows_px) == pytest.approx(0.5 * WIDTH * abs(roll), abs=3.0 * found.sigma_px)
    assert 0.0 < found.sigma_px < 0.5
