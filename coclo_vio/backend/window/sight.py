# SPDX-License-Identifier: BSD-3-Clause
"""A frame as it is first seen: which tracks fit the landmarks that stay, and where that puts the camera."""

from dataclasses import dataclass

import numpy as np

from coclo_vio.backend.window.config import SmootherConfig
from coclo_vio.backend.window.landmarks import LandmarkMap
from coclo_vio.backend.window.localisation import Located, PixelModel
from coclo_vio.backend.window.motion import Motion
from coclo_vio.values.arrays import BoolArray
from coclo_vio.values.measurements import StereoTracks

_UNSURE = 10.0  # how many times its sigma an expectation may be off that most sightings contradict


@dataclass(frozen=True, slots=True, eq=False)
class Glance:
    """A frame against what is known.

    Attributes:
        tracks: what it sees.
        motion: where it was expected, without looking.
        is_wrong: which tracks do not fit the landmarks, (N,).
        located: where it is by those that do; None where they are too few.
    """

    tracks: StereoTracks
    motion: Motion
    is_wrong: BoolArray
    located: Located | None


def glance(
    landmarks: LandmarkMap, pixels: PixelModel, tracks: StereoTracks, motion: Motion, fewest_inliers: int
) -> Glance:
    """Place a frame against landmarks that stay."""
    is_known, points, covariances = landmarks.known(tracks)
    sightings = landmarks.sightings(tracks)[is_known]
    is_wrong = np.zeros(len(tracks), dtype=np.bool_)
    if not is_known.any():
        return Glance(tracks, motion, is_wrong, None)
    located = pixels.locate(motion.T_world_body, motion.covariance, points, sightings, covariances)
    if 2 * np.count_nonzero(located.is_inlier) < len(points):
        unsure = pixels.locate(motion.T_world_body, _UNSURE**2 * motion.covariance, points, sightings, covariances)
        if np.count_nonzero(unsure.is_inlier) > np.count_nonzero(located.is_inlier):
            located = unsure
    is_wrong[is_known] = ~located.is_inlier
    has_sight = np.count_nonzero(located.is_inlier) >= fewest_inliers
    return Glance(tracks, motion, is_wrong, located if has_sight else None)


def sees_enough(tracks: StereoTracks, config: SmootherConfig) -> bool:
    """Whether a frame alone has points near enough to start from."""
    disparity = tracks.left_px[:, 0] - tracks.right_px[:, 0]
    return int(np.count_nonzero(disparity > config.min_disparity_px)) >= config.failure.fewest_inliers
