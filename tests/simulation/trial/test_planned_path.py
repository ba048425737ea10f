# SPDX-License-Identifier: BSD-3-Clause
"""The planned path of the body: continuous, at its speed, over the ground and along its slope."""

from itertools import pairwise

import numpy as np
import pytest

from coclo_vio.geometry import se3
from coclo_vio.simulation.trial.planned_path import PlannedPath
from coclo_vio.simulation.trial.terrain import TERRAINS, make_terrain

HEIGHT_M, SPEED_MPS, TURN_RADPS = 0.2, 0.1, 0.15


@pytest.fixture(params=TERRAINS)
def path(request) -> PlannedPath:
    return PlannedPath(make_terrain(request.param), SPEED_MPS, TURN_RADPS, HEIGHT_M)


def test_it_is_continuous_at_its_speed(path) -> None:
    """No step is longer than the speed allows: on a slope by its length, and for the body's height over a bend."""
    step_s = 0.05
    poses = np.array([path.pose_at(time_s) for time_s in np.arange(0.0, path.duration_s, step_s)])
    twists = np.array([se3.log(se3.inverse(before) @ after) for before, after in pairwise(poses)])
    speed = np.linalg.norm(twists[:, 3:], axis=1) / step_s
    assert speed.max() < 1.15 * SPEED_MPS
    assert np.linalg.norm(twists[:, :3], axis=1).max() / step_s < TURN_RADPS + 1e-6
    assert np.median(speed[speed > 1e-9]) == pytest.approx(SPEED_MPS, rel=0.05)


def test_before_and_after_the_path_it_stands(path) -> None:
    start = path.pose_at(0.0)
    np.testing.assert_allclose(start[:3, 3], [0.0, 0.0, HEIGHT_M], atol=1e-12)
    np.testing.assert_array_equal(path.pose_at(-3.0), start)
    end = path.pose_at(path.duration_s)
    np.testing.assert_allclose(path.pose_at(path.duration_s + 9.0), end, atol=1e-12)


def test_its_duration_is_the_sum_over_its_segments() -> None:
    flat = PlannedPath(make_terrain("flat"), SPEED_MPS, TURN_RADPS, HEIGHT_M)
    assert flat.duration_s == pytest.approx(8.0 / SPEED_MPS + 1.5 * np.pi / TURN_RADPS)
    quicker = PlannedPath(make_terrain("flat"), 2 * SPEED_MPS, 2 * TURN_RADPS, HEIGHT_M)
    assert quicker.duration_s == pytest.approx(flat.duration_s / 2)


def test_on_the_ramp_the_body_lies_along_it_at_its_height() -> None:
    ramp = PlannedPath(make_terrain("ramp"), SPEED_MPS, TURN_RADPS, HEIGHT_M)
    pose = ramp.pose_at(2.6 / SPEED_MPS)  # with front and rear feet on the slope
    slope = np.arctan2(0.98, 3.34)
    normal = np.array([-np.sin(slope), 0.0, np.cos(slope)])
    np.testing.assert_allclose(pose[:3, 2], normal, atol=1e-9)
    foot_of_slope = np.array([1.0, 0.0, 0.0])
    assert (pose[:3, 3] - foot_of_slope) @ normal == pytest.approx(HEIGHT_M)
