# SPDX-License-Identifier: BSD-3-Clause
"""Patches of one image aligned with another to a few hundredths of a pixel, many at a time.

A patch may be shifted, stretched and sheared (six parameters) and its brightness may have another gain and offset.
Gauss-Newton with the gradients of the template (Baker and Matthews, "Lucas-Kanade 20 years on", IJCV 2004); gain and
offset are projected out of them. What a parameter may be is a normal distribution about its nominal value, so a patch
of little texture keeps the shape that is expected of it. On the floor before a robot a patch without shear and stretch
is wrong by a third of a pixel of disparity, and stays so from frame to frame.
"""

from dataclasses import dataclass
from typing import NamedTuple, Self

import cv2
import numpy as np
import numpy.typing as npt

from coclo_vio.frontend.config import LikenessConfig, PatchConfig
from coclo_vio.values.arrays import Array, BoolArray, ByteImage, IntArray

FloatArray = npt.NDArray[np.float32]

_GAINS = (0.3, 3.0)
_LONGEST_STEP_PX = 1.5
_LEAST_VARIANCE = 1e-3
_ALL_ITERATE = 3  # copying what is not settled yet costs more than iterating all
_ROUNDING = 0.3  # standard deviation that eight bits make, grey levels
_FEW = 10  # fewer patches say nothing about the usual residual


class SmoothPair(NamedTuple):
    """Both rectified images, smoothed, (rows, columns) each."""

    left: FloatArray
    right: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Templates:
    """What patches look like, and how that changes with their first k parameters.

    Attributes:
        values: brightness less its mean, (N, P), grey levels.
        slopes: derivative of the brightness by each parameter, without what a gain or an offset explains, (N, k, P).
        hessians: weighted mean of the slopes' outer products, (N, k, k).
    """

    values: FloatArray
    slopes: FloatArray
    hessians: FloatArray

    def select(self, chosen: npt.NDArray[np.bool_] | IntArray) -> Self:
        """The chosen patches, by a mask (N,) or by indices."""
        return type(self)(self.values[chosen], self.slopes[chosen], self.hessians[chosen])

    def joined(self, other: Self) -> Self:
        """These patches, then the other ones."""
        pairs = ((self.values, other.values), (self.slopes, other.slopes), (self.hessians, other.hessians))
        return type(self)(*(np.concatenate(pair) for pair in pairs))

    def replaced(self, chosen: BoolArray, other: Self) -> Self:
        """These patches with the other ones in the chosen places (N,)."""
        arrays = [array.copy() for array in (self.values, self.slopes, self.hessians)]
        for array, new in zip(arrays, (other.values, other.slopes, other.hessians), strict=True):
            array[chosen] = new
        return type(self)(*arrays)


@dataclass(frozen=True, slots=True, eq=False)
class Alignment:
    """Where patches were found.

    Attributes:
        centres: columns and rows of their middles, (N, 2).
        shapes: what maps a step inside the template to one in the image, (N, 2, 2).
        scores: correlation with the template, -1..1, (N,).
        residuals: root mean square of what gain and offset do not explain, grey levels, (N,).
        is_settled: whether the last step was short, (N,).
    """

    centres: Array
    shapes: Array
    scores: Array
    residuals: Array
    is_settled: BoolArray


def alike(alignment: Alignment, config: LikenessConfig) -> BoolArray:
    """Which patches show the same as their templates, (N,).

    What the images' noise leaves is about the same for all patches of a frame; where much more is left, it was no plane
    or something came before it.
    """
    sound = alignment.is_settled & (alignment.scores > config.score)
    if sound.sum() < _FEW:
        return sound
    usual = max(float(np.median(alignment.residuals[sound])), _ROUNDING)
    contrast = alignment.residuals / np.sqrt(np.maximum(1.0 - alignment.scores**2, _LEAST_VARIANCE))
    return sound & (alignment.residuals < np.hypot(config.residual_ratio * usual, config.contrast_share * contrast))


class PatchAligner:
    """Square patches of one size, whose middle counts more than their rim."""

    def __init__(self, config: PatchConfig) -> None:
        self._config = config
        half = config.window_px // 2
        steps = np.arange(-half, half + 1, config.stride_px, dtype=np.float32)
        columns, rows = np.meshgrid(steps, steps)
        self._offsets = np.stack((columns.ravel(), rows.ravel()), axis=1)  # (P, 2)
        weights = np.exp(-0.5 * (self._offsets**2).sum(axis=1) / config.taper_px**2)
        self._weights = (weights / weights.sum()).astype(np.float32)

    def smoothed(self, image: ByteImage) -> FloatArray:
        """The image as this class takes it, (rows, columns): a little blur takes noise and the grid of pixels away."""
        blurred = cv2.GaussianBlur(image.astype(np.float32), (5, 5), self._config.blur_px)
        return np.asarray(blurred, dtype=np.float32)

    def templates(self, image: FloatArray, centres: Array, parameters: int = 6) -> Templates:
        """The patches of a smoothed image about centres (N, 2), px, that may change in the first so many parameters."""
        places = centres[:, None].astype(np.float32) + self._offsets
        columns, rows = places[:, :, 0], places[:, :, 1]
        values = _sampled(image, columns, rows)
        values = values - (values @ self._weights)[:, None]
        shifts = np.float32(0.5) * np.stack(
            (
                _sampled(image, columns + 1, rows) - _sampled(image, columns - 1, rows),
                _sampled(image, columns, rows + 1) - _sampled(image, columns, rows - 1),
            ),
            axis=1,
        )
        stretches = shifts[:, :, None] * self._offsets.T
        slopes = np.concatenate((shifts, stretches.reshape(len(shifts), 4, len(self._weights))), axis=1)[:, :parameters]
        slopes -= (slopes @ self._weights)[:, :, None]
        weighted = values * self._weights
        variance = np.maximum((weighted * values).sum(axis=1), _LEAST_VARIANCE)
        slopes -= np.matmul(slopes, weighted[:, :, None]) / variance[:, None, None] * values[:, None]
        return Templates(values, slopes, np.matmul(slopes * self._weights, slopes.transpose(0, 2, 1)))

    def align(
        self,
        templates: Templates,
        image: FloatArray,
        centres: Array,
        shapes: Array,
        spreads: Array,
        start: Array | None = None,
    ) -> Alignment:
        """Find templates in a smoothed image.

        Args:
            templates: N patches of k parameters.
            image: (rows, columns).
            centres: where their middles should nominally be, (N, 2).
            shapes: how they should nominally be stretched and sheared, (N, 2, 2).
            spreads: one sigma of the first k of [column, row (px), d column / d column, d column / d row, d row / d
                column, d row / d row] from the nominal, in the template's axes, (k,).
            start: where the search begins, from the nominal, (N, 6); by default there.
        """
        count, k = len(centres), len(spreads)
        prior = (self._config.noise / spreads) ** 2 / len(self._weights)
        inverses = np.linalg.inv(templates.hessians.astype(np.float64) + np.diag(prior))
        weighted = templates.values * self._weights
        variances = np.maximum((weighted * templates.values).sum(axis=1), _LEAST_VARIANCE)
        parameters = np.zeros((count, 6)) if start is None else start.copy()
        scores, residuals, settled = np.zeros(count), np.zeros(count), np.zeros(count, dtype=np.bool_)
        active = np.arange(count)
        for number in range(self._config.iterations):
            chosen: slice | IntArray = active if number >= _ALL_ITERATE else slice(None)
            seen = self._seen(image, centres[chosen], shapes[chosen], parameters[chosen])
            seen_weighted = seen * self._weights
            product = (seen * weighted[chosen]).sum(axis=1)
            gain = np.clip(product / variances[chosen], *_GAINS)
            slope = np.matmul(templates.slopes[chosen], seen_weighted[:, :, None])[:, :, 0] / gain[:, None]
            slope = slope + prior * parameters[chosen, :k]
            step = -np.matmul(inverses[chosen], slope[:, :, None])[:, :, 0]
            longest = np.abs(step[:, :2]).max(axis=1)
            parameters[chosen, :k] += step * np.minimum(1.0, _LONGEST_STEP_PX / (longest + 1e-9))[:, None]
            energy = (seen * seen_weighted).sum(axis=1) - seen_weighted.sum(axis=1) ** 2
            energy = np.maximum(energy, _LEAST_VARIANCE)
            scores[chosen] = product / np.sqrt(variances[chosen] * energy)
            residuals[chosen] = np.sqrt(energy * np.maximum(1.0 - scores[chosen] ** 2, 0.0))
            settled[chosen] = longest < self._config.precision_px
            active = np.flatnonzero(~settled)
            if not len(active):
                break
        middles, whole = _placed(centres, shapes, parameters)
        return Alignment(middles, whole, scores, residuals, settled)

    def _seen(self, image: FloatArray, centres: Array, shapes: Array, parameters: Array) -> FloatArray:
        """Brightness (N, P) of the image where the patches lie under their parameters (N, 6)."""
        middles, whole = _placed(centres, shapes, parameters)
        places = np.matmul(whole.astype(np.float32), self._offsets.T) + middles[:, :, None].astype(np.float32)
        return _sampled(image, places[:, 0], places[:, 1])


def _placed(centres: Array, shapes: Array, parameters: Array) -> tuple[Array, Array]:
    """Middles (N, 2) and shapes (N, 2, 2) of patches with their parameters (N, 6) from the nominal."""
    middles = centres + np.matmul(shapes, parameters[:, :2, None])[:, :, 0]
    return middles, np.matmul(shapes, np.eye(2) + parameters[:, 2:].reshape(-1, 2, 2))


def _sampled(image: FloatArray, columns: FloatArray, rows: FloatArray) -> FloatArray:
    """Brightness between pixels, bilinear, at ``columns`` and ``rows`` (m, n); the edge goes on outside."""
    if not columns.size:
        return np.zeros(columns.shape, dtype=np.float32)
    columns, rows = np.ascontiguousarray(columns), np.ascontiguousarray(rows)
    seen = cv2.remap(image, columns, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(seen, dtype=np.float32)
