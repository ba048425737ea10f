# SPDX-License-Identifier: BSD-3-Clause
"""Compiled bilinear interpolation of patches; ``patch_sampling`` has the readable form, to the bit.

A patch is a list of P steps about its centre. Products are added as fused operations, as OpenCV 5 and NumPy's linear
algebra do where the processor has them, in the same order. Arrays of pixels are float32.
"""

from typing import Any

import numpy as np
import numpy.typing as npt

from coclo_vio.geometry.compiled import IS_COMPILED, compiled
from coclo_vio.values.arrays import Array, FloatImage

GAIN_LIMITS = (0.3, 3.0)  # of the brightness of a patch to that of its template
MIN_VARIANCE = 1e-3  # of the brightness of a patch, so that none is divided by zero

_Indices = npt.NDArray[np.uint64]
_fused: Any = None  # a b + c, rounded once

if IS_COMPILED:
    from numba.extending import intrinsic

    @intrinsic
    def _fused_product(_context, a, b, c):  # type: ignore[no-untyped-def]
        return a(a, b, c), lambda _, builder, __, arguments: builder.fma(*arguments)

    _fused = _fused_product


@compiled
def warped_patches(image: FloatImage, centres: Array, warps: Array, steps: FloatImage) -> FloatImage:
    """Brightness (N, P) under patches: at ``centres + warps steps``.

    Args:
        image: (rows, columns).
        centres: columns and rows, px, (N, 2), float64.
        warps: (N, 2, 2), float64.
        steps: columns and rows from the centre, px, (2, P).
    """
    count, longest = steps.shape[1], np.abs(steps).max()
    brightness = np.empty((len(centres), count), dtype=np.float32)
    columns, rows = np.empty(count, dtype=np.float32), np.empty(count, dtype=np.float32)
    first = np.empty(count, dtype=np.uint64)
    for n in range(len(centres)):
        _warp(np.float32(centres[n, 0]), warps[n, 0], steps, columns)
        _warp(np.float32(centres[n, 1]), warps[n, 1], steps, rows)
        if _is_inside(image, centres[n], warps[n], longest):
            _interpolate(image, columns, rows, first, brightness[n])
        else:
            _interpolate_anywhere(image, columns, rows, brightness[n])
    return brightness


@compiled
def patches_and_shifts(image: FloatImage, centres: Array, steps: FloatImage) -> tuple[FloatImage, FloatImage]:
    """Brightness (N, P) at ``centres + steps`` and its derivatives (N, 2, P) by column and row; arguments as above."""
    count, longest, identity = steps.shape[1], np.abs(steps).max() + 1.0, np.eye(2)
    brightness = np.empty((len(centres), count), dtype=np.float32)
    shifts = np.empty((len(centres), 2, count), dtype=np.float32)
    first, samples = np.empty(count, dtype=np.uint64), np.empty((5, count), dtype=np.float32)
    for n in range(len(centres)):
        is_inside = _is_inside(image, centres[n], identity, longest)
        for number, (column, row) in enumerate(((0, 0), (1, 0), (-1, 0), (0, 1), (0, -1))):
            columns = np.float32(centres[n, 0]) + steps[0] + np.float32(column)
            rows = np.float32(centres[n, 1]) + steps[1] + np.float32(row)
            if is_inside:
                _interpolate(image, columns, rows, first, samples[number])
            else:
                _interpolate_anywhere(image, columns, rows, samples[number])
        brightness[n] = samples[0]
        for p in range(count):
            shifts[n, 0, p] = np.float32(0.5) * (samples[1, p] - samples[2, p])
            shifts[n, 1, p] = np.float32(0.5) * (samples[3, p] - samples[4, p])
    return brightness, shifts


@compiled
def _warp(centre: np.float32, warp: Array, steps: FloatImage, out: FloatImage) -> None:
    """Columns or rows (P,) of a patch, by a row (2,) of its warp."""
    by_column, by_row = np.float32(warp[0]), np.float32(warp[1])
    for p in range(len(out)):
        out[p] = _fused(by_row, steps[1, p], by_column * steps[0, p]) + centre


@compiled
def _is_inside(image: FloatImage, centre: Array, warp: Array, longest: float) -> bool:
    """Whether all pixels that a patch needs are in the image, with one to spare, given the longest of its steps."""
    is_inside = True
    for axis in range(2):
        reach = 1.0 + longest * (abs(warp[axis, 0]) + abs(warp[axis, 1]))
        is_inside &= reach < centre[axis] < image.shape[1 - axis] - 1.0 - reach
    return is_inside


@compiled
def _interpolate(image: FloatImage, columns: FloatImage, rows: FloatImage, first: _Indices, out: FloatImage) -> None:
    """Brightness (P,) at places (P,) in the image, which become their parts of a pixel; ``first`` (P,) is memory."""
    width = np.int32(image.shape[1])
    for p in range(len(out)):
        column, row = np.int32(columns[p]), np.int32(rows[p])
        columns[p] -= np.float32(column)
        rows[p] -= np.float32(row)
        first[p] = np.uint64(row * width + column)
    pixels, one, below = image.reshape(-1), np.uint64(1), np.uint64(width)  # unsigned: no index counts from the end
    for p in range(len(out)):
        at, part = first[p], columns[p]
        upper = _fused(part, pixels[at + one] - pixels[at], pixels[at])
        lower = _fused(part, pixels[at + below + one] - pixels[at + below], pixels[at + below])
        out[p] = _fused(rows[p], lower - upper, upper)


@compiled
def _interpolate_anywhere(image: FloatImage, columns: FloatImage, rows: FloatImage, out: FloatImage) -> None:
    """Brightness (P,) at places (P,) inside or outside the image; its border is replicated."""
    height, width = image.shape
    for p in range(len(out)):
        column = min(columns[p] if columns[p] > -1.0 else np.float32(-1.0), np.float32(width))  # NaN as well
        row = min(rows[p] if rows[p] > -1.0 else np.float32(-1.0), np.float32(height))
        left, top = np.floor(column), np.floor(row)
        x0, x1 = min(max(int(left), 0), width - 1), min(int(left) + 1, width - 1)
        y0, y1 = min(max(int(top), 0), height - 1), min(int(top) + 1, height - 1)
        upper = _fused(column - left, image[y0, x1] - image[y0, x0], image[y0, x0])
        lower = _fused(column - left, image[y1, x1] - image[y1, x0], image[y1, x0])
        out[p] = _fused(row - top, lower - upper, upper)


@compiled
def compared(
    brightness: FloatImage, weights: FloatImage, weighted: FloatImage, variances: FloatImage
) -> tuple[FloatImage, FloatImage, Array, Array]:
    """As ``patch_sampling.compared``, for patches of 8 to 128 pixels."""
    count, pixels = brightness.shape
    lowest, highest = np.float32(GAIN_LIMITS[0]), np.float32(GAIN_LIMITS[1])
    weighted_brightness, gains = np.empty_like(brightness), np.empty(count, dtype=np.float32)
    correlations, residuals = np.empty(count), np.empty(count)
    products, squares = np.empty(pixels, dtype=np.float32), np.empty(pixels, dtype=np.float32)
    for n in range(count):
        for p in range(pixels):
            weighted_brightness[n, p] = brightness[n, p] * weights[p]
            products[p] = brightness[n, p] * weighted[n, p]
            squares[p] = brightness[n, p] * weighted_brightness[n, p]
        product, mean = _paired_sum(products), _paired_sum(weighted_brightness[n])
        variance = max(_paired_sum(squares) - mean * mean, np.float32(MIN_VARIANCE))
        gains[n] = min(max(product / variances[n], lowest), highest)
        correlations[n] = product / np.sqrt(variances[n] * variance)
        residuals[n] = np.sqrt(variance * max(1.0 - correlations[n] * correlations[n], 0.0))
    return weighted_brightness, gains, correlations, residuals


@compiled
def _paired_sum(values: FloatImage) -> np.float32:
    """Sum of 8 to 128 numbers in NumPy's order: eight partial sums, added in pairs, then the rest."""
    a, b, c, d, e, f, g, h = values[0], values[1], values[2], values[3], values[4], values[5], values[6], values[7]
    whole = len(values) - len(values) % 8
    for i in range(8, whole, 8):
        a += values[i]
        b += values[i + 1]
        c += values[i + 2]
        d += values[i + 3]
        e += values[i + 4]
        f += values[i + 5]
        g += values[i + 6]
        h += values[i + 7]
    total = ((a + b) + (c + d)) + ((e + f) + (g + h))
    for i in range(whole, len(values)):
        total += values[i]
    return np.float32(total)
