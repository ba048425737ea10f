# SPDX-License-Identifier: BSD-3-Clause
"""What an error of the tilt does to a path by vision: the path climbs or sinks with it for as long as it lasts.

A window forgets its keyframes, and with them that the position of the oldest one is wrong by the tilt which is wrong
still: it would add each displacement's error as if it were independent of the one before. An accelerometer's bias is
constant in the axes of the body, and so is the tilt that it causes, until a turn shows it.
"""

import numpy as np

from coclo_vio.backend.window.frame_estimate import FrameEstimate
from coclo_vio.geometry import so3
from coclo_vio.values.arrays import Array


class TiltErrors:
    """Follows a path, and holds the covariance that its tilt adds to the position.

    The error of the tilt is the same in body axes all along, in multiples of its sigma at each time.
    """

    def __init__(self) -> None:
        self._position: Array | None = None  # of the last frame, world, m
        self._changes = np.zeros((3, 3))  # of the position, world, by the tilt in its sigmas

    def advance(self, frame: FrameEstimate) -> Array:
        """Follow the path to a frame; the covariance that the tilt adds to its position, local, m^2, (3, 3).

        Args:
            frame: the next one of the path; the first one is where it begins.
        """
        R, position = frame.T_world_body[:3, :3], frame.T_world_body[:3, 3]
        if self._position is not None:
            moved_body = R.T @ (position - self._position)
            self._changes = self._changes - R @ so3.hat(moved_body) @ _tilt_sigmas(frame.covariance[:3, :3], R[2])
        self._position = position.copy()
        changes_body = R.T @ self._changes
        return np.asarray(changes_body @ changes_body.T)


def _tilt_sigmas(covariance: Array, up_body: Array) -> Array:
    """The symmetric square root (3, 3) of a rotation's covariance without its part about the vertical, body axes."""
    across = np.eye(3) - np.outer(up_body, up_body)
    variances, axes = np.linalg.eigh(across @ covariance @ across)
    return np.asarray((axes * np.sqrt(np.maximum(variances, 0.0))) @ axes.T)
