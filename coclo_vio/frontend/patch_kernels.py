# SPDX-License-Identifier: BSD-3-Clause
"""Compiled sampling and alignment of patches; ``patch_sampling`` and ``patch_alignment`` have the readable forms.

A patch is a list of P steps about its centre. Products are added as fused operations, as OpenCV 5 and NumPy's linear
algebra do where the processor has them, in the same order: both forms then agree to the bit. Arrays of pixels are
float32.
"""

from typing import Any

import numpy as np
import numpy.typing as npt

from coclo_vio.geometry.compiled import IS_COMPILED, compiled, compiled_without_gil
from coclo_vio.values.arrays import Array, BoolArray, FloatImage

GAIN_LIMITS = (0.3, 3.0)  # of the brightness of a patch to that of its template
MIN_VARIANCE = 1e-3  # of the brightness of a patch, so that none is divided by zero
MAX_STEP_PX = 1.5
ITERATIONS_OF_ALL = 3  # then only the patches that have not converged are iterated

_Indices = npt.NDArray[np.uint64]
_fused: Any = None  # a b + c, rounded once

if IS_COMPILED:
    from numba.extending import intrinsic

    @intrinsic
    def _fused_product(_context, a, b, c):  # type: ignore[no-untyped-def]
        return a(a, b, c), lambda _, builder, __, arguments: builder.fma(*arguments)

    _fused = _fused_product


@compiled_without_gil
def align(
    image: FloatImage,
    window: tuple[FloatImage, FloatImage],
    templates: tuple[FloatImage, FloatImage, FloatImage, Array, Array],
    places: tuple[Array, Array],
    results: tuple[Array, Array, Array, BoolArray],
    memory: tuple[FloatImage, _Indices],
    limits: tuple[int, float],
) -> None:
    """As ``patch_alignment.aligned_by_numpy``, for patches of 8 to 128 pixels.

    ``results`` are parameters, correlations, residuals and convergence; memory is (5, P) and (P,).
    """
    (steps, weights), (weighted, variances, gradients, inverses, prior), (centres, warps) = window, templates, places
    (parameters, correlations, residuals, is_converged), (lines, first) = results, memory
    count, longest_step, (most, precision_px) = len(centres), _longest(steps), limits
    columns, rows, brightness, products, squares = lines[0], lines[1], lines[2], lines[3], lines[4]
    centre, warp = np.empty(2), np.empty((2, 2))
    gradient, full, step = np.empty(len(prior), dtype=np.float32), np.empty(len(prior)), np.empty(len(prior))
    for number in range(most):
        is_done = True
        for n in range(count):
            if is_converged[n] and number >= ITERATIONS_OF_ALL:
                continue
            _move(centres[n], warps[n], parameters[n], centre, warp)
            _warp(np.float32(centre[0]), warp[0], steps, columns)
            _warp(np.float32(centre[1]), warp[1], steps, rows)
            if _is_inside(image, centre, warp, longest_step):
                _interpolate(image, columns, rows, first, brightness)
            else:
                _interpolate_anywhere(image, columns, rows, brightness)
            gain, correlations[n], residuals[n] = _compare(
                brightness, weights, weighted[n], variances[n], products, squares
            )
            np.dot(gradients[n], brightness, gradient)
            for i in range(len(prior)):
                full[i] = gradient[i] / gain + prior[i] * parameters[n, i]
            np.dot(inverses[n], full, step)
            longest = max(abs(step[0]), abs(step[1]))
            share = min(1.0, MAX_STEP_PX / (longest + 1e-9))
            for i in range(len(prior)):
                parameters[n, i] -= step[i] * share
            is_converged[n] = longest < precision_px
            is_done &= is_converged[n]
        if is_done:
            break


@compiled
def _longest(steps: FloatImage) -> float:
    """The longest of the steps (2, P) along a column or a row, px."""
    longest = 0.0
    for p in range(steps.shape[1]):
        longest = max(longest, abs(steps[0, p]), abs(steps[1, p]))
    return longest


@compiled
def _move(centre: Array, warp: Array, parameters: Array, moved_centre: Array, moved_warp: Array) -> None:
    """Centre (2,) and warp (2, 2) of a patch at parameters (6,) from the nominal."""
    for i in range(2):
        moved_centre[i] = centre[i] + _fused(warp[i, 0], parameters[0], warp[i, 1] * parameters[1])
        left, right = warp[i, 0], warp[i, 1]
        moved_warp[i, 0] = _fused(right, parameters[4], left * (1.0 + parameters[2]))
        moved_warp[i, 1] = _fused(right, 1.0 + parameters[5], left * parameters[3])


@compiled_without_gil
def patches_and_shifts(image: FloatImage, centres: Array, steps: FloatImage) -> tuple[FloatImage, FloatImage]:
    """Brightness (N, P) at ``centres + steps`` and its derivatives (N, 2, P) by column and row; arguments as above."""
    count, longest, identity = steps.shape[1], _longest(steps) + 1.0, np.eye(2)
    brightness = np.empty((len(centres), count), dtype=np.float32)
    shifts = np.empty((len(centres), 2, count), dtype=np.float32)
    first, samples = np.empty(count, dtype=np.uint64), np.empty((5, count), dtype=np.float32)
    columns, rows = np.empty(count, dtype=np.float32), np.empty(count, dtype=np.float32)
    for n in range(len(centres)):
        is_inside = _is_inside(image, centres[n], identity, longest)
        for number, (column, row) in enumerate(((0, 0), (1, 0), (-1, 0), (0, 1), (0, -1))):
            for p in range(count):
                columns[p] = np.float32(centres[n, 0]) + steps[0, p] + np.float32(column)
                rows[p] = np.float32(centres[n, 1]) + steps[1, p] + np.float32(row)
            if is_inside:
                _interpolate(image, columns, rows, first, samples[number])
            else:
                _interpolate_anywhere(image, columns, rows, samples[number])
        for p in range(count):
            brightness[n, p] = samples[0, p]
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
def _compare(
    brightness: FloatImage,
    weights: FloatImage,
    weighted: FloatImage,
    variance: np.float32,
    products: FloatImage,
    squares: FloatImage,
) -> tuple[np.float32, float, float]:
    """Gain, correlation and residual of a patch (P,), as ``patch_sampling.compared``; the others (P,) are memory.

    ``brightness`` becomes the brightness times the weights.
    """
    for p in range(len(brightness)):
        value = brightness[p]
        brightness[p] = value * weights[p]
        products[p] = value * weighted[p]
        squares[p] = value * brightness[p]
    product, mean = _paired_sum(products), _paired_sum(brightness)
    own = max(_paired_sum(squares) - mean * mean, np.float32(MIN_VARIANCE))
    gain = min(max(product / variance, np.float32(GAIN_LIMITS[0])), np.float32(GAIN_LIMITS[1]))
    correlation = np.float64(product / np.sqrt(variance * own))
    return gain, correlation, np.sqrt(own * max(1.0 - correlation * correlation, 0.0))


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
