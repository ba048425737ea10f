# SPDX-License-Identifier: BSD-3-Clause
"""How the smoother starts: levelled by gravity from rest, or in motion after a wait."""

from dataclasses import dataclass

import numpy as np

from coclo_vio.backend.window.config import StartConfig
from coclo_vio.geometry import so3
from coclo_vio.robot.standstill import ImuMeans, StandstillDetector, StartRule
from coclo_vio.values.arrays import Array
from coclo_vio.values.units import NS_PER_S

FIXED_SIGMA = 1e-4  # rad and m: the world is defined by the first keyframe


@dataclass(frozen=True, slots=True, eq=False)
class Start:
    """The first keyframe.

    Attributes:
        T_world_body: heading zero, at the origin, (4, 4).
        covariance: of pose and velocity, as that of ``StateEstimate``, (9, 9).
        rest: mean IMU readings at rest; None in motion.
        outputs_from_ns: earlier frames get no estimate, since gravity is still being estimated.
    """

    T_world_body: Array
    covariance: Array
    rest: ImuMeans | None
    outputs_from_ns: int


class Starter:
    """Waits for rest, for ``rest_timeout_s`` at most; where nothing measures gravity it starts with the first frame."""

    def __init__(self, config: StartConfig, rotation_body_imu: Array, *, measures_gravity: bool) -> None:
        self._config, self._rotation_body_imu = config, rotation_body_imu
        self._measures_gravity = measures_gravity
        self._rule = StartRule(config.rest_timeout_s)

    def try_at(self, stamp_ns: int, detector: StandstillDetector) -> Start | None:
        """The start at a frame; None as long as it waits for rest."""
        rest, means = detector.rest, detector.means
        if not self._rule.is_met(stamp_ns, rest) and (means is not None or self._measures_gravity):
            return None
        T = np.eye(4)
        level = rest or means
        if level is not None:
            T[:3, :3] = _levelled(self._rotation_body_imu @ level.specific_force)
        wait_ns = round(self._config.alignment_s * NS_PER_S) if self._measures_gravity and rest is None else 0
        return Start(T, self._covariance(T, is_at_rest=rest is not None), rest, stamp_ns + wait_ns)

    def _covariance(self, T_world_body: Array, *, is_at_rest: bool) -> Array:
        """Position and heading are zero by definition; tilt is uncertain where the IMU measures it."""
        config, rotation = self._config, T_world_body[:3, :3]
        tilt = config.rest_tilt_rad if is_at_rest else config.moving_tilt_rad
        tilt = tilt if self._measures_gravity else FIXED_SIGMA
        speed = config.rest_velocity_mps if is_at_rest else config.moving_velocity_mps
        covariance = np.zeros((9, 9))
        covariance[:3, :3] = rotation.T @ np.diag(np.square([tilt, tilt, FIXED_SIGMA])) @ rotation
        covariance[3:6, 3:6] = np.eye(3) * FIXED_SIGMA**2
        covariance[6:, 6:] = np.eye(3) * speed**2
        return covariance


def _levelled(specific_force: Array) -> Array:
    """The rotation of a body that measures this force at rest; identity where it measures no force."""
    return so3.from_gravity(specific_force) if np.linalg.norm(specific_force) > 1.0 else np.eye(3)
