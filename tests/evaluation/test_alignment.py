# SPDX-License-Identifier: BSD-3-Clause
"""Alignments recover the transform that was applied, and forgive only what their names say."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from coclo_vio.evaluation.alignment import (
    align,
    align_se3,
    align_yaw_position,
    heading_error_rad,
    level_body,
    nearest_rotation,
    tie_attitude,
    tie_start,
)
from coclo_vio.geometry import se3, so3
from coclo_vio.values.trajectory import Trajectory

METRES = st.floats(-10.0, 10.0)


def wander(seed: int, count: int = 200) -> Trajectory:
    rng = np.random.default_rng(seed)
    positions = np.cumsum(rng.normal(0.0, 0.05, (count, 3)), axis=0)
    rotations = Rotation.from_rotvec(np.cumsum(rng.normal(0.0, 0.02, (count, 3)), axis=0)).as_matrix()
    return Trajectory(np.arange(count) * 10_000_000, se3.transform(rotations, positions))


@settings(max_examples=30, deadline=None, derandomize=True)
@given(yaw=st.floats(-3.1, 3.1), x=METRES, y=METRES, z=METRES, seed=st.integers(0, 100))
def test_yaw_and_position_are_recovered_by_every_alignment(yaw, x, y, z, seed):
    T_reference_estimate = se3.transform(so3.about_z(yaw), np.array([x, y, z]))
    estimate = wander(seed)
    reference = estimate.moved(T_reference_estimate)
    for kind in ("yaw_position", "se3", "start"):
        np.testing.assert_allclose(align(kind, estimate, reference, 1.0), T_reference_estimate, atol=1e-9)


def test_only_se3_forgives_a_tilt():
    estimate = wander(1)
    T_tilted = se3.transform(so3.exp(np.array([0.1, 0.05, 0.3])), np.array([1.0, 2.0, 3.0]))
    reference = estimate.moved(T_tilted)
    np.testing.assert_allclose(align_se3(estimate, reference), T_tilted, atol=1e-9)
    left = estimate.moved(align_yaw_position(estimate, reference)).positions - reference.positions
    assert np.linalg.norm(left, axis=1).max() > 0.01


def test_se3_never_reflects():
    estimate = wander(2)
    mirrored = Trajectory(
        estimate.stamps_ns, se3.transform(estimate.rotations, estimate.positions * np.array([1.0, 1.0, -1.0]))
    )
    assert np.linalg.det(align_se3(estimate, mirrored)[:3, :3]) == pytest.approx(1.0)


def test_start_is_tied_over_its_window_only():
    estimate = wander(3)
    bent = np.array(estimate.T_world_body)
    bent[101:, :3, 3] += 5.0
    np.testing.assert_allclose(tie_start(estimate, Trajectory(estimate.stamps_ns, bent), 1.0), np.eye(4), atol=1e-12)
    assert np.abs(tie_start(estimate, Trajectory(estimate.stamps_ns, bent), 1.5)[:3, 3]).max() > 1.0


def test_an_attitude_is_tied_over_its_window_only():
    estimate = wander(8)
    T_tilted = se3.transform(so3.exp(np.array([0.9, -0.5, 2.0])), np.array([1.0, 2.0, 3.0]))
    reference = np.array(estimate.moved(T_tilted).T_world_body)
    reference[101:] = reference[101:] @ se3.exp(np.array([0.3, 0.0, 0.0, 1.0, 0.0, 0.0]))
    tied = tie_attitude(estimate, Trajectory(estimate.stamps_ns, reference), 1.0)
    np.testing.assert_allclose(tied, T_tilted, atol=1e-9)


def test_heading_errors_at_half_a_turn_average_to_half_a_turn():
    estimate = wander(4)
    noise = np.array([so3.about_z(np.pi + 0.01 * (-1.0) ** row) for row in range(len(estimate))])
    reference = Trajectory(estimate.stamps_ns, se3.transform(noise @ estimate.rotations, np.array(estimate.positions)))
    assert abs(so3.yaw(tie_start(estimate, reference, 1.0)[:3, :3])) == pytest.approx(np.pi, abs=1e-3)
    assert np.abs(heading_error_rad(estimate, reference)).min() > 3.1


def test_a_body_that_does_not_move_has_no_yaw():
    still = Trajectory(np.arange(5) * 10_000_000, np.tile(np.eye(4), (5, 1, 1)))
    np.testing.assert_array_equal(align_yaw_position(still, still), np.eye(4))


def test_level_body_takes_out_how_the_markers_are_mounted():
    estimate = wander(5)
    mounted = se3.transform(so3.exp(np.array([0.05, -0.03, 0.0])), np.zeros(3))
    reference = Trajectory(estimate.stamps_ns, estimate.T_world_body @ mounted)
    levelled = level_body(estimate, reference, 1.0)
    np.testing.assert_array_equal(levelled.positions, estimate.positions)
    tilts_deg = [
        np.degrees(np.linalg.norm(so3.log(np.swapaxes(each.rotations, 1, 2) @ estimate.rotations)[:, :2], axis=1)).max()
        for each in (reference, levelled)
    ]
    assert tilts_deg[0] > 3.0
    assert tilts_deg[1] < 0.2


def test_nearest_rotation_of_a_scaled_rotation_is_the_rotation():
    R = Rotation.random(rng=np.random.default_rng(6)).as_matrix()
    np.testing.assert_allclose(nearest_rotation(3.0 * R), R, atol=1e-12)


@pytest.mark.parametrize("yaw", [-2.0, 0.3, 3.0])
def test_a_body_whose_x_axis_is_vertical_has_a_heading_error_too(yaw):
    """As EuRoC's, whose IMU looks up along x: the estimate's tilt errors turn its x axis about anywhere."""
    rng = np.random.default_rng(7)
    upright = so3.exp(np.array([0.0, -0.5 * np.pi, 0.0]))
    noise = so3.exp(np.column_stack((rng.normal(0.0, 0.03, (50, 2)), np.zeros(50))))
    estimate = Trajectory(np.arange(50) * 10_000_000, se3.transform(noise @ upright, rng.normal(0.0, 0.1, (50, 3))))
    assert np.std(so3.yaw(estimate.rotations)) > 1.0, "its heading is no more than noise"
    reference = Trajectory(
        estimate.stamps_ns, se3.transform(np.tile(so3.about_z(yaw) @ upright, (50, 1, 1)), np.zeros((50, 3)))
    )
    errors = heading_error_rad(estimate, reference) - yaw
    np.testing.assert_allclose(np.arctan2(np.sin(errors), np.cos(errors)), 0.0, atol=0.003)
    assert so3.yaw(tie_start(estimate, reference, 1.0)[:3, :3]) == pytest.approx(yaw, abs=1e-3)


def test_a_heading_error_is_known_where_the_tracked_body_lies_on_its_side():
    """The reference's body is turned a quarter about y: its x axis is vertical where the estimate's is level."""
    quarter = so3.exp(np.array([0.0, 0.5 * np.pi, 0.0]))
    level = np.tile(np.eye(4), (3, 1, 1))
    estimate = Trajectory(np.arange(3) * 10_000_000, level)
    reference = Trajectory(
        estimate.stamps_ns, se3.transform(np.tile(so3.about_z(0.7) @ quarter, (3, 1, 1)), level[:, :3, 3])
    )
    np.testing.assert_allclose(heading_error_rad(estimate, reference), 0.7, atol=1e-12)
