# SPDX-License-Identifier: BSD-3-Clause
"""Search for blocks of the left image along their rows in the right one, by normalised correlation.

``found_by_opencv`` is the readable form; where numba is there, a kernel gives the same, many blocks at a time. Sums are
of whole numbers: float32 holds them without rounding, for blocks of up to 31 px.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from coclo_vio.geometry.compiled import IS_COMPILED, compiled, compiled_without_gil
from coclo_vio.values.arrays import Array, ByteImage, FloatImage, IntArray

BLOCK_ROWS = 1  # rows above and below that a block is also searched in
_MIDDLE = np.float32(128.0)  # subtracted from grey levels, so that sums are small
_LINES = 10  # of memory: one of the image; products, sums and squares of three rows
_NEIGHBOURS = 2  # columns on either side of the best one that are no other place


@dataclass(frozen=True, slots=True)
class RowSearch:
    """What is searched for, and where.

    Attributes:
        half_px: half of a block's side, px.
        max_disparity: whole pixels.
        min_correlation: of a match.
        uniqueness_ratio: a match is ambiguous if another place has this share of its correlation.
    """

    half_px: int
    max_disparity: int
    min_correlation: float
    uniqueness_ratio: float

    def disparities(self, left: ByteImage, right: ByteImage, points: Array) -> Array:
        """Disparities, whole pixels, of the blocks with the highest correlation, (N,).

        NaN where it is too low or ambiguous, or where a block reaches beyond the image.

        Args:
            left: the image that the points are in, (rows, columns).
            right: the image to search, of the same size.
            points: columns and rows, px, (N, 2).
        """
        pixels = np.rint(points).astype(np.int64)
        if not IS_COMPILED:
            return np.array([found_by_opencv(self, left, right, *pixel) for pixel in pixels.tolist()])
        side, reach = 2 * self.half_px + 1, self.max_disparity
        found, correlations = np.full(len(pixels), np.nan), np.empty(reach + side + 1)
        block, lines = np.empty((side, side), np.float32), np.empty((_LINES, reach + side + 1), np.float32)
        limits = np.array([self.min_correlation, self.uniqueness_ratio])
        _search(left, right, pixels, limits, (block, lines), correlations, found)
        return found


def found_by_opencv(search: RowSearch, left: ByteImage, right: ByteImage, column: int, row: int) -> float:
    """The disparity of one block about a pixel of the left image, or NaN."""
    half, height, width = search.half_px, *left.shape
    if not (half + BLOCK_ROWS <= row < height - half - BLOCK_ROWS and half <= column < width - half):
        return np.nan
    block = left[row - half : row + half + 1, column - half : column + half + 1]
    first = max(column - search.max_disparity - half, 0)
    rows = slice(row - half - BLOCK_ROWS, row + half + BLOCK_ROWS + 1)
    strip = right[rows, first : min(column + half + 2, width)]
    correlations = np.asarray(cv2.matchTemplate(strip, block, cv2.TM_CCOEFF_NORMED)).max(axis=0)
    correlations = np.where(np.isfinite(correlations), correlations, 0.0)
    best = int(correlations.argmax())
    others = np.concatenate((correlations[: max(best - _NEIGHBOURS, 0)], correlations[best + _NEIGHBOURS + 1 :]))
    highest = float(correlations[best])
    is_unique = not len(others) or float(others.max()) < search.uniqueness_ratio * highest
    is_match = highest > search.min_correlation and is_unique
    return float(column - half - first - best) if is_match else np.nan


@compiled_without_gil
def _search(
    left: ByteImage,
    right: ByteImage,
    pixels: IntArray,
    limits: Array,
    memory: tuple[FloatImage, FloatImage],
    correlations: Array,
    found: Array,
) -> None:
    """Disparities (N,) of blocks about pixels (N, 2), where found, by the limits of correlation and uniqueness."""
    (height, width), (block, lines) = left.shape, memory
    half, reach = len(block) // 2, lines.shape[1] - len(block) - 1
    for n in range(len(pixels)):
        column, row = pixels[n, 0], pixels[n, 1]
        if not (half + BLOCK_ROWS <= row < height - half - BLOCK_ROWS and half <= column < width - half):
            continue
        first = max(column - reach - half, 0)
        places = min(column + half + 2, width) - first - 2 * half
        _correlate(left, right, (column, row, first, places), block, lines, correlations)
        best = 0
        for place in range(places):
            if correlations[place] > correlations[best]:
                best = place
        is_match = correlations[best] > limits[0]
        for place in range(places):
            if abs(place - best) > _NEIGHBOURS and correlations[place] >= limits[1] * correlations[best]:
                is_match = False
        if is_match:
            found[n] = column - half - first - best


@compiled
def _correlate(
    left: ByteImage,
    right: ByteImage,
    place: tuple[int, int, int, int],
    block: FloatImage,
    memory: FloatImage,
    correlations: Array,
) -> None:
    """Highest correlations over three rows, by column of the right image; -1 to 1, and 1 where the block is blank.

    Args:
        left: the image of the block.
        right: the image to search.
        place: column and row of the block's centre, first column of the search, number of places.
        block: memory of the block, (side, side).
        memory: of a line of the right image, and of three rows of products, of sums and of squares, (10, columns).
        correlations: the result, (at least the number of places,).
    """
    (column, row, first, places), side = place, len(block)
    half, pixels = side // 2, float(side * side)
    sum_left, squares_left = 0.0, 0.0
    for i in range(side):
        for j in range(side):
            value = np.float32(left[row - half + i, column - half + j]) - _MIDDLE
            block[i, j] = value
            sum_left += float(value)
            squares_left += float(value * value)
    variance_left = pixels * squares_left - sum_left * sum_left
    for r in range(len(memory)):
        for c in range(places + side - 1):
            memory[r, c] = 0.0
    line = memory[0]
    for i in range(side + 2 * BLOCK_ROWS):
        for c in range(places + side - 1):
            line[c] = np.float32(right[row - half - BLOCK_ROWS + i, first + c]) - _MIDDLE
        for r in range(max(0, i - side + 1), min(3, i + 1)):
            products, sums, squares = memory[1 + r], memory[4 + r], memory[7 + r]
            for c in range(places + side - 1):
                sums[c] += line[c]
                squares[c] += line[c] * line[c]
            for j in range(side):
                value = block[i - r, j]
                for c in range(places):
                    products[c] += value * line[c + j]
    _normalise(memory, places, side, (sum_left, variance_left), correlations)


@compiled
def _normalise(memory: FloatImage, places: int, side: int, left: tuple[float, float], correlations: Array) -> None:
    """Highest correlations of three rows, by their products, sums and squares, and sum and variance of the block."""
    sum_left, variance_left = left
    pixels = float(side * side)
    for c in range(places):
        correlations[c] = -1.0
    for r in range(3):
        total, square = 0.0, 0.0
        for c in range(places + side - 1):
            total += memory[4 + r, c]
            square += memory[7 + r, c]
            at = c - side + 1
            if at >= 0:
                variance = pixels * square - total * total
                one = 1.0 if variance_left <= 0.0 else 0.0
                if variance_left > 0.0 and variance > 0.0:
                    covariance = pixels * memory[1 + r, at] - sum_left * total
                    one = covariance / np.sqrt(variance_left * variance)
                correlations[at] = max(correlations[at], one)
                total -= memory[4 + r, at]
                square -= memory[7 + r, at]
