# SPDX-License-Identifier: BSD-3-Clause
"""The worlds of the benchmark: robots walk as their truth says, tracks and images fit the motion of the rig."""

from pathlib import Path

import numpy as np
import pytest

from coclo_vio.experiments.bench.costs import WalkKind
from coclo_vio.experiments.bench.legged_robots import robot_with_legs, standing_rad
from coclo_vio.experiments.bench.point_world import rig, tracked_walk
from coclo_vio.experiments.bench.rectified_pair import FOCAL_PX, LOOKS_LEFT, PRINCIPAL_POINT_PX, rectified_pair
from coclo_vio.filter.odometry import LegOdometryFilter
from coclo_vio.geometry import se3
from coclo_vio.robot.model import RobotModel
from coclo_vio.values.measurements import CameraImuSample, StereoTracks


@pytest.mark.long
@pytest.mark.parametrize("legs", [2, 5])
def test_a_robot_of_any_number_of_legs_walks_and_is_estimated(legs: int, tmp_path: Path) -> None:
    robot = RobotModel(robot_with_legs(legs, tmp_path))
    trial = WalkKind(100.0, walk_s=3.0, standing_rad=standing_rad(legs)).trial(robot)
    odometry = LegOdometryFilter(robot)
    estimates = [estimate for each in trial.measurements if (estimate := odometry.push(each)) is not None]
    walked = trial.truth.positions[-1] - trial.truth.positions[0]
    assert np.linalg.norm(walked) > 0.3
    estimated = estimates[-1].nav.T_world_body[:3, 3] - estimates[0].nav.T_world_body[:3, 3]
    assert np.linalg.norm(estimated - walked) < 0.02 * np.linalg.norm(walked)


def test_a_frame_of_tracks_follows_twenty_readings_and_tracks_last() -> None:
    walk = list(tracked_walk(tracks=60, frames=25))
    frames = [each for each in walk if isinstance(each, StereoTracks)]
    assert len(frames) == 25
    assert [each.stamp_ns for each in walk] == sorted(each.stamp_ns for each in walk)
    assert sum(isinstance(each, CameraImuSample) for each in walk) >= 20 * 24
    assert {len(frame.track_ids) for frame in frames} == {60}
    kept = [len(np.intersect1d(*pair)) for pair in zip(ids_of(frames), ids_of(frames)[1:], strict=False)]
    assert min(kept) > 45


def ids_of(frames: list[StereoTracks]) -> list[np.ndarray]:
    return [frame.track_ids for frame in frames]


def test_at_rest_a_point_is_where_its_track_and_disparity_say() -> None:
    """The same point seen in the frames of the rest has the same pixels but for the noise."""
    frames = [each for each in tracked_walk(tracks=60, frames=8) if isinstance(each, StereoTracks)]
    assert rig().baseline_m == pytest.approx(0.1)
    for frame in frames[1:]:
        _, here, there = np.intersect1d(frames[0].track_ids, frame.track_ids, return_indices=True)
        apart = frames[0].left_px[here] - frame.left_px[there]
        assert 0.1 < np.sqrt(np.mean(apart**2)) < 1.0
    disparity = frames[0].left_px[:, 0] - frames[0].right_px[:, 0]
    assert disparity.min() > 0.8 * FOCAL_PX * 0.1 / 7.0


def test_the_pair_is_rectified() -> None:
    for pair in (rig(), rectified_pair(LOOKS_LEFT, 0.06)):
        assert pair.rectification_defects() == []
        T_left_right = se3.inverse(pair.T_body_left_camera) @ pair.T_body_right_camera
        np.testing.assert_allclose(T_left_right[:3, 3], [pair.baseline_m, 0.0, 0.0], atol=1e-12)
        assert pair.left.principal_point_px == PRINCIPAL_POINT_PX
