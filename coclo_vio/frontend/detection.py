# SPDX-License-Identifier: BSD-3-Clause
"""New points: the corners that tell most about motion (Shi and Tomasi 1994), spread over the image by cells.

Cells that hold few points are searched first, and only as many cells as are needed. A corner must stand out of its cell
and of what the image's noise alone would make.
"""

import cv2
import numpy as np

from coclo_vio.frontend.config import DetectionConfig
from coclo_vio.values.arrays import Array, BoolArray, ByteImage, IntArray

_BLOCK_PX = 5
_RIM_PX = 6  # a cell is searched with so much of its surroundings: corner strength looks beyond its own pixel
_SPARE = 2  # corners offered for each that is wanted, since some will be too near to each other
_TURN = 7
_NOISE_STEP = 4  # every n-th row and column is enough to know the noise


class CornerDetector:
    """Finds points in one size of image."""

    def __init__(self, config: DetectionConfig, seen: ByteImage) -> None:
        """Search where ``seen`` (rows, columns) is not zero, off its border."""
        self._config = config
        allowed = seen.copy()
        rim = config.border_px
        allowed[:rim], allowed[-rim:], allowed[:, :rim], allowed[:, -rim:] = 0, 0, 0, 0
        kernel = np.ones((2 * rim + 1, 2 * rim + 1), dtype=np.uint8)
        self._allowed: ByteImage = (
            np.asarray(cv2.erode(allowed, kernel), dtype=np.uint8) if seen.min() == 0 else allowed
        )
        rows, columns = seen.shape
        self._counts = (max(1, round(rows / config.cell_px)), max(1, round(columns / config.cell_px)))
        self._shape = (rows, columns)
        self._mixed = np.random.default_rng(0).permutation(self._counts[0] * self._counts[1])
        self._turn = 0

    def admits(self, points: Array) -> BoolArray:
        """Whether points (N, 2) are where one may be, (N,)."""
        column, row = np.rint(points).astype(np.int64).T
        rows, columns = self._shape
        inside = (column >= 0) & (row >= 0) & (column < columns) & (row < rows)
        allowed = self._allowed[np.clip(row, 0, rows - 1), np.clip(column, 0, columns - 1)] > 0
        return np.asarray(inside & allowed)

    def find(self, image: ByteImage, live: Array) -> Array:
        """New points (M, 2), px, so that with the live ones (N, 2) there are as many as wanted."""
        wanted = self._config.tracks - len(live)
        if wanted <= 0 or len(live) > self._config.refill_share * self._config.tracks:
            return np.zeros((0, 2))
        mask = self._free_of(live)
        occupancy = self._occupancy(live)
        noise, strong = _noise_strength(image), 0
        offers: list[tuple[bool, int, float, tuple[float, float]]] = []
        for number in self._order(occupancy):
            if strong >= _SPARE * wanted:
                break
            occupied = int(occupancy.flat[number])
            cell = (number // self._counts[1], number % self._counts[1])
            for rank, (point, strength) in enumerate(self._corners(image, mask, cell, occupied)):
                is_weak = strength < self._config.strong_ratio * noise
                strong += not is_weak
                if strength > self._config.noise_ratio * noise:
                    offers.append((is_weak, occupied + rank, -strength, point))
        offers.sort()
        return self._apart([offer[3] for offer in offers], wanted)

    def _order(self, occupancy: IntArray) -> list[int]:
        """Numbers of the cells, those with the fewest points first, among equals another one first each time."""
        self._turn += 1
        cells = np.roll(self._mixed, self._turn * _TURN)
        return [int(cell) for cell in cells[np.argsort(occupancy.ravel()[cells], kind="stable")]]

    def _corners(
        self, image: ByteImage, mask: ByteImage, cell: tuple[int, ...], occupied: int
    ) -> list[tuple[tuple[float, float], float]]:
        """The strongest corners of a cell, as (column, row) and strength."""
        room = self._config.cell_most - occupied
        if room <= 0:
            return []
        (top, bottom), (left, right) = (
            (length * index // count, length * (index + 1) // count)
            for length, index, count in zip(self._shape, cell, self._counts, strict=True)
        )
        above, before = max(top - _RIM_PX, 0), max(left - _RIM_PX, 0)
        area = (slice(above, bottom + _RIM_PX), slice(before, right + _RIM_PX))
        allowed = np.zeros_like(mask[area])
        inner = (slice(top - above, bottom - above), slice(left - before, right - before))
        allowed[inner] = mask[area][inner]
        if not allowed.any():
            return []
        found, strengths = cv2.goodFeaturesToTrackWithQuality(
            image[area],
            room,
            self._config.quality,
            self._config.min_distance_px,
            allowed,
            blockSize=_BLOCK_PX,
        )
        if np.ndim(found) < 2:  # None, where there is no corner
            return []
        places = np.asarray(found, dtype=np.float64).reshape(-1, 2) + np.array([before, above])
        return [
            ((float(place[0]), float(place[1])), float(strength))
            for place, strength in zip(places, np.ravel(strengths), strict=True)
        ]

    def _apart(self, points: list[tuple[float, float]], wanted: int) -> Array:
        """The first of the points (M, 2) that keep their distance from each other."""
        chosen = np.zeros((wanted, 2))
        count = 0
        least = self._config.min_distance_px**2
        for point in points:
            if count == wanted:
                break
            if not count or ((chosen[:count] - point) ** 2).sum(axis=1).min() >= least:
                chosen[count] = point
                count += 1
        return chosen[:count]

    def _free_of(self, live: Array) -> ByteImage:
        """Where a new point may be, (rows, columns): 255 off the discs about the live ones."""
        mask = self._allowed.copy()
        radius = round(self._config.min_distance_px)
        for column, row in np.rint(live).astype(np.int64).tolist():
            cv2.circle(mask, (column, row), radius, 0, -1)
        return mask

    def _occupancy(self, live: Array) -> IntArray:
        """How many live points each cell holds, (cells down, cells across)."""
        counts = np.zeros(self._counts, dtype=np.int64)
        for axis_cells in (np.array(self._counts),):
            cells = (live[:, ::-1] * axis_cells / np.array(self._shape)).astype(np.int64)
            cells = np.clip(cells, 0, axis_cells - 1)
            np.add.at(counts, (cells[:, 0], cells[:, 1]), 1)
        return counts


def _noise_strength(image: ByteImage) -> float:
    """Corner strength that the noise of an image alone would make.

    The noise is the median size of second differences (Immerkaer 1996) of every few pixels. Under noise of variance s^2
    a Sobel derivative has the variance 12 s^2. OpenCV divides derivatives by ``4 block 255`` and sums their outer
    product over the block. Corners of noise alone measure 1 to 3.5 of this.
    """
    sample = image[::_NOISE_STEP].astype(np.int16)
    second = np.abs(sample[:, :-2] - 2 * sample[:, 1:-1] + sample[:, 2:])
    sigma = float(np.median(second)) / (0.6745 * np.sqrt(6.0))
    return float(12.0 * (sigma / (4.0 * _BLOCK_PX * 255.0)) ** 2 * _BLOCK_PX**2)
