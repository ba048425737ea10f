# SPDX-License-Identifier: BSD-3-Clause
import gtsam
import numpy as np
import pytest
from hypothesis import given
from rotation_samples import BELOW_PI, NEAR_PI, ROTVECS, TRANSLATIONS, twists
from scipy.linalg import expm

from coclo_vio.geometry import se3, so3
from coclo_vio.values.arrays import Array

_STEP = 1e-6
TWISTS = twists(ROTVECS)
TWISTS_BELOW_PI = twists(BELOW_PI)
ZERO_ROTATION = TRANSLATIONS.map(lambda translation: np.concatenate((np.zeros(3), translation)))


def _small_adjoint(twist: Array) -> Array:
    matrix = np.zeros((6, 6))
    matrix[:3, :3] = matrix[3:, 3:] = so3.hat(twist[:3])
    matrix[3:, :3] = so3.hat(twist[3:])
    return matrix


def _right_jacobian_by_series(twist: Array) -> Array:
    """sum of (-ad)^k / (k + 1)!; at pi the 40th term is below 1e-25."""
    term = total = np.eye(6)
    for k in range(1, 40):
        term = term @ -_small_adjoint(twist) / (k + 1)
        total = total + term
    return total


def _hat(twist: Array) -> Array:
    matrix = np.zeros((4, 4))
    matrix[:3, :3] = so3.hat(twist[:3])
    matrix[:3, 3] = twist[3:]
    return matrix


@given(TWISTS)
def test_exp_is_the_matrix_exponential(twist: Array) -> None:
    np.testing.assert_allclose(se3.exp(twist), expm(_hat(twist)), atol=1e-11)


@given(ZERO_ROTATION)
def test_a_twist_without_rotation_is_its_translation(twist: Array) -> None:
    T = se3.exp(twist)
    np.testing.assert_array_equal(T[:3, :3], np.eye(3))
    np.testing.assert_allclose(T[:3, 3], twist[3:], rtol=1e-15)
    np.testing.assert_allclose(se3.log(T), twist, rtol=1e-15)


@given(TWISTS_BELOW_PI)
def test_log_is_the_inverse_of_exp(twist: Array) -> None:
    np.testing.assert_allclose(se3.log(se3.exp(twist)), twist, atol=1e-9)


@given(twists(NEAR_PI))
def test_log_near_pi_gives_a_twist_of_the_same_transform(twist: Array) -> None:
    T = se3.exp(twist)
    np.testing.assert_allclose(se3.exp(se3.log(T)), T, atol=1e-9)


@given(TWISTS_BELOW_PI)
def test_twists_are_those_of_gtsam_rotation_first(twist: Array) -> None:
    np.testing.assert_allclose(se3.exp(twist), gtsam.Pose3.Expmap(twist).matrix(), atol=1e-9)


@given(TWISTS_BELOW_PI)
def test_right_jacobian_is_the_derivative_of_exp(twist: Array) -> None:
    to_twist = se3.inverse(se3.exp(twist))
    columns = [
        (se3.log(to_twist @ se3.exp(twist + step)) - se3.log(to_twist @ se3.exp(twist - step))) / (2 * _STEP)
        for step in _STEP * np.eye(6)
    ]
    np.testing.assert_allclose(se3.right_jacobian(twist), np.stack(columns, axis=1), atol=1e-5)


@given(TWISTS_BELOW_PI)
def test_right_jacobian_inverse_is_the_derivative_of_log(twist: Array) -> None:
    T = se3.exp(twist)
    columns = [(se3.log(T @ se3.exp(step)) - se3.log(T @ se3.exp(-step))) / (2 * _STEP) for step in _STEP * np.eye(6)]
    scale = 1.0 + np.abs(se3.right_jacobian_inverse(twist)).max()
    np.testing.assert_allclose(se3.right_jacobian_inverse(twist), np.stack(columns, axis=1), atol=1e-5 * scale)


@given(TWISTS)
def test_jacobians_keep_their_digits_at_every_angle(twist: Array) -> None:
    """Pinocchio's lose eleven of them between 1e-4 and 1e-2 rad."""
    expected = _right_jacobian_by_series(twist)
    np.testing.assert_allclose(se3.right_jacobian(twist), expected, atol=1e-12)
    np.testing.assert_allclose(se3.right_jacobian_inverse(twist) @ expected, np.eye(6), atol=1e-11)


@given(ZERO_ROTATION)
def test_jacobians_at_zero_rotation_hold_the_translation(twist: Array) -> None:
    """Closed form there: J_r = [[1, 0], [-hat(t) / 2, 1]]."""
    expected = np.eye(6)
    expected[3:, :3] = -0.5 * so3.hat(twist[3:])
    np.testing.assert_allclose(se3.right_jacobian(twist), expected, atol=1e-12)
    expected[3:, :3] *= -1.0
    np.testing.assert_allclose(se3.right_jacobian_inverse(twist), expected, atol=1e-12)


@given(TWISTS, twists(BELOW_PI))
def test_adjoint_carries_a_twist_through_a_transform(pose: Array, twist: Array) -> None:
    T = se3.exp(pose)
    np.testing.assert_allclose(T @ se3.exp(twist), se3.exp(se3.adjoint(T) @ twist) @ T, atol=1e-8)


@given(TWISTS)
def test_inverse_undoes(twist: Array) -> None:
    T = se3.exp(twist)
    np.testing.assert_allclose(se3.inverse(T) @ T, np.eye(4), atol=1e-12)


def test_frames_cancel_in_products_and_in_apply() -> None:
    """``T_world_imu = T_world_body @ T_body_imu``: a point of the imu frame goes to body, then to world."""
    T_world_body = se3.transform(so3.about_z(np.pi / 2), np.array([10.0, 0.0, 0.0]))
    T_body_imu = se3.transform(np.eye(3), np.array([1.0, 0.0, 0.5]))
    point_imu = np.array([0.0, 2.0, 0.0])
    in_body = se3.apply(T_body_imu, point_imu)
    np.testing.assert_allclose(in_body, [1.0, 2.0, 0.5])
    np.testing.assert_allclose(se3.apply(T_world_body, in_body), [8.0, 1.0, 0.5], atol=1e-15)
    np.testing.assert_allclose(se3.apply(T_world_body @ T_body_imu, point_imu), [8.0, 1.0, 0.5], atol=1e-15)


def test_transform_inverse_and_apply_take_stacks() -> None:
    rng = np.random.default_rng(2)
    rotations, translations, points = so3.exp(rng.normal(size=(7, 3))), rng.normal(size=(7, 3)), rng.normal(size=(7, 3))
    transforms = se3.transform(rotations, translations)
    assert transforms.shape == (7, 4, 4)
    for T, inverse, point, image in zip(
        transforms, se3.inverse(transforms), points, se3.apply(transforms, points), strict=True
    ):
        np.testing.assert_allclose(inverse, np.linalg.inv(T), atol=1e-14)
        np.testing.assert_allclose(image, (T @ [*point, 1.0])[:3], atol=1e-14)


def test_log_of_a_half_turn_has_length_pi() -> None:
    T = se3.transform(so3.about_z(np.pi), np.array([1.0, 2.0, 3.0]))
    assert np.linalg.norm(se3.log(T)[:3]) == pytest.approx(np.pi, abs=1e-7)
