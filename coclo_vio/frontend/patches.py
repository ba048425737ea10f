# SPDX-License-Identifier: BSD-3-Clause
"""Alignment of patches of one image with another to a few hundredths of a pixel, many at a time.

The warp of a patch is affine: shift, stretch and shear, six parameters; its brightness may differ by a gain and an
offset. Gauss-Newton with the gradients of the template (Baker and Matthews, "Lucas-Kanade 20 years on", IJCV 2004);
gain and offset are projected out of them. Each parameter has a normal prior about its nominal value, so a patch of
little texture keeps its predicted warp. On the floor before a robot the disparity of a patch without shear and stretch
is wrong by a third of a pixel, from frame to frame.
"""

from dataclasses import dataclass
from typing import NamedTuple, Self

import cv2
import numpy as np

from coclo_vio.frontend.config import PatchConfig, SimilarityConfig
from coclo_vio.frontend.patch_kernels import MIN_VARIANCE
from coclo_vio.frontend.patch_sampling import compared, patches_and_shifts, warped_patches
from coclo_vio.values.arrays import Array, BoolArray, ByteImage, FloatImage, IntArray

FREE_PX = 100.0  # sigma of a shift without a prior

_MAX_STEP_PX = 1.5
_ITERATIONS_OF_ALL = 3  # at first copying the unconverged patches costs more than iterating all
_ROUNDING = 0.3  # standard deviation of the rounding to eight bits, grey levels
_IDENTITY = np.eye(2)
_MIN_PATCHES = 10  # no median residual from fewer


class SmoothPair(NamedTuple):
    """Both rectified images, smoothed, (rows, columns) each."""

    left: FloatImage
    right: FloatImage


@dataclass(frozen=True, slots=True, eq=False)
class Templates:
    """Patch templates: brightness and its derivatives by the first k parameters of the warp.

    Attributes:
        values: brightness minus its mean, (N, P), grey levels.
        gradients: derivative of the brightness by each parameter; gain and offset projected out, (N, k, P).
        hessians: weighted mean of the gradients' outer products, (N, k, k).
    """

    values: FloatImage
    gradients: FloatImage
    hessians: FloatImage

    def select(self, chosen: BoolArray | IntArray) -> Self:
        """The chosen templates, by a mask (N,) or by indices."""
        return type(self)(self.values[chosen], self.gradients[chosen], self.hessians[chosen])

    def joined(self, other: Self) -> Self:
        """These templates, then the other ones."""
        pairs = ((self.values, other.values), (self.gradients, other.gradients), (self.hessians, other.hessians))
        return type(self)(*(np.concatenate(pair) for pair in pairs))

    def replaced(self, chosen: BoolArray, other: Self) -> Self:
        """These templates with the other ones in place of the chosen, (N,)."""
        arrays = [array.copy() for array in (self.values, self.gradients, self.hessians)]
        for array, new in zip(arrays, (other.values, other.gradients, other.hessians), strict=True):
            array[chosen] = new
        return type(self)(*arrays)


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
    median = max(float(np.median(alignment.residuals[is_candidate])), _ROUNDING)
    contrast = alignment.residuals / np.sqrt(np.maximum(1.0 - alignment.correlations**2, MIN_VARIANCE))
    limit = np.hypot(config.max_residual_ratio * median, config.contrast_share * contrast)
    return is_candidate & (alignment.residuals < limit)


class PatchAligner:
    """Aligns square patches of one size under a Gaussian weight about their centres."""

    def __init__(self, config: PatchConfig) -> None:
        self._config = config
        half = config.window_px // 2
        steps = np.arange(-half, half + 1, config.stride_px, dtype=np.float32)
        self._steps: FloatImage = np.stack(np.meshgrid(steps, steps)).reshape(2, -1)  # columns and rows, (2, P)
        weights = np.exp(-0.5 * (self._steps**2).sum(axis=0) / config.weight_sigma_px**2)
        self._weights = (weights / weights.sum()).astype(np.float32)
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

    def templates(self, image: FloatImage, centres: Array, parameters: int = 6) -> Templates:
        """Templates about centres (N, 2), px, of a smoothed image, for the first so many parameters of the warp."""
        values, shifts = patches_and_shifts(image, centres, self._steps)
        values -= (values @ self._weights)[:, None]
        gradients = np.empty((len(values), parameters, len(self._weights)), dtype=np.float32)
        gradients[:, :2] = shifts
        for number in range(2, parameters):  # stretch and shear
            np.multiply(shifts[:, number // 2 - 1], self._steps[number % 2], out=gradients[:, number])
        gradients -= (gradients @ self._weights)[:, :, None]
        weighted = values * self._weights
        variance = np.maximum((weighted * values).sum(axis=1), MIN_VARIANCE)
        gradients -= np.matmul(gradients, weighted[:, :, None]) / variance[:, None, None] * values[:, None]
        return Templates(values, gradients, np.matmul(gradients * self._weights, gradients.transpose(0, 2, 1)))

    def align(
        self,
        templates: Templates,
        image: FloatImage,
        centres: Array,
        warps: Array,
        sigmas: Array,
        start: Array | None = None,
    ) -> Alignment:
        """Align templates with a smoothed image.

        Args:
            templates: N patches of k parameters.
            image: (rows, columns).
            centres: nominal centres, px, (N, 2).
            warps: nominal warps, (N, 2, 2).
            sigmas: of the priors of the first k of [column, row (px), d column / d column, d column / d row, d row / d
                column, d row / d row] about the nominal, in the template's axes, (k,).
            start: initial parameters from the nominal, (N, 6); zero by default.
        """
        count, k = len(centres), len(sigmas)
        prior = (self._config.noise / sigmas) ** 2 / len(self._weights)
        inverses = np.linalg.inv(templates.hessians.astype(np.float64) + np.diag(prior))
        weighted = templates.values * self._weights
        variances = np.maximum((weighted * templates.values).sum(axis=1), MIN_VARIANCE)
        parameters = np.zeros((count, 6)) if start is None else start.copy()
        correlations, residuals = np.zeros(count), np.zeros(count)
        is_converged = np.zeros(count, dtype=np.bool_)
        active = np.arange(count)
        for number in range(self._config.iterations):
            chosen: slice | IntArray = active if number >= _ITERATIONS_OF_ALL else slice(None)
            at = parameters[chosen]
            brightness = warped_patches(image, *_warped(centres[chosen], warps[chosen], at), self._steps)
            weighted_brightness, gains, correlations[chosen], residuals[chosen] = compared(
                brightness, self._weights, weighted[chosen], variances[chosen]
            )
            gradient = np.matmul(templates.gradients[chosen], weighted_brightness[:, :, None])[:, :, 0]
            gradient = gradient / gains[:, None] + prior * at[:, :k]
            step = -np.matmul(inverses[chosen], gradient[:, :, None])[:, :, 0]
            longest = np.maximum(np.abs(step[:, 0]), np.abs(step[:, 1]))
            parameters[chosen, :k] += step * np.minimum(1.0, _MAX_STEP_PX / (longest + 1e-9))[:, None]
            is_converged[chosen] = longest < self._config.precision_px
            active = np.flatnonzero(~is_converged)
            if not len(active):
                break
        aligned_centres, aligned_warps = _warped(centres, warps, parameters)
        return Alignment(aligned_centres, aligned_warps, correlations, residuals, is_converged)


def _warped(centres: Array, warps: Array, parameters: Array) -> tuple[Array, Array]:
    """Centres (N, 2) and warps (N, 2, 2) of patches at parameters (N, 6) from the nominal."""
    shifted = centres + np.matmul(warps, parameters[:, :2, None])[:, :, 0]
    return shifted, np.matmul(warps, _IDENTITY + parameters[:, 2:].reshape(-1, 2, 2))
