# SPDX-License-Identifier: BSD-3-Clause
"""SE(3) as plain 4x4 matrices. Tangent vectors are ``[rotation (3), translation (3)]`` as in GTSAM's Pose3.

exp and log are Pinocchio's, which is translation first: the permutation is only here. Its Jacobians are not used:
between 1e-4 and 1e-2 rad they lose up to eleven digits (8e-5 of an entry of 20 at 3e-4 rad).
"""

import numpy as np
import pinocchio as pin
from scipy.linalg import expm

from coclo_vio.geometry import so3
from coclo_vio.geometry.array_types import Array


def _swap(twist: Array) -> Array:
    return np.concatenate((twist[3:], twist[:3]))


def transform(rotation: Array, translation: Array) -> Array:
    """Rigid transforms ``(..., 4, 4)`` of rotations ``(..., 3, 3)`` and translations ``(..., 3)`` in metres."""
    matrices = np.zeros((*translation.shape[:-1], 4, 4))
    matrices[..., :3, :3] = rotation
    matrices[..., :3, 3] = translation
    matrices[..., 3, 3] = 1.0
    return matrices


def inverse(transforms: Array) -> Array:
    """Inverses ``(..., 4, 4)``: ``T_b_a`` of ``T_a_b``."""
    rotation = np.swapaxes(transforms[..., :3, :3], -1, -2)
    translation = -np.einsum("...ij,...j->...i", rotation, transforms[..., :3, 3])
    return transform(rotation, translation)


def apply(transforms: Array, points: Array) -> Array:
    """Points ``(..., 3)`` of frame b in frame a, under ``T_a_b`` ``(..., 4, 4)``."""
    rotated: Array = np.einsum("...ij,...j->...i", transforms[..., :3, :3], points)
    return rotated + transforms[..., :3, 3]


def exp(twist: Array) -> Array:
    """The transform ``(4, 4)`` of a twist ``(6,)`` = [rotation rad, translation m]."""
    return np.asarray(pin.exp6(_swap(twist)).homogeneous, dtype=np.float64)


def log(T: Array) -> Array:
    """The twist ``(6,)`` = [rotation rad, translation m] of a transform ``(4, 4)``."""
    return _swap(np.asarray(pin.log6(pin.SE3(T)).vector, dtype=np.float64))


def right_jacobian(twist: Array) -> Array:
    """``J_r (6, 6)``: ``exp(x + d) = exp(x) exp(J_r d)`` to first order.

    ``J_r = sum over k of (-ad_x)^k / (k + 1)!``, a block of the exponential of ``[[-ad_x, 1], [0, 0]]`` (Van Loan,
    "Computing integrals involving the matrix exponential", 1978): accurate at zero too.
    """
    rotation_hat = so3.hat(twist[:3])
    block = np.zeros((12, 12))
    block[:3, :3] = block[3:6, 3:6] = -rotation_hat
    block[3:6, :3] = -so3.hat(twist[3:])
    block[:6, 6:] = np.eye(6)
    return np.asarray(expm(block)[:6, 6:], dtype=np.float64)


def right_jacobian_inverse(twist: Array) -> Array:
    """``J_r^-1 (6, 6)``: ``log(exp(x) exp(d)) = x + J_r^-1 d`` to first order, for rotations below 2 pi."""
    diagonal = so3.right_jacobian_inverse(twist[:3])
    matrix = np.zeros((6, 6))
    matrix[:3, :3] = matrix[3:, 3:] = diagonal
    matrix[3:, :3] = -diagonal @ right_jacobian(twist)[3:, :3] @ diagonal
    return matrix


def adjoint(T: Array) -> Array:
    """``Ad_T (6, 6)``: ``T exp(x) = exp(Ad_T x) T``."""
    rotation = T[:3, :3]
    matrix = np.zeros((6, 6))
    matrix[:3, :3] = rotation
    matrix[3:, 3:] = rotation
    matrix[3:, :3] = so3.hat(T[:3, 3]) @ rotation
    return matrix
