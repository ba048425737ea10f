# SPDX-License-Identifier: BSD-3-Clause
"""The ground under rolling feet: a slope is found by the footholds, stairs are level."""

from collections.abc import Callable

import numpy as np
import pytest
from state_layouts import layout_of, state_of

from coclo_vio.filter import process_model
from coclo_vio.filter.config import GroundConfig
from coclo_vio.filter.ground_plane import UP, GroundPlane
from coclo_vio.filter.stance import FootMotion
from coclo_vio.geometry import so3
from coclo_vio.robot.model import RobotModel
from coclo_vio.values.arrays import Array

HIPS = np.array([[0.3, 0.25], [0.3, -0.25], [0.0, 0.3], [0.0, -0.3], [-0.3, 0.25], [-0.3, -0.25]])
STRIDE_M, STANCE_S = 0.12, 0.5
Height = Callable[[Array], Array]


def slope(share: float) -> Height:
    return lambda x: share * x


def stairs(x: Array) -> Array:
    return np.asarray(0.06 * np.floor(x / 0.2))


def walked(height: Height, cycles: int = 6, *, stance_s: float = STANCE_S, offsets: Array | None = None) -> GroundPlane:
    """One leg after the other stands and lifts off, over ground that rises along x."""
    ground, legs = GroundPlane(6, GroundConfig()), np.arange(6)
    random = np.random.default_rng(5)
    for cycle in range(cycles):
        feet = np.column_stack((HIPS + np.array([cycle * STRIDE_M, 0.0]), np.zeros(6)))
        feet[:, 2] = height(feet[:, 0]) + random.normal(scale=1e-3, size=6) + (0.0 if offsets is None else offsets)
        for leg in legs:
            ground.push(feet, np.ones(6, dtype=np.bool_), stance_s)
            ground.push(feet, legs != leg, stance_s)
    return ground


def test_on_a_slope_all_feet_roll_on_it() -> None:
    normal = np.array([-0.3, 0.0, 1.0]) / np.linalg.norm([0.3, 0.0, 1.0])
    np.testing.assert_allclose(walked(slope(0.3)).normals, np.tile(normal, (6, 1)), atol=0.02)


def test_heights_of_legs_that_are_wrong_by_a_constant_do_not_hide_the_slope() -> None:
    normals = walked(slope(0.3), offsets=np.array([6.0, -8.0, 3.0, 8.0, -4.0, -6.0]) / 1e3).normals
    np.testing.assert_allclose(normals[:, 0] / normals[:, 2], -0.3, atol=0.04)


def test_on_stairs_the_ground_is_level() -> None:
    np.testing.assert_array_equal(walked(stairs, 12).normals, np.tile(UP, (6, 1)))


def test_on_level_ground_the_normals_are_nearly_vertical() -> None:
    normals = walked(slope(0.0)).normals
    np.testing.assert_allclose(normals, np.tile(UP, (6, 1)), atol=0.02)
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, atol=1e-12)


def test_where_a_slope_begins_front_feet_are_on_it_first() -> None:
    normals = walked(lambda x: np.asarray(0.3 * np.maximum(x - 0.55, 0.0)), 8).normals
    assert (normals[:2, 0] < -0.25).all()
    np.testing.assert_allclose(normals[2:], np.tile(UP, (4, 1)), atol=0.03)


@pytest.mark.parametrize(("cycles", "stance_s"), [(1, STANCE_S), (6, 0.004)])
def test_few_footholds_and_short_stances_show_no_slope(cycles: int, stance_s: float) -> None:
    np.testing.assert_array_equal(walked(slope(0.3), cycles, stance_s=stance_s).normals, np.tile(UP, (6, 1)))


def test_after_a_gap_the_ground_is_level_again() -> None:
    ground = walked(slope(0.3))
    ground.clear()
    np.testing.assert_array_equal(ground.normals, np.tile(UP, (6, 1)))
    ground.push(np.zeros((6, 3)), np.zeros(6, dtype=np.bool_), STANCE_S)
    np.testing.assert_array_equal(ground.normals, np.tile(UP, (6, 1)))


def test_a_foot_rolls_along_the_slope(daisy: RobotModel) -> None:
    """Its centre moves by the radius times the rotation, and keeps its distance from the slope."""
    state = state_of(layout_of(6), np.random.default_rng(2))
    state.vector[:] = 0.0
    normal, angle, all_legs = np.array([-0.6, 0.0, 0.8]), 0.01, np.ones(6, dtype=np.bool_)
    turns = np.tile(state.rotation.T @ np.array([0.0, angle, 0.0]), (6, 1))
    motion = FootMotion(
        all_legs, np.zeros((6, 3)), turns, all_legs, np.zeros(6), np.zeros(6), np.tile(normal, (6, 1)), 0.0
    )
    stack = state.__class__(state.layout, state.rotation[None], state.vector[None], state.remembered)
    feet = process_model.predict(stack, 0.01, motion, daisy.foot_radii_m, daisy.hip_position_body).feet[0]
    np.testing.assert_allclose(feet @ normal, 0.0, atol=1e-12)
    rolled = so3.hat(np.array([0.0, angle, 0.0])) @ normal
    np.testing.assert_allclose(feet, daisy.foot_radii_m[:, None] * rolled, atol=1e-12)
