# SPDX-License-Identifier: BSD-3-Clause
"""The motion capture: its own world and clock, noise, dropouts."""

import numpy as np
import pytest
from motions import motion, times

from coclo_vio.geometry import se3, so3
from coclo_vio.simulation.trial.sensors import EPOCH_NS
from coclo_vio.simulation.trial.vicon import ViconConfig, vicon_poses
from coclo_vio.values.units import NS_PER_S

CLEAR = {"position_noise_m": 0.0, "rotation_noise_rad": 0.0, "dropout_s": 0.0}


@pytest.fixture(scope="module")
def circling():
    """Twenty seconds in a circle."""
    angles = 0.3 * times(20.0)
    poses = np.tile(np.eye(4), (len(angles), 1, 1))
    poses[:, :3, :3] = so3.exp(angles[:, None] * np.array([0.0, 0.0, 1.0]))
    poses[:, 0, 3], poses[:, 1, 3] = np.sin(angles), 1.0 - np.cos(angles)
    return motion(20.0, poses=poses)


def test_without_noise_it_measures_the_motion_in_another_level_world(circling) -> None:
    measured, _ = vicon_poses(circling, ViconConfig(**CLEAR), np.random.default_rng(2))
    poses = measured.trajectory.T_world_body
    assert len(poses) == 2001
    T_vicon_world = poses[0] @ se3.inverse(circling.T_world_body[0])
    np.testing.assert_allclose(poses, T_vicon_world @ circling.T_world_body[::10], atol=1e-9)
    np.testing.assert_allclose(T_vicon_world[2], [0.0, 0.0, 1.0, 0.0], atol=1e-12)
    assert np.abs(T_vicon_world[:2, 3]).max() > 0.01
    assert measured.trajectory.velocity_world is None


def test_its_clock_is_ahead_by_the_returned_offset(circling) -> None:
    offsets = []
    for seed in range(40):
        measured, offset_s = vicon_poses(
            circling, ViconConfig(**CLEAR, clock_offset_s=0.2), np.random.default_rng(seed)
        )
        assert measured.trajectory.stamps_ns[0] - EPOCH_NS == round(offset_s * NS_PER_S)
        offsets.append(offset_s)
    assert max(np.abs(offsets)) < 0.2
    assert min(offsets) < -0.1
    assert max(offsets) > 0.1


def test_its_noise_is_as_configured(circling) -> None:
    config = ViconConfig(position_noise_m=0.002, rotation_noise_rad=0.004, dropout_s=0.0)
    exact, _ = vicon_poses(circling, ViconConfig(**CLEAR), np.random.default_rng(3))
    noisy, _ = vicon_poses(circling, config, np.random.default_rng(3))  # the world is drawn before the noise
    apart = se3.inverse(exact.trajectory.T_world_body) @ noisy.trajectory.T_world_body
    errors = np.array([se3.log(T_exact_noisy) for T_exact_noisy in apart])
    np.testing.assert_allclose(errors[:, :3].std(axis=0), 0.004, rtol=0.06)
    np.testing.assert_allclose(errors[:, 3:].std(axis=0), 0.002, rtol=0.06)


def test_dropouts_have_their_share_and_none_is_while_the_robot_stands(circling) -> None:
    config = ViconConfig(dropout_every_s=2.0, dropout_s=0.5)
    lost = []
    for seed in range(40):
        measured, offset_s = vicon_poses(circling, config, np.random.default_rng(seed))
        time_s = (measured.trajectory.stamps_ns - EPOCH_NS) / NS_PER_S - offset_s
        assert (np.diff(time_s) > 0.0).all()
        assert np.count_nonzero(time_s < 1.995) == 200
        lost.append(1.0 - np.count_nonzero(time_s > 1.995) / 1801)
    assert np.mean(lost) == pytest.approx(0.5 / 2.5, abs=0.04)
