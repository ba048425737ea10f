# SPDX-License-Identifier: BSD-3-Clause
"""What errors of vision that last do to a path, which the window takes for exact.

A wrong baseline or focal length stretches the path from its begin on by a constant share: a way in a straight line is
wrong by that, and a loop that is closed is not.

Cameras that are turned on the body by a small rotation e, while an IMU of the body levels it, measure each displacement
d of the body, in body axes, as ``d + e x d``: a robot that walks forwards climbs or sinks, and walks aside, by a
constant share of its way. An IMU in the housing of the cameras is turned with them: then the path is that of the
cameras, level, and the body is turned in it by e. Its heading where the path begins is the heading of the world by
definition, so the vertical part of e turns the path instead. The lever from the body to the cameras is left out, as it
errs by itself times e.

Where depths are wrong by an amount that depends on the place in the image, such as those of the floor against those of
walls, displacements are turned too, and no rotation of the body shows it. A right camera that is rolled by 0.6 mrad
turns them by 0.8 mrad where a gyroscope measures rotations (computed for two frames of a floor and walls). A wrong
focal length, and the scale of a gyroscope, make the heading wrong by a constant share of how far the body has turned.
"""

import numpy as np

from coclo_vio.geometry import so3
from coclo_vio.values.arrays import Array

_UP = np.array([0.0, 0.0, 1.0])
_MOUNTING, _HEADING, _ERRORS = slice(1, 4), 7, 8  # after the scale, and with the direction (3) between the two


class LastingErrors:
    """Follows a path, and holds the covariance that errors which last add to it."""

    def __init__(
        self,
        *,
        scale_sigma: float = 0.0,
        rotation_sigma_rad: float = 0.0,
        direction_sigma_rad: float = 0.0,
        heading_sigma: float = 0.0,
        imu_on_cameras: bool = False,
    ) -> None:
        """Take how wrong vision may be.

        Args:
            scale_sigma: relative error of lengths.
            rotation_sigma_rad: of the cameras on the body, each axis, rad.
            direction_sigma_rad: of displacements, about each axis of the body, rad.
            heading_sigma: of the heading, as a share of how far the body has turned.
            imu_on_cameras: whether the IMU that levels the path is turned on the body with the cameras.
        """
        self._sigmas = np.array([scale_sigma, *[rotation_sigma_rad] * 3, *[direction_sigma_rad] * 3, heading_sigma])
        self._imu_on_cameras = imu_on_cameras
        self._before: Array | None = None  # pose at the last frame
        self._vertical = np.zeros(3)  # the upward direction in body axes where the path begins
        self._turned_rad = 0.0  # about the vertical since then
        self._changes = np.zeros((3, _ERRORS))  # of the position, world, by the errors

    def follow(self, T_world_body: Array) -> None:
        """Follow the path to the pose of the next frame, (4, 4); the first one is where it begins."""
        R = T_world_body[:3, :3]
        if self._before is None:
            self._vertical = R[2].copy()
        else:
            self._turned_rad += float(so3.log(R @ self._before[:3, :3].T)[2])
            self._changes = self._changes + self._changes_of(R, T_world_body[:3, 3] - self._before[:3, 3])
        self._before = T_world_body.copy()

    def covariance(self, T_world_body: Array, velocity_world: Array) -> Array:
        """What the errors add at a pose (4, 4) and velocity, m/s, (3,), as that of ``StateEstimate``, (9, 9)."""
        R = T_world_body[:3, :3]
        errors = np.zeros((9, _ERRORS))
        if self._imu_on_cameras:
            errors[:3, _MOUNTING] = np.eye(3) - np.outer(R[2], self._vertical)
        errors[:3, _HEADING] = self._turned_rad * R[2]
        errors[3:6] = R.T @ self._changes
        errors[6:] = self._changes_of(R, velocity_world)
        errors *= self._sigmas
        return np.asarray(errors @ errors.T)

    def _changes_of(self, R_world_body: Array, vector_world: Array) -> Array:
        """Of a vector by the errors, world, (3, 8)."""
        by_direction = by_mounting = -R_world_body @ so3.hat(R_world_body.T @ vector_world)
        if self._imu_on_cameras:
            by_mounting = np.outer(-np.cross(_UP, vector_world), self._vertical)
        by_heading = self._turned_rad * np.cross(_UP, vector_world)
        return np.column_stack((vector_world, by_mounting, by_direction, by_heading))
