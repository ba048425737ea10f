# SPDX-License-Identifier: BSD-3-Clause
"""Tracking quality of a frame (healthy, degraded or lost) and the reason in a sentence."""

from dataclasses import dataclass
from typing import Self

import cv2
import numpy as np

from coclo_vio.frontend.config import QualityConfig
from coclo_vio.frontend.motion_check import MotionEstimate
from coclo_vio.frontend.rectification import RectifiedPair
from coclo_vio.frontend.tracks import ActiveTracks
from coclo_vio.values.arrays import ByteImage
from coclo_vio.values.measurements import TrackingQuality


@dataclass(frozen=True, slots=True)
class Brightness:
    """Brightness of the two images.

    Attributes:
        left: mean of the left one, grey levels.
        right: mean of the right one, grey levels.
        left_fault: why the left image has no features; empty where it may have some.
        right_fault: the same of the right image.
    """

    left: float
    right: float
    left_fault: str
    right_fault: str

    @classmethod
    def of(cls, pair: RectifiedPair, config: QualityConfig) -> Self:
        """The brightness of a pair of images."""
        (left, left_fault), (right, right_fault) = (
            _measure(image, side, config) for image, side in ((pair.left, "left"), (pair.right, "right"))
        )
        return cls(left, right, left_fault, right_fault)

    def __str__(self) -> str:
        return self.right_fault or f"mean brightness {self.left:.0f} and {self.right:.0f} of 255"


def assess(
    tracks: ActiveTracks,
    tracked: int,
    previous: int,
    motion: MotionEstimate,
    brightness: Brightness,
    config: QualityConfig,
) -> tuple[TrackingQuality, str]:
    """The tracking quality of a frame whose left image has features, and the reason if it is not healthy.

    Args:
        tracks: those of the frame, new points included.
        tracked: number of points tracked from the last frame.
        previous: number of points in the last frame.
        motion: result of the motion check.
        brightness: of the images.
        config: the limits.
    """
    matched = int(tracks.has_right.sum())
    few = f"only {matched} of {len(tracks)} points were matched in both images ({brightness})"
    if matched < config.lost_tracks and tracked < config.degraded_tracks:
        return TrackingQuality.LOST, few
    if matched < config.degraded_tracks:
        return TrackingQuality.DEGRADED, few
    if previous and tracked < config.tracked_share * previous:
        return (
            TrackingQuality.DEGRADED,
            f"only {tracked} of {previous} points were tracked from the last frame ({brightness})",
        )
    if motion.checked and motion.T_previous_current is None:
        return TrackingQuality.DEGRADED, (
            f"no rigid motion explains the tracks: the best one has {motion.inliers} inliers of {motion.checked}; "
            "no track is rejected"
        )
    return TrackingQuality.HEALTHY, ""


def _measure(image: ByteImage, side: str, config: QualityConfig) -> tuple[float, str]:
    """Mean brightness of an image, grey levels, and why it has no features, or an empty string."""
    mean, contrast = (float(value) for value in np.ravel(cv2.meanStdDev(image)))
    if contrast >= config.min_contrast:
        return mean, ""
    if mean < config.dark_level:
        return mean, f"the {side} image is dark: mean brightness {mean:.0f} of 255"
    if mean > config.bright_level:
        return mean, f"the {side} image is overexposed: mean brightness {mean:.0f} of 255"
    return mean, f"the {side} image is featureless: brightness {mean:.0f} +- {contrast:.1f} of 255"
