# SPDX-License-Identifier: BSD-3-Clause
"""The error of the tilt in the covariance of a path."""

import numpy as np

from coclo_vio.backend.window.frame_estimate import FrameEstimate
from coclo_vio.backend.window.tilt_errors import TiltErrors
from coclo_vio.geometry import so3
from coclo_vio.values.arrays import Array

FORWARDS = np.array([0.1, 0.0, 0.0])
PITCH_RAD, YAW_RAD = 0.005, 0.3


def frame(R: Array, position: Array, pitch_rad: float = PITCH_RAD) -> FrameEstimate:
    T, covariance = np.eye(4), np.zeros((9, 9))
    T[:3, :3], T[:3, 3] = R, position
    covariance[1, 1], covariance[2, 2] = pitch_rad**2, YAW_RAD**2
    return FrameEstimate(0, T, np.zeros(3), covariance)


def test_a_straight_way_climbs_by_the_pitch_and_yaw_adds_nothing() -> None:
    errors = TiltErrors()
    for step in range(51):
        covariance = errors.advance(frame(np.eye(3), step * FORWARDS))
    np.testing.assert_allclose(covariance, np.diag([0.0, 0.0, (5.0 * PITCH_RAD) ** 2]), atol=1e-15)


def test_a_loop_climbs_on_every_side_as_the_tilt_turns_with_the_body() -> None:
    errors, position = TiltErrors(), np.zeros(3)
    errors.advance(frame(np.eye(3), position))
    for step in range(60):
        R = so3.exp(np.array([0.0, 0.0, 2.0 * np.pi * step / 60.0]))
        position = position + R @ FORWARDS
        covariance = errors.advance(frame(R, position))
    np.testing.assert_allclose(np.sqrt(np.diag(covariance)), [0.0, 0.0, 6.0 * PITCH_RAD], atol=1e-9)


def test_what_was_climbed_stays_when_the_tilt_is_known() -> None:
    errors = TiltErrors()
    for step in range(101):
        covariance = errors.advance(frame(np.eye(3), step * FORWARDS, PITCH_RAD if step <= 50 else 0.0))
    np.testing.assert_allclose(covariance[2, 2], (5.0 * PITCH_RAD) ** 2)


def test_a_robot_that_stands_adds_nothing() -> None:
    errors = TiltErrors()
    for _ in range(10):
        covariance = errors.advance(frame(np.eye(3), np.ones(3), 0.05))
    np.testing.assert_array_equal(covariance, 0.0)
