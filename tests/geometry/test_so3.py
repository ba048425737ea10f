# SPDX-License-Identifier: BSD-3-Clause
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rotation_samples import BELOW_PI, GENERIC, NEAR_PI, NEAR_ZERO, ROTVECS, TRANSLATIONS
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from coclo_vio.geometry import so3
from coclo_vio.values.arrays import Array

_STEP = 1e-6


def _derivative(function: Callable[[Array], Array]) -> Array:
    """Central differences of a vector function of a rotation vector at zero, (3, 3)."""
    return np.stack([(function(step) - function(-step)) / (2 * _STEP) for step in _STEP * np.eye(3)], axis=1)


@given(TRANSLATIONS, TRANSLATIONS)
def test_hat_is_the_cross_product(a: Array, b: Array) -> None:
    np.testing.assert_allclose(so3.hat(a) @ b, np.cross(a, b), atol=1e-12)


@given(ROTVECS)
def test_exp_is_the_matrix_exponential_of_hat(rotvec: Array) -> None:
    np.testing.assert_allclose(so3.exp(rotvec), expm(so3.hat(rotvec)), atol=1e-13)


@given(ROTVECS)
def test_exp_is_a_rotation(rotvec: Array) -> None:
    rotation = so3.exp(rotvec)
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-14)
    assert np.linalg.det(rotation) == pytest.approx(1.0, abs=1e-14)


def test_exp_and_its_jacobians_are_exact_at_zero() -> None:
    zero = np.zeros(3)
    for function in (so3.exp, so3.right_jacobian, so3.right_jacobian_inverse):
        np.testing.assert_array_equal(function(zero), np.eye(3))
    np.testing.assert_array_equal(so3.log(np.eye(3)), zero)
    np.testing.assert_array_equal(so3.log_below_pi(np.eye(3)), zero)


@given(BELOW_PI)
def test_log_is_the_inverse_of_exp(rotvec: Array) -> None:
    np.testing.assert_allclose(so3.log(so3.exp(rotvec)), rotvec, rtol=1e-10, atol=1e-15)


@given(NEAR_PI)
def test_log_is_exact_near_pi(rotvec: Array) -> None:
    """The rotation is what has to come back: at pi itself the vector is defined up to its sign only."""
    back = so3.log(so3.exp(rotvec))
    np.testing.assert_allclose(so3.exp(back), so3.exp(rotvec), atol=1e-14)
    assert np.linalg.norm(back) == pytest.approx(np.linalg.norm(rotvec), abs=1e-14 + 1e-9)


@given(BELOW_PI)
def test_log_below_pi_equals_log(rotvec: Array) -> None:
    rotation = so3.exp(rotvec)
    np.testing.assert_allclose(so3.log_below_pi(rotation), so3.log(rotation), rtol=1e-9, atol=1e-15)


@given(st.sampled_from([1e-2, 1e-3]), st.integers(0, 2))
def test_log_below_pi_keeps_nine_digits_up_to_a_thousandth_of_pi(below: float, axis: int) -> None:
    rotvec = (np.pi - below) * np.eye(3)[axis]
    np.testing.assert_allclose(so3.log_below_pi(so3.exp(rotvec)), rotvec, atol=1e-9)


@given(st.one_of(GENERIC, NEAR_ZERO, NEAR_PI))
def test_right_jacobian_is_the_derivative_of_exp(rotvec: Array) -> None:
    expected = _derivative(lambda step: so3.log_below_pi(so3.exp(rotvec).T @ so3.exp(rotvec + step)))
    np.testing.assert_allclose(so3.right_jacobian(rotvec), expected, atol=1e-8)


@given(BELOW_PI)
def test_right_jacobian_inverse_is_the_derivative_of_log(rotvec: Array) -> None:
    expected = _derivative(lambda step: so3.log(so3.exp(rotvec) @ so3.exp(step)))
    np.testing.assert_allclose(so3.right_jacobian_inverse(rotvec), expected, atol=1e-7)


@given(ROTVECS)
def test_right_jacobian_inverse_is_the_inverse(rotvec: Array) -> None:
    product = so3.right_jacobian(rotvec) @ so3.right_jacobian_inverse(rotvec)
    np.testing.assert_allclose(product, np.eye(3), atol=1e-10)


def test_every_function_takes_stacks() -> None:
    rotvecs = np.random.default_rng(1).normal(size=(4, 5, 3))
    for function in (so3.exp, so3.right_jacobian, so3.right_jacobian_inverse, so3.hat):
        one_by_one = np.array([[function(rotvec) for rotvec in row] for row in rotvecs])
        np.testing.assert_allclose(function(rotvecs), one_by_one, atol=1e-15)
    rotations = so3.exp(rotvecs)
    for inverse in (so3.log, so3.log_below_pi):
        np.testing.assert_allclose(inverse(rotations), inverse(rotations.reshape(-1, 3, 3)).reshape(4, 5, 3))


def test_quaternion_order_is_in_the_name() -> None:
    """A quarter turn left about z: scalar cos 45 deg, vector sin 45 deg along z."""
    half = np.sqrt(0.5)
    quarter = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    np.testing.assert_allclose(so3.to_quat_xyzw(quarter), [0.0, 0.0, half, half], atol=1e-15)
    np.testing.assert_allclose(so3.from_quat_xyzw(np.array([0.0, 0.0, half, half])), quarter, atol=1e-15)
    np.testing.assert_allclose(so3.from_quat_wxyz(np.array([half, 0.0, 0.0, half])), quarter, atol=1e-15)


@given(ROTVECS)
def test_quaternions_round_trip_with_w_not_negative(rotvec: Array) -> None:
    rotation = so3.exp(rotvec)
    quat_xyzw = so3.to_quat_xyzw(rotation)
    assert quat_xyzw[3] >= 0.0
    np.testing.assert_allclose(so3.from_quat_xyzw(3.0 * quat_xyzw), rotation, atol=1e-14)


@given(st.floats(-3.1, 3.1))
def test_yaw_is_the_heading_of_the_body_x_axis_left_turn_positive(angle_rad: float) -> None:
    rotation = so3.about_z(angle_rad)
    assert so3.yaw(rotation) == pytest.approx(angle_rad, abs=1e-14)
    np.testing.assert_allclose(rotation @ [1.0, 0.0, 0.0], [np.cos(angle_rad), np.sin(angle_rad), 0.0], atol=1e-14)


@given(BELOW_PI, st.floats(0.1, 20.0))
def test_from_gravity_points_the_specific_force_up_with_zero_yaw(rotvec: Array, strength: float) -> None:
    specific_force = strength * so3.exp(rotvec)[2]  # R^T up: what a body at rest with this attitude reads
    rotation = so3.from_gravity(specific_force)
    np.testing.assert_allclose(rotation @ specific_force, [0.0, 0.0, strength], atol=1e-12)
    assert np.linalg.det(rotation) == pytest.approx(1.0, abs=1e-12)
    assert rotation[1, 0] == pytest.approx(0.0, abs=1e-12)
    assert rotation[0, 0] >= -1e-12


def test_from_gravity_of_a_tilted_body_is_its_roll_and_pitch() -> None:
    rotation = Rotation.from_euler("ZYX", [0.0, 0.2, -0.3]).as_matrix()
    np.testing.assert_allclose(so3.from_gravity(9.81 * rotation[2]), rotation, atol=1e-14)


def test_from_gravity_refuses_free_fall() -> None:
    with pytest.raises(ValueError, match="no direction to align with gravity"):
        so3.from_gravity(np.zeros(3))
