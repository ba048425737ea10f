# SPDX-License-Identifier: BSD-3-Clause
"""Which frames become keyframes, and whether the tracks stand still."""

import numpy as np

from coclo_vio.backend.window.config import KeyframeConfig
from coclo_vio.values.arrays import Array
from coclo_vio.values.measurements import StereoTracks
from coclo_vio.values.units import NS_PER_S

_REFERENCE_FOCAL_PX = 460.0
_FEWEST_STILL = 5


def displacements_px(before: StereoTracks, now: StereoTracks) -> Array:
    """Motion of the tracks that both frames have, in the left image, px, (M,)."""
    _, at_before, at_now = np.intersect1d(before.track_ids, now.track_ids, assume_unique=True, return_indices=True)
    return np.asarray(np.linalg.norm(now.left_px[at_now] - before.left_px[at_before], axis=1))


def tracks_are_still(before: StereoTracks, now: StereoTracks, most_px: float) -> bool:
    """Whether the tracks that both frames have moved by less than ``most_px``, in the median."""
    moved = displacements_px(before, now)
    return len(moved) >= _FEWEST_STILL and float(np.median(moved)) < most_px


def has_lost_overlap(config: KeyframeConfig, before: StereoTracks, now: StereoTracks) -> bool:
    """Whether too many tracks of ``before`` are lost, or too many of the present ones are new."""
    common = len(np.intersect1d(before.track_ids, now.track_ids, assume_unique=True))
    is_lost = common < config.least_kept_share * len(before)
    return is_lost or len(now) - common > config.most_new_share * max(len(now), 1)


def is_keyframe(config: KeyframeConfig, before: StereoTracks, now: StereoTracks, focal_px: float) -> bool:
    """Whether ``now`` should be a keyframe after the keyframe ``before``."""
    if (now.stamp_ns - before.stamp_ns) / NS_PER_S >= config.longest_s or has_lost_overlap(config, before, now):
        return True
    moved = displacements_px(before, now)
    return len(moved) > 0 and float(np.mean(moved)) > config.parallax_px * focal_px / _REFERENCE_FOCAL_PX
