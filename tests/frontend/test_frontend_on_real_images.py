# SPDX-License-Identifier: BSD-3-Clause
"""EuRoC (a drone at rest, and keyframes of its flight) and KITTI (a car at 12 m/s), against their ground truth."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from coclo_vio.datasets.dataset import open_dataset
from coclo_vio.frontend.frontend import StereoFrontend
from coclo_vio.frontend.rectification import Rectifier
from coclo_vio.geometry import se3
from coclo_vio.values.measurements import StereoFrame, StereoTracks, TrackingQuality

PERIOD_S = 0.05


def frames_of(path: Path) -> list[StereoFrame]:
    frames = open_dataset(path, None).measurements(frozenset({StereoFrame}))
    return [frame for frame in frames if isinstance(frame, StereoFrame)]


def frontend_of(path: Path) -> StereoFrontend:
    calibration = open_dataset(path, None).stereo_calibration()
    assert calibration is not None
    return StereoFrontend(calibration)


def matched(tracks: StereoTracks) -> np.ndarray:
    return np.isfinite(tracks.right_px[:, 0])


def disparity(tracks: StereoTracks) -> np.ndarray:
    return np.asarray(tracks.left_px[:, 0] - tracks.right_px[:, 0])


def carried_over(
    frontend: StereoFrontend, before: StereoTracks, after: StereoTracks, T_after_before: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Error in the left image and of the disparity, px, of points triangulated in one frame and tracked to another."""
    _, in_before, in_after = np.intersect1d(
        before.track_ids[matched(before)], after.track_ids[matched(after)], return_indices=True
    )
    then, now = np.flatnonzero(matched(before))[in_before], np.flatnonzero(matched(after))[in_after]
    points = frontend.rig.points(before.left_px[then], disparity(before)[then])
    expected, expected_disparity = frontend.rig.pixels(se3.apply(T_after_before, points))
    return (
        np.linalg.norm(expected - after.left_px[now], axis=1),
        disparity(after)[now] - expected_disparity,
    )


@pytest.fixture(scope="module")
def at_rest(shared_data: Path) -> list[StereoTracks]:
    path = shared_data / "euroc_v1_01_start"
    frontend = frontend_of(path)
    return [frontend.track(frame) for frame in frames_of(path)]


def test_a_drone_at_rest_keeps_its_tracks(at_rest: list[StereoTracks]) -> None:
    assert len(at_rest) == 95
    assert np.mean([len(tracks) for tracks in at_rest]) >= 120
    assert np.mean([matched(tracks).sum() for tracks in at_rest]) > 85
    assert all(tracks.quality is TrackingQuality.HEALTHY for tracks in at_rest)
    assert np.median(at_rest[-1].ages) > 60


def test_at_rest_disparities_scatter_by_less_than_a_tenth_of_a_pixel(at_rest: list[StereoTracks]) -> None:
    disparities: dict[int, list[float]] = {}
    for tracks in at_rest[:20]:
        for number, value in zip(tracks.track_ids.tolist(), disparity(tracks).tolist(), strict=True):
            disparities.setdefault(number, []).append(value)
    sigmas = [np.nanstd(values) for values in disparities.values() if np.isfinite(values).sum() >= 15]
    assert len(sigmas) > 60
    assert np.median(sigmas) < 0.1


def test_rows_agree_after_rectification(shared_data: Path) -> None:
    """Matched in two dimensions by plain Lucas-Kanade, without the epipolar constraint."""
    path = shared_data / "euroc_v1_01_keyframes"
    calibration = open_dataset(path, None).stereo_calibration()
    assert calibration is not None
    rectifier = Rectifier(calibration)
    errors = []
    for frame in frames_of(path)[::10]:
        pair = rectifier.rectify(frame)
        corners = cv2.goodFeaturesToTrack(pair.left, 200, 0.02, 15, mask=rectifier.valid_left)
        there, found, _ = cv2.calcOpticalFlowPyrLK(pair.left, pair.right, corners, None, winSize=(21, 21), maxLevel=5)
        back, returned, _ = cv2.calcOpticalFlowPyrLK(pair.right, pair.left, there, None, winSize=(21, 21), maxLevel=5)
        closes = (
            (found.ravel() > 0) & (returned.ravel() > 0) & (np.abs(back - corners).reshape(-1, 2).max(axis=1) < 0.3)
        )
        errors.extend((there - corners).reshape(-1, 2)[closes, 1].tolist())
    assert len(errors) > 600
    assert np.median(np.abs(errors)) < 0.5


@pytest.mark.long
def test_stereo_depth_agrees_from_keyframe_to_keyframe(shared_data: Path) -> None:
    """Points triangulated in one frame and moved by the true motion, against their tracks in the next frame."""
    path = shared_data / "euroc_v1_01_keyframes"
    frames = frames_of(path)
    truth = open_dataset(path, None).ground_truth()
    assert truth is not None
    near = [
        number
        for number in range(1, len(frames))
        if frames[number].stamp_ns - frames[number - 1].stamp_ns < 1.5e9 * PERIOD_S
        and truth.trajectory.stamps_ns[0] < frames[number - 1].stamp_ns
    ]
    assert len(near) >= 8
    pixels, disparities = [], []
    for number in near[:8]:
        frontend, pair = frontend_of(path), frames[number - 1 : number + 1]
        poses = truth.trajectory.interpolated(np.array([frame.stamp_ns for frame in pair])).T_world_body
        cameras = poses @ frontend.rig.T_body_camera
        before, after = (frontend.track(frame) for frame in pair)
        error_px, disparity_error = carried_over(frontend, before, after, se3.inverse(cameras[1]) @ cameras[0])
        assert len(error_px) > 50
        pixels.extend(error_px.tolist())
        disparities.extend(disparity_error.tolist())
    assert np.median(pixels) < 1.0
    assert np.median(np.abs(disparities)) < 0.15
    assert (np.abs(disparities) < 1.0).mean() > 0.95


def test_a_car_is_tracked_without_any_prediction_from_outside(shared_data: Path) -> None:
    """1.2 m per frame; points triangulated in one frame and moved by the true motion, against the next frame."""
    path = shared_data / "kitti_stereo"
    truth = open_dataset(path, None).ground_truth()
    assert truth is not None
    frontend = frontend_of(path)
    cameras = truth.trajectory.T_world_body @ frontend.rig.T_body_camera
    results = [frontend.track(frame) for frame in frames_of(path)]
    assert len(results) == len(cameras) == 51
    assert all(tracks.quality is TrackingQuality.HEALTHY for tracks in results)
    assert min(matched(tracks).sum() for tracks in results) > 45
    tracked, pixels = [], []
    for number in range(1, 51):
        T_now_before = se3.inverse(cameras[number]) @ cameras[number - 1]
        error_px, _ = carried_over(frontend, results[number - 1], results[number], T_now_before)
        tracked.append(len(error_px))
        pixels.extend(error_px.tolist())
    assert min(tracked) > 15
    assert np.mean(tracked) > 30
    assert np.median(pixels) < 1.2
