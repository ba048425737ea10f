# SPDX-License-Identifier: BSD-3-Clause
import numpy as np
import pytest
from worlds import RIG

from coclo_vio.backend.window.config import DisparityOffsetConfig, SmootherConfig
from coclo_vio.backend.window.disparity_offset import DisparityOffset
from coclo_vio.backend.window.landmarks import LandmarkMap
from coclo_vio.geometry import se3
from coclo_vio.values.measurements import StereoTracks

TRUE_PX, SCALE = 0.12, 0.01


def taught(rng: np.random.Generator, keyframes: int, **config: object) -> DisparityOffset:
    """By batches of eight points, whose measured disparities are less the offset that is corrected already."""
    offset = DisparityOffset(DisparityOffsetConfig.parse(config, "offset"))
    for _ in range(keyframes):
        moved = rng.uniform(2.0, 15.0, 8)
        measured = (1.0 + SCALE) * moved + TRUE_PX + rng.normal(scale=0.2, size=8)
        offset.learn(measured - offset.px, moved, np.full(8, 0.05))
    return offset


def test_the_offset_is_found_beside_the_scale_of_the_path() -> None:
    offset = taught(np.random.default_rng(1), 150)
    assert offset.px == pytest.approx(TRUE_PX, abs=0.04)
    assert offset.regression.estimate[1] == pytest.approx(SCALE, abs=0.005)


def test_its_error_is_no_larger_than_claimed() -> None:
    """The spread of the points is learnt slowly, from a larger one."""
    rng = np.random.default_rng(2)
    found = [taught(rng, 60, sigma_px=1.0, least_point_sigma_px=0.01) for _ in range(60)]
    normalised = [(each.px - TRUE_PX) / each.regression.sigmas[0] for each in found]
    assert 0.2 < np.mean(np.square(normalised)) < 1.3


def test_it_is_zero_where_it_is_not_estimated() -> None:
    assert taught(np.random.default_rng(3), 20, is_estimated=False).px == 0.0


def test_landmarks_that_leave_show_it_by_their_parallax() -> None:
    """Exact left pixels from three keyframes; right ones with an offset."""
    rng = np.random.default_rng(4)
    offset = DisparityOffset(DisparityOffsetConfig(sigma_px=1.0))
    landmarks = LandmarkMap(RIG, SmootherConfig(), offset)
    points = se3.apply(RIG.T_body_camera, rng.uniform((-2.0, -1.0, 3.0), (2.0, 1.0, 9.0), (200, 3)))
    poses = {number: se3.transform(np.eye(3), np.array([0.0, 0.3 * number, 0.0])) for number in range(3)}
    for number, pose in poses.items():
        in_camera = se3.apply(se3.inverse(pose @ RIG.T_body_camera), points)
        left_px, disparity = RIG.pixels(in_camera)
        right_px = left_px - np.column_stack((disparity + TRUE_PX, np.zeros(len(points))))
        tracks = StereoTracks(number, np.arange(len(points)), left_px, right_px)
        landmarks.observe(number, tracks, np.zeros(len(points), dtype=np.bool_))
    landmarks.learn_offset([each for each, _ in landmarks.items()], poses, 0.1)
    assert offset.px == pytest.approx(TRUE_PX, abs=0.01)
    corrected = landmarks.observations(tracks)
    assert np.nanmedian(corrected[:, 0] - corrected[:, 2] - disparity) == pytest.approx(0.0, abs=0.01)


def test_landmarks_without_parallax_show_nothing() -> None:
    offset = DisparityOffset(DisparityOffsetConfig())
    landmarks = LandmarkMap(RIG, SmootherConfig(), offset)
    left_px = np.array([[300.0, 200.0], [100.0, 50.0]])
    for number in range(3):
        tracks = StereoTracks(number, np.arange(2), left_px, left_px - [12.0, 0.0])
        landmarks.observe(number, tracks, np.zeros(2, dtype=np.bool_))
    landmarks.learn_offset([0, 1], {number: np.eye(4) for number in range(3)}, 0.1)
    assert offset.px == 0.0
