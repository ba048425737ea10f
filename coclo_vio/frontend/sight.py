# SPDX-License-Identifier: BSD-3-Clause
"""How well the cameras see, and the sentence that says why not better."""

from dataclasses import dataclass

import cv2
import numpy as np

from coclo_vio.frontend.config import SightConfig
from coclo_vio.frontend.motion_check import MotionVerdict
from coclo_vio.frontend.rectification import RectifiedPair
from coclo_vio.frontend.tracks import LiveTracks
from coclo_vio.measurements import Sight


@dataclass(frozen=True, slots=True)
class Light:
    """Brightness of the two images.

    Attributes:
        mean: of left and right, grey levels.
        contrast: their standard deviations, grey levels.
    """

    mean: tuple[float, float]
    contrast: tuple[float, float]

    @classmethod
    def of(cls, pair: RectifiedPair) -> "Light":
        """The light in a pair of images."""
        values = [np.asarray(cv2.meanStdDev(image)).ravel() for image in (pair.left, pair.right)]
        return cls((float(values[0][0]), float(values[1][0])), (float(values[0][1]), float(values[1][1])))


def fault_of(light: Light, config: SightConfig) -> str:
    """Why nothing can be seen in such light; empty where something can."""
    for side, mean, contrast in zip(("left", "right"), light.mean, light.contrast, strict=True):
        if contrast >= config.least_contrast:
            continue
        if mean < config.dark_level:
            return f"the {side} image is dark: mean brightness {mean:.0f} of 255"
        if mean > config.bright_level:
            return f"the {side} image is overexposed: mean brightness {mean:.0f} of 255"
        return f"the {side} image is featureless: brightness {mean:.0f} +- {contrast:.1f} of 255"
    return ""


def judged(
    tracks: LiveTracks, followed: int, before: int, verdict: MotionVerdict, light: Light, config: SightConfig
) -> tuple[Sight, str]:
    """The state of sight and why, of a frame in whose light something could be seen.

    Args:
        tracks: what is left, new points included.
        followed: how many were followed from the last frame.
        before: how many there were in the last frame.
        verdict: of the motion check.
        light: of the images.
        config: the limits.
    """
    matched = int(tracks.has_right.sum())
    brightness = f"mean brightness {light.mean[0]:.0f} and {light.mean[1]:.0f} of 255"
    if matched < config.blind_tracks:
        return Sight.BLIND, f"only {matched} of {len(tracks)} points were found in both images ({brightness})"
    if matched < config.degraded_tracks:
        return Sight.DEGRADED, f"only {matched} of {len(tracks)} points were found in both images ({brightness})"
    if before and followed < config.kept_share * before:
        return Sight.DEGRADED, f"only {followed} of {before} points were followed from the last frame ({brightness})"
    if verdict.judged and verdict.T_previous_current is None:
        return Sight.DEGRADED, (
            f"no motion explains the points: the best one {verdict.agreeing} of {verdict.judged}; none was dropped"
        )
    return Sight.HEALTHY, ""
