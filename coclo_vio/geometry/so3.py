# SPDX-License-Identifier: BSD-3-Clause
"""SO(3) on stacks of rotations: every function takes ``(..., 3)`` vectors or ``(..., 3, 3)`` matrices.

For batches of sigma points: few NumPy calls, exact at zero. ``log`` goes through SciPy's
quaternions, exact near pi. Source: Sola, Deray, Atchuthan, "A micro Lie theory for state estimation in
robotics", 2018, appendix B.
"""

import numpy as np
from scipy.spatial.transform import Rotation

from coclo_vio.geometry.array_types import Array

_SMALL_ANGLE_RAD = 1e-4
TINY = 1e-300  # added to a square, it avoids 0 / 0 and changes no other quotient
_IDENTITY = np.eye(3)


def hat(vectors: Array) -> Array:
    """Skew-symmetric matrices ``(..., 3, 3)`` of ``(..., 3)`` vectors: ``hat(a) @ b = a x b``."""
    matrices = np.zeros((*vectors.shape, 3))
    matrices[..., 2, 1] = vectors[..., 0]
    matrices[..., 0, 2] = vectors[..., 1]
    matrices[..., 1, 0] = vectors[..., 2]
    matrices[..., 1, 2] = -vectors[..., 0]
    matrices[..., 2, 0] = -vectors[..., 1]
    matrices[..., 0, 1] = -vectors[..., 2]
    return matrices


def exp(rotvecs: Array) -> Array:
    """Rotation matrices ``(..., 3, 3)`` of rotation vectors ``(..., 3)`` in radians (Rodrigues).

    ``I + sin(t)/t K + 2 (sin(t/2)/t)^2 K^2``: both quotients are accurate for every t above zero.
    """
    angle = np.sqrt(np.einsum("...i,...i->...", rotvecs, rotvecs) + TINY)
    sinc = np.sin(angle) / angle
    half = 2.0 * (np.sin(0.5 * angle) / angle) ** 2
    skew = hat(rotvecs)
    rotations: Array = _IDENTITY + sinc[..., None, None] * skew + half[..., None, None] * (skew @ skew)
    return rotations


def log(rotations: Array) -> Array:
    """Rotation vectors ``(..., 3)`` in radians, at most pi long, of rotation matrices ``(..., 3, 3)``."""
    flat = rotations.reshape(-1, 3, 3)
    return np.asarray(Rotation.from_matrix(flat).as_rotvec(), dtype=np.float64).reshape(rotations.shape[:-1])


def log_below_pi(rotations: Array) -> Array:
    """The same as ``log``, several times faster; loses digits within 1e-3 rad of pi."""
    skew = 0.5 * (rotations - np.swapaxes(rotations, -1, -2))
    axis_sine = np.stack((skew[..., 2, 1], skew[..., 0, 2], skew[..., 1, 0]), axis=-1)
    sine = np.sqrt(np.einsum("...i,...i->...", axis_sine, axis_sine) + TINY)
    cosine = 0.5 * (np.einsum("...ii->...", rotations) - 1.0)
    return np.asarray((np.arctan2(sine, cosine) / sine)[..., None] * axis_sine)


def right_jacobian(rotvecs: Array) -> Array:
    """Right Jacobians ``(..., 3, 3)``: ``exp(p + d) = exp(p) exp(J_r(p) d)`` to first order (Sola, eq. 143)."""
    squared = np.einsum("...i,...i->...", rotvecs, rotvecs)
    angle = np.sqrt(squared)
    small = angle < _SMALL_ANGLE_RAD
    angle = np.where(small, 1.0, angle)
    half = np.where(small, 0.5 - squared / 24.0, 2.0 * (np.sin(0.5 * angle) / angle) ** 2)
    third = np.where(small, 1.0 / 6.0 - squared / 120.0, (angle - np.sin(angle)) / angle**3)
    skew = hat(rotvecs)
    jacobians: Array = np.eye(3) - half[..., None, None] * skew + third[..., None, None] * (skew @ skew)
    return jacobians


def right_jacobian_inverse(rotvecs: Array) -> Array:
    """Inverse right Jacobians ``(..., 3, 3)``, for angles below 2 pi (Sola, eq. 144)."""
    squared = np.einsum("...i,...i->...", rotvecs, rotvecs)
    angle = np.sqrt(squared)
    small = angle < _SMALL_ANGLE_RAD
    safe = np.where(small, 1.0, angle)
    closed = 1.0 / safe**2 - 1.0 / (2.0 * safe * np.tan(0.5 * safe))
    quadratic = np.where(small, 1.0 / 12.0 + squared / 720.0, closed)
    skew = hat(rotvecs)
    return np.eye(3) + 0.5 * skew + quadratic[..., None, None] * (skew @ skew)


def from_quat_xyzw(quat_xyzw: Array) -> Array:
    """Rotation matrices ``(..., 3, 3)`` of quaternions ``(..., 4)``, which need not be normalised."""
    return np.asarray(Rotation.from_quat(quat_xyzw).as_matrix(), dtype=np.float64)


def to_quat_xyzw(rotations: Array) -> Array:
    """Quaternions ``(..., 4)`` with w >= 0 of rotation matrices ``(..., 3, 3)``."""
    return np.asarray(Rotation.from_matrix(rotations).as_quat(canonical=True), dtype=np.float64)


def from_quat_wxyz(quat_wxyz: Array) -> Array:
    """Rotation matrices ``(..., 3, 3)`` of scalar-first quaternions ``(..., 4)`` (EuRoC, MuJoCo)."""
    return from_quat_xyzw(quat_wxyz[..., [1, 2, 3, 0]])


def yaw(rotations: Array) -> Array:
    """Headings ``(...)`` in radians: the angle of the body's x axis in the world's x-y plane (REP 103)."""
    return np.arctan2(rotations[..., 1, 0], rotations[..., 0, 0])


def about_z(angle_rad: float) -> Array:
    """The rotation ``(3, 3)`` by ``angle_rad`` about z."""
    return exp(np.array([0.0, 0.0, angle_rad]))


def from_gravity(specific_force: Array) -> Array:
    """Rotation ``R_world_body`` with zero yaw under which ``specific_force`` ``(3,)``, body frame, points up.

    At rest an accelerometer measures -R^T g, so this is the attitude of a body at rest up to its heading.

    Raises:
        ValueError: the vector is too short to have a direction.
    """
    norm = float(np.linalg.norm(specific_force))
    if norm < 1e-6:
        raise ValueError(f"specific_force has norm {norm:.2g} m/s^2, no direction to align with gravity")
    up = specific_force / norm
    roll, pitch = np.arctan2(up[1], up[2]), np.arctan2(-up[0], np.hypot(up[1], up[2]))
    return np.asarray(Rotation.from_euler("ZYX", [0.0, pitch, roll]).as_matrix(), dtype=np.float64)
