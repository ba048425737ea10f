# SPDX-License-Identifier: BSD-3-Clause
"""Brightness of a smoothed image under patches, by bilinear interpolation; the border is replicated outside.

The forms that OpenCV and NumPy compute; where numba is there, ``patch_kernels`` gives the same, faster.
"""

import cv2
import numpy as np

from coclo_vio.frontend import patch_kernels
from coclo_vio.frontend.patch_kernels import GAIN_LIMITS, MIN_VARIANCE
from coclo_vio.geometry.compiled import IS_COMPILED
from coclo_vio.values.arrays import Array, FloatImage


def patches_and_shifts(image: FloatImage, centres: Array, steps: FloatImage) -> tuple[FloatImage, FloatImage]:
    """Brightness (N, P) at ``centres + steps``, and its derivatives (N, 2, P) by column and row: central differences.

    Args:
        image: (rows, columns).
        centres: columns and rows, px, (N, 2).
        steps: columns and rows from the centre, px, (2, P).
    """
    if IS_COMPILED:
        return patch_kernels.patches_and_shifts(image, centres, steps)
    return patches_and_shifts_by_opencv(image, centres, steps)


def compared(
    brightness: FloatImage, weights: FloatImage, weighted: FloatImage, variances: FloatImage
) -> tuple[FloatImage, FloatImage, Array, Array]:
    """Patches compared with their templates.

    Args:
        brightness: of the patches, (N, P).
        weights: of their pixels, with the sum 1, (P,).
        weighted: brightness of the templates minus its mean, times the weights, (N, P).
        variances: of the templates' brightness, (N,).

    Returns:
        The brightness times the weights, (N, P); the gain from template to patch, within limits, (N,); the correlation
        of the two, (N,); the root mean square of what gain and offset do not explain, grey levels, (N,).
    """
    weighted_brightness = brightness * weights
    product = (brightness * weighted).sum(axis=1)
    gains = np.clip(product / variances, *GAIN_LIMITS)
    variance = (brightness * weighted_brightness).sum(axis=1) - weighted_brightness.sum(axis=1) ** 2
    variance = np.maximum(variance, MIN_VARIANCE)
    correlations = (product / np.sqrt(variances * variance)).astype(np.float64)
    residuals = np.sqrt(variance * np.maximum(1.0 - correlations**2, 0.0))
    return weighted_brightness, gains, correlations, residuals


def warped_patches(image: FloatImage, centres: Array, warps: Array, steps: FloatImage) -> FloatImage:
    """Brightness (N, P) under patches: at ``centres + warps steps``, rounded to float32.

    Args:
        image: (rows, columns).
        centres: columns and rows, px, (N, 2).
        warps: from a step in the patch to one in the image, (N, 2, 2).
        steps: columns and rows from the centre, px, (2, P).
    """
    pixels = np.matmul(warps.astype(np.float32), steps) + centres[:, :, None].astype(np.float32)
    return _sampled(image, pixels[:, 0], pixels[:, 1])


def patches_and_shifts_by_opencv(image: FloatImage, centres: Array, steps: FloatImage) -> tuple[FloatImage, FloatImage]:
    """The readable form of ``patches_and_shifts``."""
    pixels = centres[:, :, None].astype(np.float32) + steps
    columns, rows = pixels[:, 0], pixels[:, 1]
    shifts = np.float32(0.5) * np.stack(
        (
            _sampled(image, columns + 1, rows) - _sampled(image, columns - 1, rows),
            _sampled(image, columns, rows + 1) - _sampled(image, columns, rows - 1),
        ),
        axis=1,
    )
    return _sampled(image, columns, rows), shifts


def _sampled(image: FloatImage, columns: FloatImage, rows: FloatImage) -> FloatImage:
    """Bilinear interpolation of the brightness at ``columns`` and ``rows`` (m, n)."""
    if not columns.size:
        return np.zeros(columns.shape, dtype=np.float32)
    columns, rows = np.ascontiguousarray(columns), np.ascontiguousarray(rows)
    sampled = cv2.remap(image, columns, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(sampled, dtype=np.float32)
