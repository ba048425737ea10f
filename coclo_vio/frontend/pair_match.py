# SPDX-License-Identifier: BSD-3-Clause
"""Whether two images are a stereo pair as their calibration has it: how many corners of one are found in the other.

A corner of the left image is searched along its row as the front end does it, in the right image as it is and some rows
up or down.
"""

from dataclasses import dataclass

import numpy as np

from coclo_vio.frontend.config import FrontendConfig
from coclo_vio.frontend.detection import CornerDetector
from coclo_vio.frontend.rectification import Rectifier
from coclo_vio.frontend.row_search import RowSearch
from coclo_vio.values.arrays import Array, ByteImage
from coclo_vio.values.measurements import StereoFrame

_ROWS_PX = (-12, -9, -6, -3, 3, 6, 9, 12)
_LEAST_DISPARITY_PX = 1.0  # nearer to zero a corner is found both ways


@dataclass(frozen=True, slots=True)
class PairMatch:
    """Of how many corners the right image holds a match; the last three are zero where rows were not searched.

    Attributes:
        corners: that were searched.
        matched: in the pair as it is.
        shifted: the most with the right image moved by rows.
        rows_px: by how many rows then, px; positive where the right image lies too high.
        by_chance: with the right image moved by half its height.
    """

    corners: int
    matched: int
    shifted: int
    rows_px: int
    by_chance: int

    def joined_by(self, other: "PairMatch") -> "PairMatch":
        """The counts of two frames together."""
        rows_px = self.rows_px if self.shifted >= other.shifted else other.rows_px
        corners, matched = self.corners + other.corners, self.matched + other.matched
        by_chance = self.by_chance + other.by_chance
        return PairMatch(corners, matched, self.shifted + other.shifted, rows_px, by_chance)


def pair_match(rectifier: Rectifier, frame: StereoFrame, *, searches_rows: bool = False) -> PairMatch:
    """Search the corners of a frame's left image in the right one.

    Args:
        rectifier: of the cameras.
        frame: the images.
        searches_rows: search the rows above and below as well.

    Raises:
        DatasetError: the images are not of the size that was calibrated.
    """
    config = FrontendConfig()
    pair, stereo = rectifier.rectify(frame), config.stereo
    focal_px, baseline_m = rectifier.rig.focal_px[0], rectifier.rig.baseline_m
    reach = min(focal_px * baseline_m / stereo.min_depth_m, 0.5 * pair.left.shape[1])
    search = RowSearch(stereo.block_px // 2, int(reach), stereo.min_block_correlation, stereo.uniqueness_ratio)
    points = CornerDetector(config.detection, rectifier.valid_left).find(pair.left, np.zeros((0, 2)))
    if not len(points):
        return PairMatch(0, 0, 0, 0, 0)
    matched = _found(search, pair.left, pair.right, points)
    if not searches_rows:
        return PairMatch(len(points), matched, 0, 0, 0)
    far = len(pair.right) // 2
    rolled = {rows: np.roll(pair.right, rows, axis=0) for rows in (*_ROWS_PX, far)}
    moved = {rows: _found(search, pair.left, image, points) for rows, image in rolled.items()}
    by_chance = moved.pop(far)
    rows_px = max(moved, key=lambda rows: moved[rows])
    return PairMatch(len(points), matched, moved[rows_px], rows_px, by_chance)


def _found(search: RowSearch, image: ByteImage, other: ByteImage, points: Array) -> int:
    return int(np.count_nonzero(search.disparities(image, other, points) >= _LEAST_DISPARITY_PX))
