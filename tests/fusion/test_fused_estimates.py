# SPDX-License-Identifier: BSD-3-Clause
"""Errors of vision that last are in the covariance of both trajectories, and in no estimate."""

import numpy as np

from coclo_vio.backend.window.config import SmootherConfig
from coclo_vio.fusion.fused_estimates import FusedEstimates
from coclo_vio.geometry import so3
from coclo_vio.values.arrays import Array
from coclo_vio.values.estimates import NavState, StateEstimate

KNOWN = np.diag(np.full(9, 1e-8))
DIRECTION_RAD, HEADING = 0.001, 0.01


def estimate(stamp_ns: int, position: Array, heading: float = 0.0) -> StateEstimate:
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = so3.exp(np.array([0.0, 0.0, heading])), position
    return StateEstimate(stamp_ns, NavState(T, np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(3)), KNOWN)


def test_they_grow_with_the_path_of_the_frames_and_hold_between_them() -> None:
    config = SmootherConfig(direction_sigma_rad=DIRECTION_RAD, heading_sigma=HEADING)
    made = FusedEstimates("joints", "frames", config)
    for step in range(11):
        made.of_frame(estimate(step, np.array([0.2 * step, 0.0, 0.0])))
    turned = estimate(11, np.array([2.0, 0.0, 0.0]), heading=0.5 * np.pi)
    frame = made.of_frame(turned)
    assert frame.name == "frames"
    np.testing.assert_array_equal(frame.state.nav.T_world_body, turned.nav.T_world_body)
    added = frame.state.covariance - KNOWN
    off_m = 2.0 * DIRECTION_RAD  # to the side of the way: forwards in body axes after the turn
    np.testing.assert_allclose(np.sqrt(np.diag(added)[2:6]), [0.5 * np.pi * HEADING, off_m, 0.0, off_m], atol=1e-12)
    between = made.of_joints(estimate(12, np.array([2.1, 0.0, 0.0]), heading=0.5 * np.pi))
    assert between.name == "joints"
    np.testing.assert_allclose(between.state.covariance, frame.state.covariance)


def test_without_a_configuration_nothing_is_added() -> None:
    made = FusedEstimates("joints", "frames")
    for step in range(3):
        frame = made.of_frame(estimate(step, np.array([0.2 * step, 0.0, 0.0]), heading=0.1 * step))
        np.testing.assert_array_equal(frame.state.covariance, KNOWN)
