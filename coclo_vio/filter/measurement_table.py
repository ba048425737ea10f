# SPDX-License-Identifier: BSD-3-Clause
"""The tables that go into and come out of the compiled measurements: constants, measured values, triples of rows."""

from typing import NamedTuple

import numpy as np

from coclo_vio.filter.measurement_model import NO_LEG
from coclo_vio.geometry.array_types import Array, BoolArray, IntArray

GYROSCOPE, REST_VELOCITY, REST_RATE, LEG_VELOCITY, FOOT_POSITION, GRAVITY = range(6)
"""Kinds of triples."""


class SensingConstants(NamedTuple):
    """What the measurement model knows of the robot and of the noise, as in ``LegConstants``, and of gate and state.

    Attributes:
        gate: limits of the normalised innovation squared of 3 and of 6 rows.
        world_stop: end of the vectors of the world, see ``StateLayout.world``.
    """

    radii_m: Array
    hips_body: Array
    joint_velocity_noise_radps: float
    standstill_velocity_noise_mps: float
    standstill_rate_noise_radps: float
    gate: tuple[float, float]
    world_stop: int


class Sensed(NamedTuple):
    """The measured values of one joint sample.

    Attributes:
        position_body: foot centres, m, body frame, (n, 3).
        velocity_body: of the foot centres relative to the body, m/s, body axes, (n, 3).
        angular_velocity_body: of the foot links relative to the body, rad/s, body axes, (n, 3).
        jacobian: of the feet, (n, 6, J).
        is_used: legs that give rows, (n,).
        foot_velocity_noise_mps: of each foot, one sigma, (n,).
        angular_velocity: gyroscope, rad/s, (3,).
        gyroscope_noise_radps: its sigma; 0 where there is no gyroscope sample.
        is_stationary: whether the robot stands still.
    """

    position_body: Array
    velocity_body: Array
    angular_velocity_body: Array
    jacobian: Array
    is_used: BoolArray
    foot_velocity_noise_mps: Array
    angular_velocity: Array
    gyroscope_noise_radps: float
    is_stationary: bool


class Triples(NamedTuple):
    """A table of measurements, three rows each, in the order of ``measurement_model.blocks``.

    A predicted triple is a linear function of the state given rotation and leg scale, plus ``added``, plus ``scaled``
    times the leg scale.

    Attributes:
        kind: what is measured, (k,).
        leg: by which leg, (k,); ``NO_LEG`` where by none.
        measured: (k, 3).
        noise: lower factors, (k, 3, 3).
        lever: of the gyroscope: the rate as read, which its scale multiplies; of a leg's velocity: from the body origin
            to the contact; of a foot's position: upward direction times load ratio; body frame, (k, 3).
        added: (k, 3).
        scaled: (k, 3).
        takeover_speed: as in ``FootMotion``.
    """

    kind: IntArray
    leg: IntArray
    measured: Array
    noise: Array
    lever: Array
    added: Array
    scaled: Array
    takeover_speed: float


class Measured(NamedTuple):
    """Measurements against what the filter expects of them.

    Attributes:
        table: the M / 3 triples.
        rows: square-root rows of the predicted measurement, (L + extra, M).
        observed: its covariance with the passive errors, (M, p).
        innovation: measured less predicted, (M,).
        rejected: legs whose innovation is larger than its covariance allows, (n,).
    """

    table: Triples
    rows: Array
    observed: Array
    innovation: Array
    rejected: BoolArray


def gravity_table(force_body: Array, sigma: float) -> Triples:
    """The one triple of gravity: ``measurement_model.specific_force_at_rest``.

    Args:
        force_body: as measured, m/s^2, (3,).
        sigma: of each axis, m/s^2.
    """
    nothing, row = np.zeros((1, 3)), np.zeros(1, dtype=np.int64)
    noise = sigma * np.eye(3)[None]
    return Triples(row + GRAVITY, row + NO_LEG, force_body[None], noise, nothing, nothing, nothing, 0.0)
