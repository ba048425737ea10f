# SPDX-License-Identifier: BSD-3-Clause
"""Where the points of the last frame should be seen now, from the motion and their depths."""

import numpy as np

from coclo_vio.frontend.tracks import LiveTracks
from coclo_vio.geometry import se3
from coclo_vio.values.arrays import Array
from coclo_vio.values.calibration import RectifiedStereo

_LEAST_DEPTH_M = 0.05
_FAR_DISPARITY_PX = 0.1


def predicted(
    rig: RectifiedStereo,
    tracks: LiveTracks,
    T_previous_current: Array,
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


def stretched(
    rig: RectifiedStereo,
    tracks: LiveTracks,
    T_previous_current: Array,
) -> Array:
    """What maps a step about each point in the last left image to one in this, (N, 2, 2), after a motion.

    A point on a plane has an inverse depth ``n^T x`` that is linear in its normalised coordinates x, so the plane is
    seen through the homography ``R + t n^T`` (Hartley and Zisserman, "Multiple View Geometry", 13.1); this is its
    derivative. The plane is that of the point's disparity and slants; a point of unknown disparity is far away.

    Args:
        rig: the cameras.
        tracks: the points in the last frame.
        T_previous_current: maps current camera coordinates to previous, (4, 4).
    """
    T = se3.inverse(T_previous_current)
    focal, centre = np.array(rig.focal_px), np.array(rig.principal_point_px)
    known = np.isfinite(tracks.disparity)
    disparity, slants = np.where(known, tracks.disparity, 0.0), np.where(known[:, None], tracks.slants, 0.0)
    sides = (tracks.left_px - centre) / focal
    inclined = slants * focal
    plane = np.column_stack((inclined, disparity - (inclined * sides).sum(axis=1))) / (focal[0] * rig.baseline_m)
    homography = T[:3, :3] + T[:3, 3][:, None] * plane[:, None, :]
    seen = np.einsum("nij,nj->ni", homography, np.column_stack((sides, np.ones(len(sides)))))
    ahead = seen[:, 2] > 0.1
    depth = np.where(ahead, seen[:, 2], 1.0)[:, None, None]
    slope = (homography[:, :2, :2] - (seen[:, :2, None] / depth) * homography[:, 2:, :2]) / depth
    slope = slope * focal[:, None] / focal
    return np.where(ahead[:, None, None], slope, np.eye(2))
