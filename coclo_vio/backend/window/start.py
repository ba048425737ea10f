# SPDX-License-Identifier: BSD-3-Clause
"""How the smoother starts: level by gravity from rest, or on the move after a wait."""

from dataclasses import dataclass

import numpy as np

from coclo_vio.backend.window.config import StartConfig
from coclo_vio.backend.window.inertial import InertialWatch, Quiet
from coclo_vio.geometry import so3
from coclo_vio.values.arrays import Array
from coclo_vio.values.units import NS_PER_S

HELD_SIGMA = 1e-4  # rad and m: the first keyframe is where the world is


@dataclass(frozen=True, slots=True, eq=False)
class Start:
    """The first keyframe.

    Attributes:
        T_world_body: heading zero, at the origin, (4, 4).
        covariance: of pose and velocity, as that of ``StateEstimate``, (9, 9).
        rest: what the IMU read at rest; None on the move.
        silent_until_ns: before this time gravity is still being found, and no pose goes out.
    """

    T_world_body: Array
    covariance: Array
    rest: Quiet | None
    silent_until_ns: int


class Starter:
    """Waits for rest, for ``rest_timeout_s`` at most, where there is an IMU; where there is none, for nothing."""

    def __init__(self, config: StartConfig, rotation_body_imu: Array, *, uses_imu: bool) -> None:
        self._config, self._rotation_body_imu, self._uses_imu = config, rotation_body_imu, uses_imu
        self._first_ns: int | None = None

    def try_at(self, stamp_ns: int, watch: InertialWatch) -> Start | None:
        """The start at a frame; None as long as it is better to wait."""
        self._first_ns = stamp_ns if self._first_ns is None else self._first_ns
        rest, means = watch.quiet, watch.means
        has_waited = stamp_ns - self._first_ns >= self._config.rest_timeout_s * NS_PER_S
        if rest is None and not has_waited and (means is not None or self._uses_imu):
            return None
        T = np.eye(4)
        level = rest or means
        if level is not None:
            T[:3, :3] = _levelled(self._rotation_body_imu @ level.specific_force)
        wait_ns = round(self._config.alignment_s * NS_PER_S) if self._uses_imu and rest is None else 0
        return Start(T, self._covariance(T, is_at_rest=rest is not None), rest, stamp_ns + wait_ns)

    def _covariance(self, T_world_body: Array, *, is_at_rest: bool) -> Array:
        """The world is where the body is, up to what gravity has to tell."""
        config, rotation = self._config, T_world_body[:3, :3]
        tilt = config.rest_tilt_rad if is_at_rest else config.moving_tilt_rad
        tilt = tilt if self._uses_imu else HELD_SIGMA
        speed = config.rest_velocity_mps if is_at_rest else config.moving_velocity_mps
        covariance = np.zeros((9, 9))
        covariance[:3, :3] = rotation.T @ np.diag(np.square([tilt, tilt, HELD_SIGMA])) @ rotation
        covariance[3:6, 3:6] = np.eye(3) * HELD_SIGMA**2
        covariance[6:, 6:] = np.eye(3) * speed**2
        return covariance


def _levelled(specific_force: Array) -> Array:
    """The rotation of a body that measures this force at rest; none where it measures nothing."""
    return so3.from_gravity(specific_force) if np.linalg.norm(specific_force) > 1.0 else np.eye(3)
