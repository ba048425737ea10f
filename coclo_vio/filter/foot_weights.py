# SPDX-License-Identifier: BSD-3-Clause
"""Noise of standing feet: a foot whose velocity departs from the body's weighs less.

In a trot a foot stands for 0.2 s and is at rest for hardly half of it: it deflects and rebounds after touch-down, and
slides, rolls off and extends before it lifts off. These errors last for tens of milliseconds, all standing feet make
them together, and the accelerometer, which drives the velocity over so short a time, does not. So the noise of a foot
grows with how far its velocity is from the predicted one, as under a Cauchy distribution: what departs by ``d`` times
its sigma has ``sqrt(1 + d^2)`` times the noise. It is a weight and not a gate. Where hardly any foot has agreed for
some steps, the predicted velocity is wrong (an accelerometer that is off), and all feet count in full.

A foot that creeps by a random walk moves at a white velocity; the rows of velocity and of position share that one
density, whatever the rate of the samples.

Source of the weight: Holland, Welsch, "Robust regression using iteratively reweighted least-squares", 1977.
"""

import math
from typing import NamedTuple

import numpy as np

from coclo_vio.filter.config import RobustConfig
from coclo_vio.filter.square_root_filter import SquareRootFilter
from coclo_vio.filter.stance import FootMotion, Reading
from coclo_vio.filter.state import RATE, VELOCITY
from coclo_vio.filter.state_blocks import FEW_LEGS
from coclo_vio.geometry.array_types import Array, BoolArray
from coclo_vio.geometry.compiled import compiled
from coclo_vio.geometry.so3_kernels import cross, rotated_back

_AVERAGING_S = 0.005  # of a foot's departure, against the noise of joint velocities
_AGREES = 9.0  # square of a departure over its variance below which a foot agrees
_AGREEMENT_S = 0.5  # about two steps of a trot
_LEAST_AGREEMENT = 0.1  # on trots more than half of the standing feet agree at any time


class StanceNoise(NamedTuple):
    """Of the feet in stance.

    Attributes:
        creep: density of the random walk of each foot, m/sqrt(s), (n,).
        velocity: one sigma of the velocity of each foot beside that of its joints, m/s, (n,); while no foot stands that
            of any foot.
    """

    creep: Array
    velocity: Array


def unweighed(legs: int, config: RobustConfig, creep_level: float = 1.0) -> StanceNoise:
    """The declared noise of each of so many feet, its creep times a level."""
    ones = np.ones(legs)
    return StanceNoise(creep_level * config.foothold_creep * ones, config.foot_velocity_noise_mps * ones)


class FootWeights:
    """Follows how far the velocity of each standing foot departs from that of the body.

    Attributes:
        is_used: whether feet are weighed.
    """

    def __init__(self, radii_m: Array, config: RobustConfig, *, has_soles: bool) -> None:
        """Take the radius of each foot, m, (n,), the parameters, and whether there are flat feet."""
        legs, asked = len(radii_m), config.weighs_feet
        self._radii_m, self._config = radii_m, config
        self.is_used = legs <= FEW_LEGS and not has_soles if asked is None else asked
        self._departure: Array = np.zeros((legs, 3))
        self._stood: BoolArray = np.zeros(legs, dtype=np.bool_)
        self._agreement = 1.0  # share of standing feet that do not depart

    def noise(
        self, core: SquareRootFilter, reading: Reading, motion: FootMotion, *, dt_s: float, creep_level: float
    ) -> StanceNoise:
        """The noise of the step to a reading.

        Args:
            core: the filter, its velocity moved by the accelerometer.
            reading: the joint sample.
            motion: of the feet, until then.
            dt_s: time since the last joint sample, s.
            creep_level: multiple of ``foothold_creep``.
        """
        config, legs, root_dt = self._config, len(self._radii_m), math.sqrt(dt_s)
        if not reading.stands:
            self._stood[:] = False
            declared = unweighed(legs, config, creep_level)
            return declared._replace(velocity=np.full(legs, config.no_contact_velocity_density / root_dt))
        if not self.is_used:
            return unweighed(legs, config, creep_level)
        creep = creep_level * config.foothold_creep if reading.is_stationary else config.stepping_creep
        mean, feet = core.mean, reading.feet
        agreeing, level = _levels(
            (mean.rotation, mean.vector[VELOCITY], mean.vector[RATE]),
            (
                self._radii_m,
                motion.normals,
                feet.position_body,
                np.ascontiguousarray(feet.velocity_body),
                np.ascontiguousarray(feet.angular_velocity_body),
            ),
            reading.is_stance & reading.is_known,
            self._departure,
            self._stood,
            dt_s / (dt_s + _AVERAGING_S),
            config.foot_departure_mps**2 + core.mean_variance(VELOCITY),
        )
        if agreeing >= 0.0 and not reading.is_stationary:
            self._agreement += dt_s / (dt_s + _AGREEMENT_S) * (agreeing - self._agreement)
        creeps = np.full(legs, creep) if self._agreement < _LEAST_AGREEMENT else creep * level
        return StanceNoise(creeps, np.maximum(config.foot_velocity_noise_mps, creeps / root_dt))


@compiled
def _levels(
    motion: tuple[Array, Array, Array],
    feet: tuple[Array, Array, Array, Array, Array],
    stands: BoolArray,
    departure: Array,
    stood: BoolArray,
    share: float,
    variance: float,
) -> tuple[float, Array]:
    """Follow the departures; the share of standing feet that agree, -1 without one, and multiples of their noise, (n,).

    Args:
        motion: rotation of the body, (3, 3), its velocity, world, and its rate, body axes.
        feet: radii, m, (n,), and each (n, 3): normals of the ground, world; foot centres, m, body frame; their velocity
            relative to the body, m/s, body axes; rate of the foot links relative to the body, rad/s, body axes.
        stands: feet in stance, (n,).
        departure: velocity of the body over each contact by the joints less that by the state, low-passed, m/s, body
            axes, (n, 3), 0 for the others; is updated.
        stood: feet that stood at the last sample, (n,); is updated.
        share: of a departure in the low-passed one.
        variance: of a departure, (m/s)^2.
    """
    rotation, velocity, rate = motion
    radii_m, normals, position_body, velocity_body, angular_velocity_body = feet
    bx, by, bz = rotated_back(rotation, velocity[0], velocity[1], velocity[2])
    level = np.ones(len(stands))
    standing = agreeing = 0
    for leg in range(len(stands)):
        new = np.zeros(3)
        if stands[leg]:
            r, up = radii_m[leg], normals[leg]
            ax, ay, az = rotated_back(rotation, r * up[0], r * up[1], r * up[2])
            p, turn = position_body[leg], angular_velocity_body[leg]
            rx, ry, rz = cross(turn[0], turn[1], turn[2], ax, ay, az)
            wx, wy, wz = cross(rate[0], rate[1], rate[2], p[0] - ax, p[1] - ay, p[2] - az)
            new[0] = rx - velocity_body[leg, 0] - bx - wx
            new[1] = ry - velocity_body[leg, 1] - by - wy
            new[2] = rz - velocity_body[leg, 2] - bz - wz
        kept = share if stands[leg] and stood[leg] else 1.0
        squared = 0.0
        for i in range(3):
            departure[leg, i] += kept * (new[i] - departure[leg, i])
            squared += departure[leg, i] ** 2
        stood[leg] = stands[leg]
        level[leg] = math.sqrt(1.0 + squared / variance)
        standing += int(stands[leg])
        agreeing += int(stands[leg] and squared / variance < _AGREES)
    return (agreeing / standing if standing > 0 else -1.0), level
