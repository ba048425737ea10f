# SPDX-License-Identifier: BSD-3-Clause
"""Where the points of the last frame should be seen now, from the motion and their depths."""

import numpy as np

from coclo_vio.arrays import Array
from coclo_vio.calibration import RectifiedStereo
from coclo_vio.frontend.tracks import LiveTracks
from coclo_vio.geometry import se3

_LEAST_DEPTH_M = 0.05
_FAR_DISPARITY_PX = 0.1


def predicted(
    rig: RectifiedStereo,
    tracks: LiveTracks,
    T_previous_current: Array,  # noqa: N803
) -> tuple[Array, Array]:
    """Expected places (N, 2) in the left image and disparities (N,), px, after a motion.

    A point of unknown disparity is put at the middle one of those that are known. What would be behind the camera stays
    where it was. The disparity stays unknown (NaN) where it was unknown.

    Args:
        rig: the cameras.
        tracks: the points in the last frame.
        T_previous_current: maps current camera coordinates to previous, (4, 4).
    """
    disparity = tracks.disparity
    known = np.isfinite(disparity)
    usual = float(np.median(disparity[known])) if known.any() else _FAR_DISPARITY_PX
    points = rig.points(tracks.left_px, np.maximum(np.where(known, disparity, usual), _FAR_DISPARITY_PX))
    moved = se3.apply(se3.inverse(T_previous_current), points)
    ahead = moved[:, 2] > _LEAST_DEPTH_M
    pixels, expected = rig.pixels(np.where(ahead[:, None], moved, points))
    return pixels, np.where(known, expected, np.nan)
