# SPDX-License-Identifier: BSD-3-Clause
"""Prediction of a frame: which source it uses, and its covariance against finite differences."""

import gtsam
import numpy as np
import pytest
from worlds import IMU, NS_PER_S, WALK, pose_at, readings, velocity_at

from coclo_vio.backend.window.config import SmootherConfig
from coclo_vio.backend.window.inertial_source import InertialSource
from coclo_vio.backend.window.keyframe_source import KeyframeState
from coclo_vio.backend.window.motion_model import ConstantVelocityModel, PredictedMotion
from coclo_vio.backend.window.odometry_source import ExternalOdometry
from coclo_vio.backend.window.source_set import SourceSet
from coclo_vio.backend.window.variables import BIASES, POSE, VELOCITY
from coclo_vio.geometry import se3
from coclo_vio.values.arrays import Array
from coclo_vio.values.keyframes import OdometryDelta

CONFIG = SmootherConfig()
START_NS, END_NS, STEP_NS = 3 * NS_PER_S, 3_300_000_000, 5_000_000
NOTHING = np.zeros((15, 15))


def predicted(
    off: Array | None = None,
    covariance: Array = NOTHING,
    odometry: OdometryDelta | None = None,
    end_ns: int = END_NS,
    last_ns: int = END_NS + STEP_NS,
) -> tuple[PredictedMotion, Array]:
    """The motion since a keyframe of the walk whose state is ``off`` (15,), and that keyframe's pose."""
    off = np.zeros(15) if off is None else off
    pose = pose_at(WALK, START_NS) @ se3.exp(off[:6])
    bias = gtsam.imuBias.ConstantBias(off[9:12], off[12:])
    source = InertialSource(IMU, CONFIG)
    values = gtsam.Values()
    values.insert(POSE.key(0), gtsam.Pose3(pose))
    values.insert(VELOCITY.key(0), velocity_at(WALK, START_NS) + off[6:9])
    values.insert(BIASES.key(0), bias)
    for sample in readings(WALK, range(START_NS - 4 * STEP_NS, last_ns, STEP_NS)):
        if sample.stamp_ns > START_NS and source.preintegration.start_ns is None:
            source.begin(0, START_NS, np.zeros(3), 1.0)
        source.push(sample)
    velocity_model = ConstantVelocityModel(CONFIG.motion, 10.0)
    velocity_model.restart(START_NS, pose)
    sources = SourceSet([source], velocity_model)
    state = KeyframeState(0, START_NS, values, covariance, sources.variables)
    source.bias = bias
    return sources.expect(state, end_ns, ExternalOdometry(odometry)), pose


def test_imu_readings_predict_the_frame() -> None:
    motion, _ = predicted()
    assert motion.is_measured
    assert np.abs(se3.log(se3.inverse(pose_at(WALK, END_NS)) @ motion.T_world_body)).max() < 1e-5
    np.testing.assert_allclose(motion.velocity_world, velocity_at(WALK, END_NS), atol=5e-5)


def moved_by(index: int) -> tuple[Array, Array]:
    """Derivative of position and velocity at the frame, axes of the keyframe's body, to one number of its state."""
    step = 1e-5
    ends = []
    for sign in (1.0, -1.0):
        motion, pose = predicted(sign * step * np.eye(15)[index])
        there = se3.inverse(pose) @ motion.T_world_body
        ends.append(np.concatenate((there[:3, 3], pose[:3, :3].T @ motion.velocity_world)))
    difference = (ends[0] - ends[1]) / (2.0 * step)
    return difference[:3], difference[3:]


def test_uncertainty_of_the_keyframe_is_propagated_to_the_frame() -> None:
    """Position and the velocity correlated with it, relative to the keyframe; biases to first order over 0.3 s."""
    derivatives = [moved_by(index) for index in range(12)]
    position_jacobian = np.stack([position for position, _ in derivatives], axis=1)
    velocity_jacobian = np.stack([velocity for _, velocity in derivatives], axis=1)
    random = np.random.default_rng(3)
    root = random.standard_normal((12, 12)) * np.repeat([0.02, 0.0, 0.1, 0.2], 3)[:, None]
    covariance = NOTHING.copy()
    covariance[:12, :12] = root @ root.T
    plain, pose = predicted()
    motion, _ = predicted(covariance=covariance)
    turned = motion.T_world_body[:3, :3].T @ pose[:3, :3]
    added = motion.covariance[3:, 3:] - plain.covariance[3:, 3:]
    spread = position_jacobian @ covariance[:12, :12] @ position_jacobian.T
    np.testing.assert_allclose(turned.T @ added @ turned, spread, rtol=0.02, atol=0.01 * np.abs(spread).max())
    together = velocity_jacobian @ covariance[:12, :12] @ position_jacobian.T
    gain = pose[:3, :3].T @ motion.velocity_gain @ pose[:3, :3]
    np.testing.assert_allclose(gain @ spread, together, rtol=0.03, atol=0.02 * np.abs(together).max())


def test_odometry_is_used_before_the_imu() -> None:
    delta = se3.exp(np.array([0.0, 0.0, 0.1, 0.5, 0.0, 0.0]))
    motion, pose = predicted(odometry=OdometryDelta(START_NS, END_NS, delta, 1e-4 * np.eye(6)))
    np.testing.assert_allclose(motion.T_world_body, pose @ delta, atol=1e-12)
    np.testing.assert_allclose(np.diag(motion.covariance), 1e-4, rtol=1e-3)


def test_in_a_gap_of_the_readings_constant_velocity_is_predicted() -> None:
    motion, pose = predicted(end_ns=START_NS + NS_PER_S, last_ns=START_NS + STEP_NS)
    assert not motion.is_measured
    np.testing.assert_allclose(motion.T_world_body, pose, atol=1e-12)
    assert np.sqrt(motion.covariance[3, 3]) == pytest.approx(10.0, rel=1e-3)
