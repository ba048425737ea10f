# SPDX-License-Identifier: BSD-3-Clause
"""How well the cameras see, and the sentence that says why not better."""

from dataclasses import dataclass
from typing import Self

import cv2
import numpy as np

from coclo_vio.frontend.config import SightConfig
from coclo_vio.frontend.motion_check import MotionVerdict
from coclo_vio.frontend.rectification import RectifiedPair
from coclo_vio.frontend.tracks import LiveTracks
from coclo_vio.values.arrays import ByteImage
from coclo_vio.values.measurements import TrackingQuality


@dataclass(frozen=True, slots=True)
class Light:
    """Brightness of the two images.

    Attributes:
        left: mean of the left one, grey levels.
        right: mean of the right one.
        left_fault: why nothing can be seen in the left one; empty where something can.
        right_fault: the same of the right one.
    """

    left: float
    right: float
    left_fault: str
    right_fault: str

    @classmethod
    def of(cls, pair: RectifiedPair, config: SightConfig) -> Self:
        """The light in a pair of images."""
        (left, left_fault), (right, right_fault) = (
            _measured(image, side, config) for image, side in ((pair.left, "left"), (pair.right, "right"))
        )
        return cls(left, right, left_fault, right_fault)

    def __str__(self) -> str:
        return self.right_fault or f"mean brightness {self.left:.0f} and {self.right:.0f} of 255"


def judged(
    tracks: LiveTracks, followed: int, before: int, verdict: MotionVerdict, light: Light, config: SightConfig
) -> tuple[TrackingQuality, str]:
    """The state of sight and why it is not healthy, of a frame in whose left image something could be seen.

    Args:
        tracks: what is left, new points included.
        followed: how many were followed from the last frame.
        before: how many there were in the last frame.
        verdict: of the motion check.
        light: of the images.
        config: the limits.
    """
    matched = int(tracks.has_right.sum())
    few = f"only {matched} of {len(tracks)} points were found in both images ({light})"
    if matched < config.lost_tracks and followed < config.degraded_tracks:
        return TrackingQuality.LOST, few
    if matched < config.degraded_tracks:
        return TrackingQuality.DEGRADED, few
    if before and followed < config.kept_share * before:
        return (
            TrackingQuality.DEGRADED,
            f"only {followed} of {before} points were followed from the last frame ({light})",
        )
    if verdict.judged and verdict.T_previous_current is None:
        return TrackingQuality.DEGRADED, (
            f"no motion explains the points: the best one {verdict.agreeing} of {verdict.judged}; all are kept"
        )
    return TrackingQuality.HEALTHY, ""


def _measured(image: ByteImage, side: str, config: SightConfig) -> tuple[float, str]:
    """Mean brightness of an image, and why nothing can be seen in it."""
    mean, contrast = (float(value) for value in np.ravel(cv2.meanStdDev(image)))
    if contrast >= config.least_contrast:
        return mean, ""
    if mean < config.dark_level:
        return mean, f"the {side} image is dark: mean brightness {mean:.0f} of 255"
    if mean > config.bright_level:
        return mean, f"the {side} image is overexposed: mean brightness {mean:.0f} of 255"
    return mean, f"the {side} image is featureless: brightness {mean:.0f} +- {contrast:.1f} of 255"
