# SPDX-License-Identifier: BSD-3-Clause
"""Faults of cameras on images and tracks made by hand: what is changed, and when."""

import numpy as np
import pytest
from fault_samples import changed_steps, image, of_kind, recorded, step_of, with_faults

from coclo_vio.geometry import se3
from coclo_vio.runs.fault_kinds.image_faults import halved_cameras
from coclo_vio.values.calibration import CameraCalibration, StereoCalibration, matrix4
from coclo_vio.values.measurements import ALL_SENSORS, StereoFrame, StereoTracks

IMAGES_ONLY = [row for row in recorded() if type(row) is not StereoTracks]


def test_frozen_frames_repeat_the_last_images_with_new_stamps() -> None:
    faulty = with_faults(IMAGES_ONLY, frozen_frames="1:0.5")
    assert changed_steps(IMAGES_ONLY, faulty, StereoFrame) == {10, 11, 12, 13, 14}
    for frame in of_kind(faulty, StereoFrame):
        shown = 9 if 10 <= step_of(frame) < 15 else step_of(frame)
        np.testing.assert_array_equal(frame.left, image(shown))
        np.testing.assert_array_equal(frame.right, image(shown + 100))


def test_frozen_tracks_repeat_the_last_pixels() -> None:
    faulty = of_kind(with_faults(recorded(), frozen_frames="1:0.5"), StereoTracks)
    assert [float(one.left_px[0, 1]) for one in faulty[8:16]] == [9.0, 10.0, 10.0, 10.0, 10.0, 10.0, 10.0, 16.0]


def test_an_exposure_jump_scales_grey_values_up_to_white() -> None:
    faulty = with_faults(IMAGES_ONLY, exposure_jumps="1:0.5:3")
    assert changed_steps(IMAGES_ONLY, faulty, StereoFrame) == {10, 11, 12, 13, 14}
    bright = of_kind(faulty, StereoFrame)[12]
    np.testing.assert_array_equal(bright.left, np.minimum(3 * image(12).astype(int), 255))


def test_a_blur_keeps_the_mean_and_takes_contrast() -> None:
    faulty = with_faults(IMAGES_ONLY, blurred_images="1:0.5:2")
    assert changed_steps(IMAGES_ONLY, faulty, StereoFrame) == {10, 11, 12, 13, 14}
    blurred, sharp = of_kind(faulty, StereoFrame)[12].right, image(112)
    assert blurred.std() < 0.5 * sharp.std()
    assert blurred.mean() == pytest.approx(sharp.mean(), abs=6.0)


def test_left_and_right_are_interchanged_and_unmatched_points_are_gone() -> None:
    faulty = with_faults(recorded(), swapped_images="1:0.5")
    frames, tracks = of_kind(faulty, StereoFrame), of_kind(faulty, StereoTracks)
    np.testing.assert_array_equal(frames[12].left, image(112))
    np.testing.assert_array_equal(frames[12].right, image(12))
    np.testing.assert_array_equal(frames[15].left, image(15))
    assert tracks[12].track_ids.tolist() == [3]
    np.testing.assert_array_equal(tracks[12].left_px, [[8.0, 1.0]])
    np.testing.assert_array_equal(tracks[12].right_px, [[10.0, 13.0]])
    assert tracks[15].track_ids.tolist() == [3, 5]


def test_a_share_of_the_frames_is_lost_in_the_span_only() -> None:
    rows = of_kind(recorded(600), StereoFrame)
    kept = {step_of(one) for one in with_faults(rows, lost_frames="10:40:0.5", seed=3)}
    assert {*range(100), *range(500, 600)} <= kept
    assert len(kept & set(range(100, 500))) == pytest.approx(200, abs=40)


def test_images_of_half_the_resolution_are_means_over_two_by_two_pixels() -> None:
    faulty = with_faults(IMAGES_ONLY, halved_images="1:0.5")
    assert changed_steps(IMAGES_ONLY, faulty, StereoFrame) == {10, 11, 12, 13, 14}
    half = of_kind(faulty, StereoFrame)[12].left
    assert half.shape == (2, 4)
    assert half[1, 3] == pytest.approx(image(12)[2:4, 6:8].mean(), abs=0.51)
    whole_time = of_kind(with_faults(IMAGES_ONLY, ALL_SENSORS, halved_cameras=True), StereoFrame)
    assert {one.left.shape for one in whole_time} == {(2, 4)}


def test_a_point_has_its_place_in_the_halved_calibration() -> None:
    camera = CameraCalibration(width_px=640, height_px=480, focal_px=(380.0, 390.0), principal_point_px=(319.5, 239.5))
    right = se3.transform(np.eye(3), np.array([0.1, 0.0, 0.0]))
    stereo = StereoCalibration(
        left=camera, right=camera, body_left_camera=matrix4(np.eye(4)), body_right_camera=matrix4(right)
    )
    half = halved_cameras(stereo)
    assert (half.left.width_px, half.left.height_px) == (320, 240)
    assert half.T_body_right_camera == pytest.approx(right)
    point = np.array([0.3, -0.2, 2.0])
    full_px, half_px = ((one.camera_matrix @ point)[:2] / point[2] for one in (camera, half.left))
    np.testing.assert_allclose(half_px, (full_px - 0.5) / 2.0)
