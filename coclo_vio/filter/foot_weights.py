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
        config, root_dt = self._config, float(np.sqrt(dt_s))
        declared = unweighed(len(self._radii_m), config, creep_level)
        if not reading.is_stance.any():
            self._stood[:] = False
            return declared._replace(velocity=np.full(len(self._radii_m), config.no_contact_velocity_density / root_dt))
        if not self.is_used:
            return declared
        creep = declared.creep if reading.is_stationary else np.full(len(self._radii_m), config.stepping_creep)
        creep = creep * self._level(core, reading, motion, dt_s)
        return StanceNoise(creep, np.maximum(declared.velocity, creep / root_dt))

    def _level(self, core: SquareRootFilter, reading: Reading, motion: FootMotion, dt_s: float) -> Array:
        """Multiple of the noise of each foot, (n,)."""
        feet, mean, stands = reading.feet, core.mean, reading.is_stance & reading.is_known
        departures = _departures(
            (mean.rotation, mean.vector[VELOCITY], mean.vector[RATE]),
            self._radii_m[:, None] * motion.normals,
            feet.position_body,
            np.ascontiguousarray(feet.velocity_body),
            np.ascontiguousarray(feet.angular_velocity_body),
            stands,
        )
        share = np.where(stands & self._stood, dt_s / (dt_s + _AVERAGING_S), 1.0)
        self._departure = self._departure + share[:, None] * (departures - self._departure)
        self._stood = stands
        variance = self._config.foot_departure_mps**2 + float(core.variance(VELOCITY).mean())
        squared = np.square(self._departure).sum(axis=1) / variance
        if stands.any() and not reading.is_stationary:
            agreeing = float((squared[stands] < _AGREES).mean())
            self._agreement += dt_s / (dt_s + _AGREEMENT_S) * (agreeing - self._agreement)
        return np.ones(len(squared)) if self._agreement < _LEAST_AGREEMENT else np.asarray(np.sqrt(1.0 + squared))


@compiled
def _departures(
    motion: tuple[Array, Array, Array],
    arms: Array,
    position_body: Array,
    velocity_body: Array,
    angular_velocity_body: Array,
    stands: BoolArray,
) -> Array:
    """Velocity of the body over each contact by the joints less that by the state, m/s, body axes, (n, 3).

    Args:
        motion: rotation of the body, (3, 3), its velocity, world, and its rate, body axes.
        arms: from each contact to the foot's centre, m, world, (n, 3).
        position_body: foot centres, m, body frame, (n, 3).
        velocity_body: of the foot centres relative to the body, m/s, body axes, (n, 3).
        angular_velocity_body: of the foot links relative to the body, rad/s, body axes, (n, 3).
        stands: feet in stance, (n,); 0 for the others.
    """
    rotation, velocity, rate = motion
    bx, by, bz = rotated_back(rotation, velocity[0], velocity[1], velocity[2])
    departures = np.zeros(arms.shape)
    for leg in range(len(arms)):
        if not stands[leg]:
            continue
        ax, ay, az = rotated_back(rotation, arms[leg, 0], arms[leg, 1], arms[leg, 2])
        p, turn = position_body[leg], angular_velocity_body[leg]
        rx, ry, rz = cross(turn[0], turn[1], turn[2], ax, ay, az)
        wx, wy, wz = cross(rate[0], rate[1], rate[2], p[0] - ax, p[1] - ay, p[2] - az)
        departures[leg, 0] = rx - velocity_body[leg, 0] - bx - wx
        departures[leg, 1] = ry - velocity_body[leg, 1] - by - wy
        departures[leg, 2] = rz - velocity_body[leg, 2] - bz - wz
    return departures
