# SPDX-License-Identifier: BSD-3-Clause
"""The motion of a stereo camera by two frames' tracks, against the motion that made them."""

import numpy as np
import pytest
from walk_among_points import RIG

from coclo_vio.fusion.stereo_motion import stereo_motion
from coclo_vio.geometry import se3
from coclo_vio.values.arrays import Array
from coclo_vio.values.measurements import StereoTracks

T_START_END = se3.exp(np.array([0.02, -0.05, 0.01, 0.03, -0.02, 0.08]))


def tracks(stamp_ns: int, points: Array, noise_px: float, random: np.random.Generator) -> StereoTracks:
    left, disparity = RIG.pixels(points)
    left = left + noise_px * random.standard_normal(left.shape)
    disparity = disparity + noise_px * random.standard_normal(len(points))
    right = left - np.column_stack((disparity, np.zeros(len(points))))
    return StereoTracks(stamp_ns, np.arange(len(points)), left, right)


def pair(seed: int, count: int = 80, noise_px: float = 0.2) -> tuple[StereoTracks, StereoTracks]:
    random = np.random.default_rng(seed)
    points = random.uniform((-1.0, -1.0, 1.5), (1.0, 1.0, 4.0), (count, 3))
    later = se3.apply(se3.inverse(T_START_END), points)
    return tracks(0, points, noise_px, random), tracks(1, later, noise_px, random)


def test_without_noise_the_motion_is_exact() -> None:
    motion = stereo_motion(RIG, *pair(0, noise_px=0.0))
    assert motion is not None
    np.testing.assert_allclose(motion.T_start_end, T_START_END, atol=1e-6)


def test_outliers_and_missing_right_pixels_do_little() -> None:
    start, end = pair(1)
    left, right = end.left_px.copy(), end.right_px.copy()
    left[::6] += [9.0, -7.0]
    right[1::5] = np.nan
    motion = stereo_motion(RIG, start, StereoTracks(1, end.track_ids, left, right))
    assert motion is not None
    off = se3.log(se3.inverse(T_START_END) @ motion.T_start_end)
    assert np.linalg.norm(off[:3]) < 0.002
    assert np.linalg.norm(off[3:]) < 0.01


def test_the_covariance_is_of_the_size_of_the_errors() -> None:
    squared = []
    for seed in range(40):
        motion = stereo_motion(RIG, *pair(10 + seed))
        assert motion is not None
        off = se3.log(se3.inverse(T_START_END) @ motion.T_start_end)
        squared.append(float(off @ np.linalg.solve(motion.covariance, off)) / 6.0)
    assert 0.2 < np.mean(squared) < 2.0


@pytest.mark.parametrize("count", [3, 14])
def test_few_common_tracks_give_no_motion(count: int) -> None:
    assert stereo_motion(RIG, *pair(2, count)) is None


def test_tracks_that_agree_on_no_motion_give_none() -> None:
    start, end = pair(3)
    shuffled = np.random.default_rng(4).permutation(len(end))
    assert stereo_motion(RIG, start, StereoTracks(1, end.track_ids, end.left_px[shuffled], end.right_px)) is None
