# SPDX-License-Identifier: BSD-3-Clause
"""Alignment of patches of one image with another to a few hundredths of a pixel, many at a time.

The warp of a patch is affine: shift, stretch and shear, six parameters; its brightness may differ by a gain and an
offset. Gauss-Newton with the gradients of the template (Baker and Matthews, "Lucas-Kanade 20 years on", IJCV 2004);
gain and offset are projected out of them. Each parameter has a normal prior about its nominal value, so a patch of
little texture keeps its predicted warp. On the floor before a robot the disparity of a patch without shear and stretch
is wrong by a third of a pixel, from frame to frame.
"""

from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np

from coclo_vio.frontend.config import PatchConfig, SimilarityConfig
from coclo_vio.frontend.patch_alignment import Iterations, Templates, align, warped
from coclo_vio.frontend.patch_kernels import MIN_VARIANCE
from coclo_vio.frontend.patch_sampling import patches_and_shifts
from coclo_vio.values.arrays import Array, BoolArray, ByteImage, FloatImage

FREE_PX = 100.0  # sigma of a shift without a prior

_ROUNDING = 0.3  # standard deviation of the rounding to eight bits, grey levels
_MIN_PATCHES = 10  # no median residual from fewer


class SmoothPair(NamedTuple):
    """Both rectified images, smoothed, (rows, columns) each."""

    left: FloatImage
    right: FloatImage


@dataclass(frozen=True, slots=True, eq=False)
class Alignment:
    """Patches aligned in an image.

    Attributes:
        centres: columns and rows of their centres, (N, 2).
        warps: map a step inside the template to one in the image, (N, 2, 2).
        correlations: with the template, -1..1, (N,).
        residuals: root mean square after gain and offset, grey levels, (N,).
        is_converged: whether the last step was short, (N,).
    """

    centres: Array
    warps: Array
    correlations: Array
    residuals: Array
    is_converged: BoolArray


def are_similar(alignment: Alignment, config: SimilarityConfig) -> BoolArray:
    """Whether patches show the same as their templates, (N,).

    The residual of image noise is about the same for all patches of a frame. A patch with a much larger residual is not
    planar or is occluded.
    """
    is_candidate = alignment.is_converged & (alignment.correlations > config.min_correlation)
    if is_candidate.sum() < _MIN_PATCHES:
        return is_candidate
    median = max(median_of(alignment.residuals[is_candidate]), _ROUNDING)
    contrast = alignment.residuals / np.sqrt(np.maximum(1.0 - alignment.correlations**2, MIN_VARIANCE))
    limit = np.hypot(config.max_residual_ratio * median, config.contrast_share * contrast)
    return is_candidate & (alignment.residuals < limit)


def median_of(values: Array) -> float:
    """The median of finite numbers (N,), N > 0, by their ranks: a third of the time of ``np.median``."""
    low, high = (len(values) - 1) // 2, len(values) // 2
    ranked = np.partition(values, (low, high))
    return float(0.5 * (ranked[low] + ranked[high]))


class PatchAligner:
    """Aligns square patches of one size under a Gaussian weight about their centres."""

    def __init__(self, config: PatchConfig) -> None:
        self._config = config
        half = config.window_px // 2
        steps = np.arange(-half, half + 1, config.stride_px, dtype=np.float32)
        self._steps: FloatImage = np.stack(np.meshgrid(steps, steps)).reshape(2, -1)  # columns and rows, (2, P)
        weights = np.exp(-0.5 * (self._steps**2).sum(axis=0) / config.weight_sigma_px**2)
        self._weights = (weights / weights.sum()).astype(np.float32)
        self._iterations = Iterations(config.iterations, config.precision_px)
        self._unsmoothed: FloatImage = np.zeros((0, 0), dtype=np.float32)  # memory of smooth_image

    def smooth_image(self, image: ByteImage, out: FloatImage | None = None) -> FloatImage:
        """The image as this class takes it, (rows, columns): a little blur suppresses noise and aliasing.

        Args:
            image: (rows, columns).
            out: memory of the result, (rows, columns), so that no frame has to ask for pages anew; fresh by default.
        """
        if self._unsmoothed.shape != image.shape:
            self._unsmoothed = np.empty(image.shape, dtype=np.float32)
        np.copyto(self._unsmoothed, image)
        blurred = cv2.GaussianBlur(self._unsmoothed, (5, 5), self._config.blur_sigma_px, dst=out)
        return np.asarray(blurred, dtype=np.float32)

    def templates(self, image: FloatImage, centres: Array, sigmas: Array) -> Templates:
        """Templates about centres of a smoothed image.

        Args:
            image: (rows, columns).
            centres: columns and rows, px, (N, 2).
            sigmas: of the priors of the first k of [column, row (px), d column / d column, d column / d row, d row / d
                column, d row / d row] about the nominal, in the template's axes, (k,); no more than these are aligned.
        """
        values, shifts = patches_and_shifts(image, centres, self._steps)
        values -= (values @ self._weights)[:, None]
        gradients = np.empty((len(values), len(sigmas), len(self._weights)), dtype=np.float32)
        gradients[:, :2] = shifts
        for number in range(2, len(sigmas)):  # stretch and shear
            np.multiply(shifts[:, number // 2 - 1], self._steps[number % 2], out=gradients[:, number])
        gradients -= (gradients @ self._weights)[:, :, None]
        weighted = values * self._weights
        variances = np.maximum((weighted * values).sum(axis=1), MIN_VARIANCE)
        gradients -= np.matmul(gradients, weighted[:, :, None]) / variances[:, None, None] * values[:, None]
        hessians = np.matmul(gradients * self._weights, gradients.transpose(0, 2, 1)).astype(np.float64)
        prior = (self._config.noise / sigmas) ** 2 / len(self._weights)
        return Templates(weighted, variances, gradients, np.linalg.inv(hessians + np.diag(prior)), prior)

    def sigmas(self, templates: Templates) -> Array:
        """One sigma of the aligned parameters of each template by image noise and their priors, (N, k)."""
        noise = self._config.noise / np.sqrt(len(self._weights))
        return np.asarray(noise * np.sqrt(np.diagonal(templates.inverses, axis1=1, axis2=2)))

    def bend_shifts(self, templates: Templates, bends: Array) -> Array:
        """How far ``align`` puts patches off because their image bends, in the template's axes, px, (N, 2).

        A step ``u`` of the template goes to ``warp u / (1 + bend u)``: it is displaced by ``-u (bend u)``, to first
        order, in the same direction on both sides of the centre. The affine warp that fits best makes up for it by a
        shift, which follows from the template's gradients and priors as every step of ``align`` does.

        Args:
            templates: N patches, whose first two parameters are the shift.
            bends: 1/px, (N, 2).
        """
        bent = (bends @ self._steps)[:, None] * self._steps  # (N, 2, P)
        change = (templates.gradients[:, :2] * bent).sum(axis=1) * self._weights
        by_parameter = np.matmul(templates.gradients, change[:, :, None].astype(np.float32))
        return -np.asarray(np.matmul(templates.inverses, by_parameter)[:, :2, 0])

    def align(
        self, templates: Templates, image: FloatImage, centres: Array, warps: Array, start: Array | None = None
    ) -> Alignment:
        """Align templates with a smoothed image.

        Args:
            templates: N patches.
            image: (rows, columns).
            centres: nominal centres, px, (N, 2).
            warps: nominal warps, (N, 2, 2).
            start: initial parameters from the nominal, (N, 6); zero by default.
        """
        parameters = np.zeros((len(centres), 6)) if start is None else start.copy()
        correlations, residuals, is_converged = align(
            templates, image, (centres, warps), parameters, (self._steps, self._weights), self._iterations
        )
        return Alignment(*warped(centres, warps, parameters), correlations, residuals, is_converged)
