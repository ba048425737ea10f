# SPDX-License-Identifier: BSD-3-Clause
"""Gauss-Newton iterations that align patches with an image; ``patch_kernels`` has them compiled, to the bit."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from coclo_vio.frontend import patch_kernels
from coclo_vio.frontend.patch_kernels import ITERATIONS_OF_ALL, MAX_STEP_PX
from coclo_vio.frontend.patch_sampling import compared, warped_patches
from coclo_vio.geometry.compiled import IS_COMPILED
from coclo_vio.values.arrays import Array, BoolArray, FloatImage, IntArray

_PAIRED = (8, 128)  # numbers that NumPy adds in one block
_IDENTITY = np.eye(2)


@dataclass(frozen=True, slots=True, eq=False)
class Templates:
    """Patch templates: brightness and its derivatives by the first k parameters of the warp.

    Attributes:
        weighted: brightness minus its mean, times the weights of the pixels, (N, P), grey levels.
        variances: weighted mean of the squared brightness minus its mean, (N,).
        gradients: derivative of the brightness by each parameter; gain and offset projected out, (N, k, P).
        inverses: of the Hessians: the weighted mean of the gradients' outer products, and the prior, (N, k, k).
        prior: information of the prior of each parameter about its nominal value, (k,).
    """

    weighted: FloatImage
    variances: FloatImage
    gradients: FloatImage
    inverses: Array
    prior: Array

    def select(self, chosen: BoolArray | IntArray) -> Self:
        """The chosen templates, by a mask (N,) or by indices."""
        return type(self)(
            self.weighted[chosen],
            self.variances[chosen],
            self.gradients[chosen],
            self.inverses[chosen],
            self.prior,
        )

    def joined(self, other: Self) -> Self:
        """These templates, then the other ones, which have the same prior."""
        return type(self)(
            np.concatenate((self.weighted, other.weighted)),
            np.concatenate((self.variances, other.variances)),
            np.concatenate((self.gradients, other.gradients)),
            np.concatenate((self.inverses, other.inverses)),
            self.prior,
        )

    def replaced(self, chosen: BoolArray, other: Self) -> Self:
        """These templates with the other ones, which have the same prior, in place of the chosen, (N,)."""
        order = np.arange(len(chosen))
        order[chosen] = len(chosen) + np.arange(len(other.variances))
        return self.joined(other).select(order)


@dataclass(frozen=True, slots=True)
class Iterations:
    """When to stop.

    Attributes:
        most: number of iterations.
        precision_px: a patch with a smaller step has converged.
    """

    most: int
    precision_px: float


def align(
    templates: Templates,
    image: FloatImage,
    places: tuple[Array, Array],
    parameters: Array,
    window: tuple[FloatImage, FloatImage],
    iterations: Iterations,
) -> tuple[Array, Array, BoolArray]:
    """Align templates with a smoothed image.

    Args:
        templates: N patches of P pixels and k parameters.
        image: (rows, columns).
        places: nominal centres, px, (N, 2), and warps, (N, 2, 2).
        parameters: of the warps from the nominal, (N, 6); they are changed to those of the aligned patches.
        window: columns and rows of the pixels from the centre, px, (2, P), and their weights, (P,).
        iterations: when to stop.

    Returns:
        Correlations with the templates, (N,); root mean square after gain and offset, grey levels, (N,); whether the
        last step was short, (N,).
    """
    if not IS_COMPILED or not _PAIRED[0] <= len(window[1]) <= _PAIRED[1]:
        return aligned_by_numpy(templates, image, places, parameters, window, iterations)
    count, pixels = len(parameters), len(window[1])
    arrays = templates.weighted, templates.variances, templates.gradients, templates.inverses, templates.prior
    correlations, residuals, is_converged = np.zeros(count), np.zeros(count), np.zeros(count, dtype=np.bool_)
    results = parameters, correlations, residuals, is_converged
    memory = np.empty((5, pixels), dtype=np.float32), np.empty(pixels, dtype=np.uint64)
    limits = iterations.most, iterations.precision_px
    patch_kernels.align(image, window, arrays, places, results, memory, limits)
    return correlations, residuals, is_converged


def aligned_by_numpy(
    templates: Templates,
    image: FloatImage,
    places: tuple[Array, Array],
    parameters: Array,
    window: tuple[FloatImage, FloatImage],
    iterations: Iterations,
) -> tuple[Array, Array, BoolArray]:
    """The readable form of ``align``."""
    (centres, warps), (steps, weights), prior = places, window, templates.prior
    count, k = len(centres), len(prior)
    correlations, residuals = np.zeros(count), np.zeros(count)
    is_converged = np.zeros(count, dtype=np.bool_)
    active = np.arange(count)
    for number in range(iterations.most):
        chosen: slice | IntArray = active if number >= ITERATIONS_OF_ALL else slice(None)
        at = parameters[chosen]
        brightness = warped_patches(image, *warped(centres[chosen], warps[chosen], at), steps)
        weighted_brightness, gains, correlations[chosen], residuals[chosen] = compared(
            brightness, weights, templates.weighted[chosen], templates.variances[chosen]
        )
        gradient = np.matmul(templates.gradients[chosen], weighted_brightness[:, :, None])[:, :, 0]
        gradient = gradient / gains[:, None] + prior * at[:, :k]
        step = -np.matmul(templates.inverses[chosen], gradient[:, :, None])[:, :, 0]
        longest = np.maximum(np.abs(step[:, 0]), np.abs(step[:, 1]))
        parameters[chosen, :k] += step * np.minimum(1.0, MAX_STEP_PX / (longest + 1e-9))[:, None]
        is_converged[chosen] = longest < iterations.precision_px
        active = np.flatnonzero(~is_converged)
        if not len(active):
            break
    return correlations, residuals, is_converged


def warped(centres: Array, warps: Array, parameters: Array) -> tuple[Array, Array]:
    """Centres (N, 2) and warps (N, 2, 2) of patches at parameters (N, 6) from the nominal."""
    shifted = centres + np.matmul(warps, parameters[:, :2, None])[:, :, 0]
    return shifted, np.matmul(warps, _IDENTITY + parameters[:, 2:].reshape(-1, 2, 2))
