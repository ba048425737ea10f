# SPDX-License-Identifier: BSD-3-Clause
"""Detection of new points: corners by their smaller eigenvalue (Shi and Tomasi 1994), spread over a grid of cells.

Cells that hold few points are searched first, and only as many cells as are needed. A corner must be strong relative to
its cell and to the corner strength of image noise alone.
"""

import cv2
import numpy as np
import numpy.typing as npt

from coclo_vio.frontend.config import DetectionConfig
from coclo_vio.values.arrays import Array, BoolArray, ByteImage, IntArray

_BLOCK_PX = 5
_MARGIN_PX = 6  # around a cell, since corner strength depends on the pixels near by
_CANDIDATE_RATIO = 2  # candidates per missing point, since some will be too near to each other
_ROTATION = 7  # of the order of equally filled cells, from frame to frame
_LEVELS = 2 * 255 + 1  # of a second difference
_NOISE_STEP = 4  # every n-th row is enough to estimate the noise


class CornerDetector:
    """Finds corners in images of one size."""

    def __init__(self, config: DetectionConfig, valid: ByteImage) -> None:
        """Search where ``valid`` (rows, columns) is not zero, away from its border."""
        self._config = config
        allowed = valid.copy()
        border = config.border_px
        allowed[:border], allowed[-border:], allowed[:, :border], allowed[:, -border:] = 0, 0, 0, 0
        kernel = np.ones((2 * border + 1, 2 * border + 1), dtype=np.uint8)
        self._allowed: ByteImage = (
            np.asarray(cv2.erode(allowed, kernel), dtype=np.uint8) if valid.min() == 0 else allowed
        )
        rows, columns = valid.shape
        self._grid = (max(1, round(rows / config.cell_px)), max(1, round(columns / config.cell_px)))
        self._shape = (rows, columns)
        self._shuffled = np.random.default_rng(0).permutation(self._grid[0] * self._grid[1])
        self._calls = 0

    def is_allowed(self, points: Array) -> BoolArray:
        """Whether points (N, 2), px, are inside the searched part of the image, (N,)."""
        rows, columns = self._shape
        column, row = np.rint(points).astype(np.int64).T
        inside = (column >= 0) & (row >= 0) & (column < columns) & (row < rows)
        if not inside.all():
            column, row = np.where(inside, column, 0), np.where(inside, row, 0)
        return np.asarray(inside & (self._allowed[row, column] > 0))

    def find(self, image: ByteImage, existing: Array) -> Array:
        """New points (M, 2), px, that complete the existing ones (N, 2) to the configured number."""
        missing = self._config.tracks - len(existing)
        if missing <= 0 or len(existing) > self._config.refill_share * self._config.tracks:
            return np.zeros((0, 2))
        occupancy = self._occupancy(existing)
        noise, strong = _noise_strength(image), 0
        candidates: list[tuple[bool, int, float, tuple[float, float]]] = []
        for number in self._cell_order(occupancy):
            if strong >= _CANDIDATE_RATIO * missing:
                break
            occupied = int(occupancy.flat[number])
            cell = (number // self._grid[1], number % self._grid[1])
            for rank, (point, strength) in enumerate(self._corners(image, existing, cell, occupied)):
                is_weak = strength < self._config.strong_ratio * noise
                strong += not is_weak
                if strength > self._config.noise_ratio * noise:
                    candidates.append((is_weak, occupied + rank, -strength, point))
        candidates.sort()
        return self._spaced([point for *_, point in candidates], missing)

    def _cell_order(self, occupancy: IntArray) -> list[int]:
        """Numbers of the cells, those with the fewest points first; the order of ties varies from call to call."""
        self._calls += 1
        cells = np.roll(self._shuffled, self._calls * _ROTATION)
        return [int(cell) for cell in cells[np.argsort(occupancy.ravel()[cells], kind="stable")]]

    def _corners(
        self, image: ByteImage, existing: Array, cell: tuple[int, ...], occupied: int
    ) -> list[tuple[tuple[float, float], float]]:
        """The strongest corners of a cell, as (column, row) and strength."""
        capacity = self._config.max_per_cell - occupied
        if capacity <= 0:
            return []
        (top, bottom), (left, right) = (
            (length * index // count, length * (index + 1) // count)
            for length, index, count in zip(self._shape, cell, self._grid, strict=True)
        )
        first_row, first_column = max(top - _MARGIN_PX, 0), max(left - _MARGIN_PX, 0)
        area = image[first_row : bottom + _MARGIN_PX, first_column : right + _MARGIN_PX]
        allowed = np.zeros_like(area)
        inner = (slice(top - first_row, bottom - first_row), slice(left - first_column, right - first_column))
        allowed[inner] = self._free_area(existing, slice(top, bottom), slice(left, right))
        if not allowed.any():
            return []
        found, strengths = cv2.goodFeaturesToTrackWithQuality(
            area,
            capacity,
            self._config.quality_level,
            self._config.min_distance_px,
            allowed,
            blockSize=_BLOCK_PX,
        )
        if np.ndim(found) < 2:  # None, where there is no corner
            return []
        pixels = np.asarray(found, dtype=np.float64).reshape(-1, 2) + np.array([first_column, first_row])
        return [
            ((float(pixel[0]), float(pixel[1])), float(strength))
            for pixel, strength in zip(pixels, np.ravel(strengths), strict=True)
        ]

    def _spaced(self, points: list[tuple[float, float]], most: int) -> Array:
        """The first points (M, 2) that keep the minimum distance from each other, at most so many."""
        chosen = np.zeros((most, 2))
        count = 0
        min_squared = self._config.min_distance_px**2
        for point in points:
            if count == most:
                break
            if not count or ((chosen[:count] - point) ** 2).sum(axis=1).min() >= min_squared:
                chosen[count] = point
                count += 1
        return chosen[:count]

    def _free_area(self, existing: Array, rows: slice, columns: slice) -> ByteImage:
        """Where a new point may be in a part of the image: 255 outside the discs around the existing ones."""
        free = self._allowed[rows, columns].copy()
        radius = round(self._config.min_distance_px)
        first, last = np.array([columns.start, rows.start]), np.array([columns.stop, rows.stop])
        centres = np.rint(existing).astype(np.int64)
        is_near = ((centres >= first - radius) & (centres < last + radius)).all(axis=1)
        for column, row in (centres[is_near] - first).tolist():
            cv2.circle(free, (column, row), radius, 0, -1)
        return free

    def _occupancy(self, existing: Array) -> IntArray:
        """Number of existing points in each cell, (cells down, cells across)."""
        counts = np.zeros(self._grid, dtype=np.int64)
        grid = np.array(self._grid)
        cells = (existing[:, ::-1] * grid / np.array(self._shape)).astype(np.int64)
        cells = np.clip(cells, 0, grid - 1)
        np.add.at(counts, (cells[:, 0], cells[:, 1]), 1)
        return counts


def _noise_strength(image: ByteImage) -> float:
    """Corner strength that image noise alone produces.

    The noise is estimated from the median absolute second difference (Immerkaer 1996) of every n-th row. Under noise of
    variance s^2 a Sobel derivative has the variance 12 s^2. OpenCV divides derivatives by ``4 block 255`` and sums
    their outer product over the block. Corners of noise alone have 1 to 3.5 times this strength.
    """
    sample = image[::_NOISE_STEP].astype(np.int16)
    second = np.abs(sample[:, :-2] - 2 * sample[:, 1:-1] + sample[:, 2:])
    sigma = _median(second.astype(np.uint16)) / (0.6745 * np.sqrt(6.0))
    return float(12.0 * (sigma / (4.0 * _BLOCK_PX * 255.0)) ** 2 * _BLOCK_PX**2)


def _median(values: npt.NDArray[np.uint16]) -> float:
    """The median of whole numbers (rows, columns) up to twice a grey level, by counting them."""
    counts = cv2.calcHist([values], [0], None, [_LEVELS], [0, _LEVELS])
    up_to = np.cumsum(counts.ravel().astype(np.int64))  # how many are at most 0, 1, ...
    last = int(up_to[-1])
    low, high = np.searchsorted(up_to, ((last - 1) // 2, last // 2), side="right")
    return 0.5 * float(low + high)
