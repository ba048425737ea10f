# SPDX-License-Identifier: BSD-3-Clause
"""Noise of standing feet: a foot whose velocity departs from the body's weighs less.

In a trot a foot stands for 0.2 s and is at rest for hardly half of it: it deflects and rebounds after touch-down, and
slides, rolls off and extends before it lifts off. These errors last for tens of milliseconds, all standing feet make
them together, and the accelerometer, which drives the velocity over so short a time, does not. So the noise of a foot
grows with how far its velocity is from the predicted one, as under a Cauchy distribution: what departs by ``d`` times
its sigma has ``sqrt(1 + d^2)`` times the noise. It is a weight and not a gate: a filter that is itself wrong still
follows its feet, slowly at first.

A foot that creeps by a random walk moves at a white velocity; the rows of velocity and of position share that one
density, whatever the rate of the samples.
"""

from typing import NamedTuple

import numpy as np

from coclo_vio.filter.config import RobustConfig
from coclo_vio.filter.square_root_filter import SquareRootFilter
from coclo_vio.filter.stance import FootMotion, Reading
from coclo_vio.filter.state import RATE, VELOCITY
from coclo_vio.filter.state_blocks import FEW_LEGS
from coclo_vio.values.arrays import Array, BoolArray

_AVERAGING_S = 0.005  # of a foot's departure, against the noise of joint velocities


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
        stands, feet, mean = reading.is_stance & reading.is_known, reading.feet, core.mean
        arms = self._radii_m[:, None] * (motion.normals @ mean.rotation)
        at_contact = mean.vector[VELOCITY] @ mean.rotation + np.cross(mean.vector[RATE], feet.position_body - arms)
        by_joints = -np.cross(arms, feet.angular_velocity_body) - feet.velocity_body
        departure = np.where(stands[:, None], by_joints - at_contact, 0.0)
        share = np.where(stands & self._stood, dt_s / (dt_s + _AVERAGING_S), 1.0)
        self._departure = self._departure + share[:, None] * (departure - self._departure)
        self._stood = stands
        variance = self._config.foot_departure_mps**2 + float(core.variance(VELOCITY).mean())
        return np.asarray(np.sqrt(1.0 + np.square(self._departure).sum(axis=1) / variance))
