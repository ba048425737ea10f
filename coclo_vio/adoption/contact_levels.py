# SPDX-License-Identifier: BSD-3-Clause
"""Contact thresholds from the loads on the feet: a mixture of two normal distributions, in the air and on the floor.

A walking robot has both; of one that never lifts a foot there is only the second.
"""

from dataclasses import dataclass

import numpy as np

from coclo_vio.values.arrays import Array

_MOST_LOADS = 20_000
_STEPS = 200
_ON_SHARE, _OFF_SHARE = 0.55, 0.38  # of the mean load of a standing foot
_APART = 2.0  # distance of the two means in deviations, from which there are two kinds of load
_RAREST = 0.03  # share of the samples
_LARGEST_SWING = 0.4  # of the load of a standing foot: a foot in the air reads less


@dataclass(frozen=True, slots=True)
class ContactLevels:
    """Loads of feet in the air and on the floor, and the thresholds between them, in the unit of the loads.

    Attributes:
        swing: mean load of a foot in the air; 0 where no foot was lifted.
        stance: mean load of a foot on the floor.
        separation: distance of the two in deviations; 0 where no foot was lifted.
        on: load from which a foot is in stance.
        off: load below which it is in swing.
        confidence: 0..1.
    """

    swing: float
    stance: float
    separation: float
    on: float
    off: float
    confidence: float


def contact_levels(loads: Array) -> ContactLevels:
    """Thresholds from loads (N, legs); NaN is no reading."""
    values = loads[np.isfinite(loads)]
    if len(values) > _MOST_LOADS:
        values = np.random.default_rng(0).choice(values, _MOST_LOADS, replace=False)
    weights, means, deviations = _mixture(values)
    separation = float((means[1] - means[0]) / np.sqrt(0.5 * (deviations**2).sum()))
    if separation < _APART or weights.min() < _RAREST or means[0] > _LARGEST_SWING * means[1]:
        stance = float(np.median(values))
        return ContactLevels(0.0, stance, 0.0, _rounded(0.5 * stance), _rounded(0.3 * stance), 0.4)
    swing = float(means[0])
    stance = float(np.mean(values[values > 0.5 * (means[0] + means[1])]))  # without touch-down and lift-off
    quiet = swing + 3.0 * float(deviations[0])  # few feet in the air read more
    off = min(max(_OFF_SHARE * stance, quiet), 0.6 * stance)
    on = max(_ON_SHARE * stance, 1.2 * off)
    return ContactLevels(swing, stance, separation, _rounded(on), _rounded(off), min(0.95, 0.25 * separation))


def swing_scatter(loads: Array, levels: ContactLevels) -> float:
    """Deviation of the loads below ``off``, as a share of the stance load: small where swing is known well."""
    in_air = loads[np.isfinite(loads) & (loads < levels.off)]
    return float(np.std(in_air) / max(levels.stance, 1e-9)) if len(in_air) > 10 else float("inf")


def _mixture(values: Array) -> tuple[Array, Array, Array]:
    """Weights, means and deviations of two normal distributions by expectation maximisation, the smaller mean first."""
    low, high = np.percentile(values, [10.0, 80.0])
    means = np.array([low, high])
    scale = max(float(np.std(values)), 1e-9)
    deviations, weights = np.array([scale, scale]) / 2.0, np.array([0.5, 0.5])
    for _ in range(_STEPS):
        exponent = -0.5 * ((values[:, None] - means) / deviations) ** 2
        likelihood = weights * np.exp(exponent) / deviations + 1e-300
        share = likelihood / likelihood.sum(axis=1, keepdims=True)
        counts = share.sum(axis=0) + 1e-9
        moved = (share * values[:, None]).sum(axis=0) / counts
        deviations = np.sqrt((share * (values[:, None] - moved) ** 2).sum(axis=0) / counts)
        deviations = np.maximum(deviations, 1e-3 * scale)
        weights = counts / counts.sum()
        is_settled = np.abs(moved - means).max() < 1e-5 * scale
        means = moved
        if is_settled:
            break
    order = np.argsort(means)
    return weights[order], means[order], deviations[order]


def _rounded(value: float) -> float:
    return float(f"{value:.2g}") if abs(value) < 100.0 else float(f"{value:.3g}")
