# SPDX-License-Identifier: BSD-3-Clause
"""The constant-velocity model."""

import numpy as np
import pytest

from coclo_vio.backend.window.config import MotionPriorConfig
from coclo_vio.backend.window.motion_model import ConstantVelocityModel
from coclo_vio.geometry import se3

CONFIG = MotionPriorConfig(decay_s=0.5)
TWIST = np.array([0.1, -0.2, 0.3, 1.0, 0.2, -0.1])
FRAME_NS = 100_000_000
SHARP = 1e-10 * np.eye(6)  # covariance of a pose that is measured well
START = se3.exp(np.array([0.3, 0.1, -0.4, 2.0, 1.0, 0.5]))


def moving(frames: int = 5) -> tuple[ConstantVelocityModel, np.ndarray]:
    """The model after some frames of constant velocity, and the last pose."""
    motion, pose = ConstantVelocityModel(CONFIG, 10.0), START
    motion.restart(0, pose)
    for number in range(1, frames + 1):
        pose = pose @ se3.exp(0.1 * TWIST)
        motion.add(number * FRAME_NS, pose, pose, SHARP, is_keyframe=False)
    return motion, pose


def test_constant_velocity_is_measured_and_continues() -> None:
    motion, pose = moving()
    np.testing.assert_allclose(motion.twist, TWIST, atol=1e-9)
    expected = motion.at(6 * FRAME_NS)
    np.testing.assert_allclose(expected.T_world_body, pose @ se3.exp(0.1 * TWIST), atol=1e-12)
    np.testing.assert_allclose(expected.velocity_world, pose[:3, :3] @ TWIST[3:], atol=1e-9)
    assert not expected.is_measured


def test_after_one_pose_the_velocity_is_zero_and_very_uncertain() -> None:
    motion = ConstantVelocityModel(CONFIG, 10.0)
    motion.restart(0, START)
    np.testing.assert_array_equal(motion.twist, 0.0)
    expected = motion.at(FRAME_NS)
    np.testing.assert_allclose(expected.T_world_body, START)
    assert np.sqrt(expected.covariance[3, 3]) == pytest.approx(1.0, rel=1e-3)  # 10 m/s over 0.1 s
    assert expected.covariance[3, 3] > 10 * moving()[0].at(6 * FRAME_NS).covariance[3, 3]


def test_a_correction_of_the_pose_is_not_a_motion() -> None:
    motion, pose = moving()
    measured = pose @ se3.exp(0.1 * TWIST)
    corrected = se3.exp(np.array([0.0, 0.0, 0.2, 1.0, -1.0, 0.0])) @ measured
    motion.add(6 * FRAME_NS, measured, corrected, SHARP, is_keyframe=False)
    np.testing.assert_allclose(motion.twist, TWIST, atol=1e-9)
    np.testing.assert_allclose(motion.at(7 * FRAME_NS).T_world_body, corrected @ se3.exp(0.1 * TWIST), atol=1e-9)


def test_without_vision_the_velocity_decays_and_the_uncertainty_grows() -> None:
    motion, pose = moving()
    speeds, traces, stamp_ns = [], [], 5 * FRAME_NS
    for _ in range(20):
        stamp_ns += FRAME_NS
        expected = motion.at(stamp_ns)
        speeds.append(np.linalg.norm(expected.velocity_world))
        traces.append(np.trace(expected.covariance))
        pose = expected.T_world_body
        motion.add(stamp_ns, pose, pose, None, is_keyframe=False)
    np.testing.assert_allclose(speeds, np.linalg.norm(TWIST[3:]) * np.exp(-0.1 * np.arange(20) / CONFIG.decay_s))
    assert np.all(np.diff(traces) > 0.0)
    travelled = np.linalg.norm(pose[:3, 3] - moving()[1][:3, 3])
    assert 0.4 * np.linalg.norm(TWIST[3:]) < travelled < 0.6 * np.linalg.norm(TWIST[3:])  # half a second


def test_the_twist_is_derived_over_a_long_enough_time() -> None:
    """At 200 frames a second, noise of a millimetre would be 0.2 m/s from frame to frame; over 80 ms it is 13 mm/s."""
    motion = ConstantVelocityModel(CONFIG, 10.0)
    motion.restart(0, np.eye(4))
    for number in range(1, 101):
        pose = np.eye(4)
        pose[0, 3] = 0.005 * number + 1e-3 * (number % 2)
        motion.add(number * 5_000_000, pose, pose, SHARP, is_keyframe=False)
    assert motion.twist[3] == pytest.approx(1.0, abs=0.02)


def test_the_covariance_grows_with_time_and_is_never_zero() -> None:
    motion, _ = moving()
    traces = [np.trace(motion.covariance(dt_s)) for dt_s in (0.0, 0.1, 0.5, 2.0)]
    assert traces[0] > 0.0
    assert np.all(np.diff(traces) > 0.0)
    assert np.trace(motion.covariance(0.1, 1.0)) > np.trace(motion.covariance(0.1))


def test_a_restart_forgets_the_motion() -> None:
    motion, pose = moving()
    motion.restart(5 * FRAME_NS, pose)
    np.testing.assert_array_equal(motion.twist, 0.0)
    np.testing.assert_allclose(motion.at(6 * FRAME_NS).T_world_body, pose)
