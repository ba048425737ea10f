# SPDX-License-Identifier: BSD-3-Clause
"""What errors of the cameras' calibration do to a path by vision, which the window takes for exact.

A wrong baseline or focal length stretches the path from its begin on by a constant share: a way in a straight line is
wrong by that, and a loop that is closed is not.

Cameras that are turned on the body by a small rotation e, while an IMU of the body levels it, measure each displacement
d of the body, in body axes, as ``d + e x d``: a robot that walks forwards climbs or sinks, and walks aside, by a
constant share of its way. An IMU in the housing of the cameras is turned with them: then the path is that of the
cameras, level, and the body is turned in it by e. Its heading where the path begins is the heading of the world by
definition, so the vertical part of e turns the path instead. The lever from the body to the cameras is left out, as it
errs by itself times e.
"""

import numpy as np

from coclo_vio.backend.window.frame_estimate import FrameEstimate
from coclo_vio.geometry import so3
from coclo_vio.values.arrays import Array

_UP = np.array([0.0, 0.0, 1.0])


class CalibrationErrors:
    """Follows a path, and holds the covariance that errors of the calibration add to it."""

    def __init__(self, scale_sigma: float, rotation_sigma_rad: float, *, imu_on_cameras: bool = False) -> None:
        """Take how wrong the calibration may be.

        Args:
            scale_sigma: relative error of lengths.
            rotation_sigma_rad: of the cameras on the body, each axis, rad.
            imu_on_cameras: whether the IMU that levels the path is turned on the body with the cameras.
        """
        self._sigmas = np.array([scale_sigma, *[rotation_sigma_rad] * 3])
        self._imu_on_cameras = imu_on_cameras
        self._position: Array | None = None  # of the last frame, world, m
        self._vertical = np.zeros(3)  # the upward direction in body axes where the path begins
        self._changes = np.zeros((3, 4))  # of the position, world, by the scale and by the rotation

    def advance(self, frame: FrameEstimate) -> Array:
        """Follow the path to a frame; the covariance that the errors add there, as that of ``StateEstimate``, (9, 9).

        Args:
            frame: the next one of the path; the first one is where it begins.
        """
        R, position = frame.T_world_body[:3, :3], frame.T_world_body[:3, 3]
        if self._position is None:
            self._vertical = R[2].copy()
        else:
            self._changes = self._changes + self._changes_of(R, position - self._position)
        self._position = position.copy()
        errors = np.zeros((9, 4))
        if self._imu_on_cameras:
            errors[:3, 1:] = np.eye(3) - np.outer(R[2], self._vertical)
        errors[3:6] = R.T @ self._changes
        errors[6:] = self._changes_of(R, frame.velocity_world)
        errors *= self._sigmas
        return np.asarray(errors @ errors.T)

    def _changes_of(self, R_world_body: Array, vector_world: Array) -> Array:
        """Of a vector by the scale and by the rotation of the cameras on the body, world, (3, 4)."""
        if self._imu_on_cameras:
            by_rotation = np.outer(-np.cross(_UP, vector_world), self._vertical)
        else:
            by_rotation = -R_world_body @ so3.hat(R_world_body.T @ vector_world)
        return np.column_stack((vector_world, by_rotation))
