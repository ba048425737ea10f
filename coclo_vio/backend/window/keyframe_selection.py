# SPDX-License-Identifier: BSD-3-Clause
"""Which frames become keyframes, and whether the tracks stand still."""

import numpy as np

from coclo_vio.backend.window.config import KeyframeConfig
from coclo_vio.values.arrays import Array, IntArray
from coclo_vio.values.measurements import StereoTracks
from coclo_vio.values.units import NS_PER_S

_REFERENCE_FOCAL_PX = 460.0
_FEWEST_STILL = 5
_FEWEST_MATCHED = 8  # observed by both cameras


def displacements_px(before: StereoTracks, now: StereoTracks) -> Array:
    """Motion of the tracks that both frames have, in the left image, px, (M,)."""
    _, at_before, at_now = np.intersect1d(before.track_ids, now.track_ids, assume_unique=True, return_indices=True)
    return np.asarray(np.linalg.norm(now.left_px[at_now] - before.left_px[at_before], axis=1))


def tracks_are_still(before: StereoTracks, now: StereoTracks, most_px: float) -> bool:
    """Whether the tracks that both frames have moved by less than ``most_px``, in the median."""
    moved = displacements_px(before, now)
    return len(moved) >= _FEWEST_STILL and float(np.median(moved)) < most_px


def has_lost_overlap(config: KeyframeConfig, before: StereoTracks, now: StereoTracks) -> bool:
    """Whether too many tracks of ``before`` are lost, or too many of the present ones are new.

    Tracks that both cameras observe count; all of them, where those are few. In front of walls without texture a front
    end also tracks image noise, for a frame or two, which would make every frame a keyframe and the window short.
    """
    ids_before, ids_now = _matched_ids(before), _matched_ids(now)
    if min(len(ids_before), len(ids_now)) < _FEWEST_MATCHED:
        ids_before, ids_now = before.track_ids, now.track_ids
    kept = len(np.intersect1d(ids_before, now.track_ids, assume_unique=True))
    known = len(np.intersect1d(before.track_ids, ids_now, assume_unique=True))
    is_lost = kept < config.least_kept_share * len(ids_before)
    return is_lost or len(ids_now) - known > config.most_new_share * max(len(ids_now), 1)


def _matched_ids(tracks: StereoTracks) -> IntArray:
    """The tracks that both cameras observe, (M,)."""
    return np.asarray(tracks.track_ids[np.isfinite(tracks.right_px[:, 0])])


def is_keyframe(config: KeyframeConfig, before: StereoTracks, now: StereoTracks, focal_px: float) -> bool:
    """Whether ``now`` should be a keyframe after the keyframe ``before``."""
    if (now.stamp_ns - before.stamp_ns) / NS_PER_S >= config.longest_s or has_lost_overlap(config, before, now):
        return True
    moved = displacements_px(before, now)
    return len(moved) > 0 and float(np.mean(moved)) > config.parallax_px * focal_px / _REFERENCE_FOCAL_PX
