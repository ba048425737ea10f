# SPDX-License-Identifier: BSD-3-Clause
"""Compiled step of the kinematic contact estimator; the readable form is ``kinematic_contact.weigh``."""

import math
from typing import NamedTuple

import numpy as np

from coclo_vio.geometry.array_types import Array, BoolArray
from coclo_vio.geometry.compiled import compiled


class FootEvidence(NamedTuple):
    """What one sample states of the feet.

    Attributes:
        velocity: of the body if the foot stands, less the predicted one, m/s, (n, 3).
        variance: of it where the foot stands, m^2/s^2, (n,).
        depth_m: of the foot below the body, less the predicted depth of the ground, m, (n,).
        odds: logarithm of the odds of stance by the load, a sample, (n,).
        is_known: legs with kinematics, (n,).
    """

    velocity: Array
    variance: Array
    depth_m: Array
    odds: Array
    is_known: BoolArray


class Scales(NamedTuple):
    """Numbers of one step.

    Attributes:
        velocity_variance: of the predicted body velocity, m^2/s^2.
        swing_variance: of the velocity of a swing foot in the world, m^2/s^2.
        depth_variance: of the predicted depth of the ground, m^2.
        height_variance: of a standing foot about the ground, m^2.
        clearance_m: mean height of a swing foot; its standard deviation is as large.
        share: of a sample in the evidence of the velocities, as errors last for several samples.
        height_share: the same of the heights.
    """

    velocity_variance: float
    swing_variance: float
    depth_variance: float
    height_variance: float
    clearance_m: float
    share: float
    height_share: float


@compiled
def exchange(chances: Array, rising: Array, falling: float) -> None:
    """Transitions of every foot by itself, in the chances (2^n,) of all sets of standing feet, in place.

    Args:
        chances: of each set; bit i of the index says that foot i stands.
        rising: chance that a swing foot has touched down since the last sample, (n,).
        falling: chance that a standing foot has lifted off.
    """
    for leg in range(len(rising)):
        bit = 1 << leg
        for index in range(len(chances)):
            if index & bit:
                continue
            swings, stands = chances[index], chances[index | bit]
            chances[index] = swings * (1.0 - rising[leg]) + stands * falling
            chances[index | bit] = swings * rising[leg] + stands * (1.0 - falling)


@compiled
def weigh(chances: Array, feet: FootEvidence, scales: Scales) -> Array:
    """``kinematic_contact.weigh``: the chances (2^n,) in place; returns the correction of the body (6,)."""
    weights, largest = np.empty(len(chances)), -math.inf
    for index in range(len(chances)):
        weights[index] = math.log(chances[index] + 1e-12) + _log_likelihood(index, feet, scales)
        largest = max(largest, weights[index])
    total = 0.0
    for index in range(len(chances)):
        chances[index] = math.exp(weights[index] - largest)
        total += chances[index]
    moments, each = np.zeros(9), np.empty(6)  # sums of velocity, variance, its square, depth, variance, its square
    for index in range(len(chances)):
        chances[index] /= total
        _set_correction(each, index, feet, scales)
        for i in range(3):
            moments[i] += chances[index] * each[i]
        moments[3] += chances[index] * each[3]
        moments[4] += chances[index] * (each[0] ** 2 + each[1] ** 2 + each[2] ** 2) / 3.0
        moments[5] += chances[index] * each[4]
        moments[6] += chances[index] * each[5]
        moments[7] += chances[index] * each[4] ** 2
    found = np.empty(6)
    for i in range(3):
        found[i] = moments[i]
    found[3] = moments[3] + moments[4] - (moments[0] ** 2 + moments[1] ** 2 + moments[2] ** 2) / 3.0
    found[4] = moments[5]
    found[5] = moments[6] + moments[7] - moments[5] ** 2
    return found


@compiled
def _log_likelihood(index: int, feet: FootEvidence, scales: Scales) -> float:
    """Of one set of standing feet, with the body's velocity and the depth of the ground integrated out."""
    weight, depth_weight = 1.0 / scales.velocity_variance, 1.0 / scales.depth_variance
    velocity, height = 1.5 * math.log(weight), 0.5 * math.log(depth_weight)
    x, y, z, depth, odds = 0.0, 0.0, 0.0, 0.0, 0.0
    swing = scales.swing_variance + scales.velocity_variance
    for leg in range(len(feet.variance)):
        if not feet.is_known[leg]:
            continue
        stands = (index >> leg) & 1
        square = feet.velocity[leg, 0] ** 2 + feet.velocity[leg, 1] ** 2 + feet.velocity[leg, 2] ** 2
        w = 1.0 / feet.variance[leg] if stands else 1.0 / swing
        velocity += 1.5 * math.log(w) - 0.5 * w * square
        if stands:
            weight += w
            x += w * feet.velocity[leg, 0]
            y += w * feet.velocity[leg, 1]
            z += w * feet.velocity[leg, 2]
            odds += feet.odds[leg]
        error = feet.depth_m[leg] + (0.0 if stands else scales.clearance_m)
        u = 1.0 / (scales.height_variance if stands else scales.clearance_m**2)
        depth_weight += u
        depth += u * error
        height += 0.5 * math.log(u) - 0.5 * u * error**2
    velocity += 0.5 * (x * x + y * y + z * z) / weight - 1.5 * math.log(weight)
    height += 0.5 * depth * depth / depth_weight - 0.5 * math.log(depth_weight)
    return scales.share * velocity + scales.height_share * height + odds


@compiled
def _set_correction(found: Array, index: int, feet: FootEvidence, scales: Scales) -> None:
    """Mean (3,) and variance of the body's velocity, and of the depth, given one set of standing feet, (6,)."""
    weight, depth_weight = 1.0 / scales.velocity_variance, 1.0 / scales.depth_variance
    for i in range(6):
        found[i] = 0.0
    for leg in range(len(feet.variance)):
        if not feet.is_known[leg]:
            continue
        stands = (index >> leg) & 1
        if stands:
            w = scales.share / feet.variance[leg]
            weight += w
            for i in range(3):
                found[i] += w * feet.velocity[leg, i]
        u = scales.height_share / (scales.height_variance if stands else scales.clearance_m**2)
        depth_weight += u
        found[4] += u * (feet.depth_m[leg] + (0.0 if stands else scales.clearance_m))
    for i in range(3):
        found[i] /= weight
    found[3], found[4], found[5] = 1.0 / weight, found[4] / depth_weight, 1.0 / depth_weight
