# SPDX-License-Identifier: BSD-3-Clause
"""Pixels and warps of the last frame's points in this one, predicted from the motion and their depths."""

import numpy as np

from coclo_vio.frontend.patches import median_of
from coclo_vio.frontend.tracks import ActiveTracks
from coclo_vio.geometry import se3
from coclo_vio.values.arrays import Array, BoolArray
from coclo_vio.values.calibration import RectifiedStereo

_MIN_DEPTH_M = 0.05
_MIN_DISPARITY_PX = 0.1
_MIN_DEPTH_RATIO = 0.1  # of a point's depth after the motion to its depth before


class PointPredictor:
    """Predicts where the points of the last frame are in this one, for one motion or several.

    A point of unknown disparity gets the median one of the others for its left pixel; its own disparity stays unknown
    (NaN). A point that would be behind the camera keeps its pixel.

    Attributes:
        is_known: whether the disparity of each point is known, (N,).
        points: in the last left camera's frame, m, (N, 3).
    """

    def __init__(self, rig: RectifiedStereo, tracks: ActiveTracks) -> None:
        """Take the points in the last frame."""
        self._rig = rig
        disparity = tracks.disparity
        self.is_known: BoolArray = np.isfinite(disparity)
        if not self.is_known.all():
            known = disparity[self.is_known]
            disparity = np.where(self.is_known, disparity, median_of(known) if len(known) else 0.0)
        self.points: Array = rig.points(tracks.left_px, np.maximum(disparity, _MIN_DISPARITY_PX))

    def pixels(self, T_previous_current: Array) -> tuple[Array, Array]:
        """Predicted left pixels (N, 2) and disparities (N,), px, after a motion (4, 4), current camera to previous."""
        moved = se3.apply(se3.inverse(T_previous_current), self.points)
        is_ahead = moved[:, 2] > _MIN_DEPTH_M
        pixels, predicted = self._rig.pixels(np.where(is_ahead[:, None], moved, self.points))
        return pixels, np.where(self.is_known, predicted, np.nan)


def predicted_warps(
    rig: RectifiedStereo,
    tracks: ActiveTracks,
    T_previous_current: Array,
) -> tuple[Array, Array]:
    """Affine warps (N, 2, 2) after a motion: from a step about each point in the last left image to one in this.

    With them how their image bends (N, 2), 1/px: relative change of the growth of the depth per column and row.

    A point on a plane has an inverse depth ``n^T x`` that is linear in its normalised coordinates x, so the plane's
    image moves by the homography ``R + t n^T`` (Hartley and Zisserman, "Multiple View Geometry", 13.1); the warp is its
    derivative, and a step ``u`` goes to ``warp u / (1 + bend u)``. The plane is that of the point's disparity and
    slants; a point of unknown disparity is at infinity.

    Args:
        rig: the cameras.
        tracks: the points in the last frame.
        T_previous_current: maps current camera coordinates to previous, (4, 4).
    """
    T = se3.inverse(T_previous_current)
    focal, centre = np.array(rig.focal_px), np.array(rig.principal_point_px)
    is_known = np.isfinite(tracks.disparity)
    disparity, slants = np.where(is_known, tracks.disparity, 0.0), np.where(is_known[:, None], tracks.slants, 0.0)
    normalised = (tracks.left_px - centre) / focal
    gradient = slants * focal
    normal = np.column_stack((gradient, disparity - (gradient * normalised).sum(axis=1)))
    normal = normal / (focal[0] * rig.baseline_m)
    homography = T[:3, :3] + T[:3, 3][:, None] * normal[:, None, :]
    moved = np.einsum("nij,nj->ni", homography, np.column_stack((normalised, np.ones(len(normalised)))))
    is_ahead = moved[:, 2] > _MIN_DEPTH_RATIO
    depth_ratio = np.where(is_ahead, moved[:, 2], 1.0)[:, None, None]
    warps = (homography[:, :2, :2] - (moved[:, :2, None] / depth_ratio) * homography[:, 2:, :2]) / depth_ratio
    warps = np.where(is_ahead[:, None, None], warps * focal[:, None] / focal, np.eye(2))
    bends = homography[:, 2, :2] / depth_ratio[:, :, 0] / focal
    return warps, np.where(is_ahead[:, None], bends, 0.0)
