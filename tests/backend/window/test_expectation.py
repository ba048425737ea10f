# SPDX-License-Identifier: BSD-3-Clause
"""What is expected of a frame: whose word counts, and how far it may be off, against finite differences."""

import gtsam
import numpy as np
import pytest
from worlds import IMU, NS_PER_S, RIG, WALK, frames, pose_at, readings, scattered, velocity_at

from coclo_vio.backend.window.config import SmootherConfig
from coclo_vio.backend.window.expectation import Expectation
from coclo_vio.backend.window.inertial import Preintegration
from coclo_vio.backend.window.motion import Motion, SteadyMotion
from coclo_vio.backend.window.window import Keyframe, Window
from coclo_vio.geometry import se3
from coclo_vio.values.arrays import Array
from coclo_vio.values.keyframes import OdometryDelta

CONFIG = SmootherConfig()
START_NS, END_NS, STEP_NS = 3 * NS_PER_S, 3_300_000_000, 5_000_000
NOTHING = np.zeros((15, 15))


def expected(
    off: Array | None = None,
    covariance: Array = NOTHING,
    odometry: OdometryDelta | None = None,
    end_ns: int = END_NS,
    last_ns: int = END_NS + STEP_NS,
) -> tuple[Motion, Array]:
    """The motion since a keyframe of the walk whose state is ``off`` (15,), and that keyframe's pose."""
    off = np.zeros(15) if off is None else off
    pose = pose_at(WALK, START_NS) @ se3.exp(off[:6])
    bias = gtsam.imuBias.ConstantBias(off[9:12], off[12:])
    window = Window(RIG, CONFIG)
    tracks = frames(WALK, [START_NS], scattered(count=200))[0]
    window.add(Keyframe(0, START_NS, tracks), pose, np.zeros(len(tracks), dtype=np.bool_))
    window.set_inertial(0, velocity_at(WALK, START_NS) + off[6:9], bias)
    imu = Preintegration(IMU, CONFIG.inertial)
    for sample in readings(WALK, range(START_NS - 4 * STEP_NS, last_ns, STEP_NS)):
        if sample.stamp_ns > START_NS and imu.start_ns is None:
            imu.restart(START_NS, gtsam.imuBias.ConstantBias())
        imu.push(sample)
    steady = SteadyMotion(CONFIG.motion, 10.0)
    steady.restart(START_NS, pose)
    return Expectation(CONFIG, imu, steady).of_frame(window, end_ns, odometry, bias, covariance), pose


def test_readings_lead_to_the_frame() -> None:
    motion, _ = expected()
    assert motion.is_measured
    assert np.abs(se3.log(se3.inverse(pose_at(WALK, END_NS)) @ motion.T_world_body)).max() < 1e-5
    np.testing.assert_allclose(motion.velocity_world, velocity_at(WALK, END_NS), atol=5e-5)


def moved_by(index: int) -> tuple[Array, Array]:
    """Derivative of position and velocity at the frame, axes of the keyframe's body, to one number of its state."""
    step = 1e-5
    ends = []
    for sign in (1.0, -1.0):
        motion, pose = expected(sign * step * np.eye(15)[index])
        there = se3.inverse(pose) @ motion.T_world_body
        ends.append(np.concatenate((there[:3, 3], pose[:3, :3].T @ motion.velocity_world)))
    difference = (ends[0] - ends[1]) / (2.0 * step)
    return difference[:3], difference[3:]


def test_doubt_about_the_keyframe_is_carried_to_the_frame() -> None:
    """Position and the velocity that goes with it, seen from the keyframe; biases to first order over 0.3 s."""
    derivatives = [moved_by(index) for index in range(12)]
    shift = np.stack([position for position, _ in derivatives], axis=1)
    swing = np.stack([velocity for _, velocity in derivatives], axis=1)
    random = np.random.default_rng(3)
    root = random.standard_normal((12, 12)) * np.repeat([0.02, 0.0, 0.1, 0.2], 3)[:, None]
    covariance = NOTHING.copy()
    covariance[:12, :12] = root @ root.T
    plain, pose = expected()
    motion, _ = expected(covariance=covariance)
    turned = motion.T_world_body[:3, :3].T @ pose[:3, :3]
    added = motion.covariance[3:, 3:] - plain.covariance[3:, 3:]
    spread = shift @ covariance[:12, :12] @ shift.T
    np.testing.assert_allclose(turned.T @ added @ turned, spread, rtol=0.02, atol=0.01 * np.abs(spread).max())
    together = swing @ covariance[:12, :12] @ shift.T
    gain = pose[:3, :3].T @ motion.velocity_gain @ pose[:3, :3]
    np.testing.assert_allclose(gain @ spread, together, rtol=0.03, atol=0.02 * np.abs(together).max())


def test_odometry_is_believed_before_the_readings() -> None:
    delta = se3.exp(np.array([0.0, 0.0, 0.1, 0.5, 0.0, 0.0]))
    motion, pose = expected(odometry=OdometryDelta(START_NS, END_NS, delta, 1e-4 * np.eye(6)))
    np.testing.assert_allclose(motion.T_world_body, pose @ delta, atol=1e-12)
    np.testing.assert_allclose(np.diag(motion.covariance), 1e-4, rtol=1e-3)


def test_after_a_silence_steadiness_is_all_there_is() -> None:
    motion, pose = expected(end_ns=START_NS + NS_PER_S, last_ns=START_NS + STEP_NS)
    assert not motion.is_measured
    np.testing.assert_allclose(motion.T_world_body, pose, atol=1e-12)
    assert np.sqrt(motion.covariance[3, 3]) == pytest.approx(10.0, rel=1e-3)
