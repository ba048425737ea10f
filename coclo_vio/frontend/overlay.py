# SPDX-License-Identifier: BSD-3-Clause
"""A picture of the front end's result: both images, points with their tails, matches, tracking quality."""

from collections.abc import Iterable

import cv2
import numpy as np

from coclo_vio.frontend.rectification import RectifiedPair
from coclo_vio.values.arrays import Array, ByteImage
from coclo_vio.values.measurements import StereoTracks, TrackingQuality

_OLD_FRAMES = 30
_TEXT_SCALE = 0.45
_QUALITY_COLOURS = {
    TrackingQuality.HEALTHY: (80, 220, 80),
    TrackingQuality.DEGRADED: (40, 180, 255),
    TrackingQuality.LOST: (60, 60, 255),
}
_UNMATCHED_COLOUR = (60, 60, 255)


def draw(pair: RectifiedPair, tracks: StereoTracks, recent: Iterable[StereoTracks]) -> ByteImage:
    """The picture (rows, 2 columns, 3), uint8, blue green red.

    A point is yellow when new and green when old, red where it is not matched in the right image; its tail is its path
    through the last frames.

    Args:
        pair: the rectified images.
        tracks: of the same frame.
        recent: of the last frames, oldest first, this one included.
    """
    columns = pair.left.shape[1]
    tails: dict[int, list[Array]] = {}
    for frame in recent:
        for track_id, pixel in zip(frame.track_ids.tolist(), frame.left_px, strict=True):
            tails.setdefault(track_id, []).append(pixel)
    grey = np.hstack((pair.left, pair.right))
    picture = np.ascontiguousarray(np.repeat(grey[:, :, None], 3, axis=2))
    for track_id, left, right, age in zip(
        tracks.track_ids.tolist(), tracks.left_px, tracks.right_px, tracks.ages.tolist(), strict=True
    ):
        newness = max(0.0, 1.0 - age / _OLD_FRAMES)
        is_matched = bool(np.isfinite(right[0]))
        colour = (0, 255, round(255 * newness)) if is_matched else _UNMATCHED_COLOUR
        tail = np.rint(np.array([*tails.get(track_id, []), left])).astype(np.int32)
        cv2.polylines(picture, [tail], False, colour, 1, cv2.LINE_AA)
        cv2.circle(picture, _rounded(left), 3, colour, 1, cv2.LINE_AA)
        if is_matched:
            cv2.circle(picture, _rounded(right + np.array([columns, 0.0])), 3, colour, 1, cv2.LINE_AA)
    matched = int(np.isfinite(tracks.right_px[:, 0]).sum())
    colour = _QUALITY_COLOURS[tracks.quality]
    _write(picture, f"{tracks.quality.value}: {len(tracks)} tracks, {matched} in both images", 0, colour)
    if tracks.reason:
        _write(picture, tracks.reason, 1, colour)
    return picture


def _rounded(pixel: Array) -> tuple[int, int]:
    return round(float(pixel[0])), round(float(pixel[1]))


def _write(picture: ByteImage, text: str, line: int, colour: tuple[int, int, int]) -> None:
    at = (8, 18 + 20 * line)
    (width, height), below = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, _TEXT_SCALE, 1)
    cv2.rectangle(picture, (at[0] - 4, at[1] - height - 4), (at[0] + width + 4, at[1] + below), (0, 0, 0), -1)
    cv2.putText(picture, text, at, cv2.FONT_HERSHEY_SIMPLEX, _TEXT_SCALE, colour, 1, cv2.LINE_AA)
