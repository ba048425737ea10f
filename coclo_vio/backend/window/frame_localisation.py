# SPDX-License-Identifier: BSD-3-Clause
"""Localisation of a frame against the landmarks of the window: which tracks fit them, and the pose by those."""

from dataclasses import dataclass

import numpy as np

from coclo_vio.backend.window.config import SmootherConfig
from coclo_vio.backend.window.landmarks import LandmarkMap
from coclo_vio.backend.window.motion_model import PredictedMotion
from coclo_vio.backend.window.stereo_model import PoseFit, StereoModel
from coclo_vio.values.arrays import BoolArray
from coclo_vio.values.measurements import StereoTracks

_INFLATION = 10.0  # of the prediction's sigmas where most observations contradict it


@dataclass(frozen=True, slots=True, eq=False)
class FrameLocalisation:
    """A frame compared with the landmarks.

    Attributes:
        tracks: of the frame.
        motion: prediction of the frame, made without its tracks.
        is_wrong: tracks that do not fit the landmarks, (N,).
        fit: pose by the tracks that fit; None where they are too few.
    """

    tracks: StereoTracks
    motion: PredictedMotion
    is_wrong: BoolArray
    fit: PoseFit | None


def localise_frame(
    landmarks: LandmarkMap, model: StereoModel, tracks: StereoTracks, motion: PredictedMotion, fewest_inliers: int
) -> FrameLocalisation:
    """Localise a frame against the landmarks, whose positions stay as they are."""
    is_known, points, covariances = landmarks.known(tracks)
    observations = landmarks.observations(tracks)[is_known]
    is_wrong = np.zeros(len(tracks), dtype=np.bool_)
    if not is_known.any():
        return FrameLocalisation(tracks, motion, is_wrong, None)
    fit = model.fit_pose(motion.T_world_body, motion.covariance, points, observations, covariances)
    if 2 * np.count_nonzero(fit.is_inlier) < len(points):
        wide = model.fit_pose(motion.T_world_body, _INFLATION**2 * motion.covariance, points, observations, covariances)
        if np.count_nonzero(wide.is_inlier) > np.count_nonzero(fit.is_inlier):
            fit = wide
    is_wrong[is_known] = ~fit.is_inlier
    has_vision = np.count_nonzero(fit.is_inlier) >= fewest_inliers
    return FrameLocalisation(tracks, motion, is_wrong, fit if has_vision else None)


def has_enough_disparity(tracks: StereoTracks, config: SmootherConfig) -> bool:
    """Whether a frame has enough points with disparity to begin landmarks from it alone."""
    disparity = tracks.left_px[:, 0] - tracks.right_px[:, 0]
    return int(np.count_nonzero(disparity > config.min_disparity_px)) >= config.failure.fewest_inliers
