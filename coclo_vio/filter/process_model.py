# SPDX-License-Identifier: BSD-3-Clause
"""Prediction of the ``robust`` profile: constant velocity and rate, feet that roll or are carried.

The accelerometer has moved the velocity of the mean before, where it is used (``AccelerationInput``).
Body: white acceleration on velocity and rate, with the exact correlation to position and rotation, so that a rate
measured at both ends of a step integrates as a trapezoid.
Foot in stance: the contact point is at rest, not the centre of the spherical foot, so the centre moves by the foot
link's rotation, ``dp = phi x (radius normal)``. Foot in swing: carried with the body by its own kinematics, which
is the integral of its joint velocities (paper section III-C) without their noise.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from coclo_vio.filter.stance import FootMotion
from coclo_vio.filter.state import (
    LEG_COMPLIANCE,
    LEG_SCALE,
    LOAD_SLIP,
    POSITION,
    RATE,
    ROTATION,
    SLIP,
    SLIP_TURN,
    VELOCITY,
    State,
)
from coclo_vio.geometry import so3
from coclo_vio.values.arrays import Array

UNKNOWN_LEG_NOISE_M = 0.1  # of a foot whose joints are unknown: it is near its last known position
_ACCELERATIONS = 6  # rows of noise of the body: angular and linear acceleration
_HORIZONTAL = np.array([1.0, 1.0, 0.0])


class Interval(NamedTuple):
    """The time from one sample to the next, s, and what changes from one such time to another.

    Attributes:
        dt_s: its length.
        imu_delay_s: delay of the rate behind the rotation.
        acceleration: density of the body's white acceleration, m/s^2/sqrt(Hz).
        foothold_creep: density of the random walk of each foot in stance, m/sqrt(s), (n,).
    """

    dt_s: float
    imu_delay_s: float
    acceleration: float
    foothold_creep: Array


def leg_scale_offset(scale: Array, position_body: Array, hips_body: Array) -> Array:
    """Offset of foot positions (n, 3) by legs longer by a fraction (points, 1): (points, n, 3), m, body frame.

    Only the horizontal part is scaled: bending and rolling shorten the sweep of a leg, not the height of the body.
    """
    leg = (position_body - hips_body) * _HORIZONTAL
    added: Array = scale[:, :, None] * leg
    return added


def slip_velocity(stack: State, position_body: Array, takeover_speed: float) -> Array:
    """Velocity at which standing feet at ``position_body`` (n, 3) slip together, body axes, m/s, (points, n, 3).

    In proportion to the speed of the mean (the stack's first point is its centre), which is a constant here: the slip
    does not correct the speed, and a body at rest has no slip that would be observed. The slip by load is in proportion
    to ``takeover_speed``, m/s, as in ``FootMotion``.
    """
    speed = float(np.linalg.norm(stack.vector[0, VELOCITY]))
    slip = stack.vector[:, None, SLIP] - position_body @ so3.hat(stack.vector[:, SLIP_TURN])
    return np.asarray(speed * slip + takeover_speed * stack.vector[:, None, LOAD_SLIP])


def predict(stack: State, dt_s: float, motion: FootMotion, radii_m: Array, hips_body: Array) -> State:
    """Sigma points one step later.

    Args:
        stack: sigma points of the state.
        dt_s: the step, s.
        motion: of the feet, by the joints.
        radii_m: radius of each foot, (n,); with 0 the foot centre itself is at rest.
        hips_body: first joint of each leg, body frame, m, (n, 3).
    """
    turn = stack.vector[:, RATE] * dt_s
    rotation = stack.rotation @ so3.exp(turn)
    vector = stack.vector * stack.layout.kept(dt_s)
    vector[:, POSITION] += vector[:, VELOCITY] * dt_s
    commutator = -0.5 * np.einsum("nij,pj->pni", so3.hat(motion.turn_body), turn)
    foot_turn = turn[:, None, :] + motion.turn_body + commutator
    foot_turn_world = foot_turn @ np.swapaxes(stack.rotation, -1, -2)
    rolled = stack.feet + radii_m[:, None] * np.cross(foot_turn_world, motion.normals)
    rolled += (
        slip_velocity(stack, motion.position_body, motion.takeover_speed) @ np.swapaxes(stack.rotation, -1, -2) * dt_s
    )
    legs = motion.position_body + leg_scale_offset(vector[:, LEG_SCALE], motion.position_body, hips_body)
    carried = vector[:, None, POSITION] + legs @ np.swapaxes(rotation, -1, -2)
    carried[..., 2] += vector[:, LEG_COMPLIANCE] * motion.load_ratio
    feet = np.where(motion.holds[:, None], rolled, carried)
    vector[:, stack.layout.feet] = feet.reshape(len(vector), -1)
    return replace(stack, rotation=rotation, vector=vector)


def noise_rows(
    mean: State,
    interval: Interval,
    motion: FootMotion,
    *,
    radii_m: Array,
    foot_noise: Array,
    angular_acceleration: float,
) -> Array:
    """Rows ``N``, (6 + walks + 3 n, L), of the process noise ``Q = N^T N`` in the errors of ``State``.

    Rate and velocity change by white accelerations and are linear from one sample to the next: their measurements at
    both ends of a step determine the rotation and the motion in it. A rate that varied between samples (white
    acceleration in continuous time) would add 9e-4 rad to the tilt at each step, many times the noise of a gyroscope.
    Rates that are late by ``d`` lack ``d`` times the change of the rate of the rotation in the step.

    Args:
        mean: the predicted mean.
        interval: the step.
        motion: as in ``predict``.
        radii_m: as in ``predict``.
        foot_noise: lower factors of the covariance of each foot position in the body frame, m, (n, 3, 3).
        angular_acceleration: density of the white angular acceleration, rad/s^2/sqrt(Hz).
    """
    layout = mean.layout
    own_rows = slice(_ACCELERATIONS + len(layout.walking), None)
    rows = np.zeros((own_rows.start + 3 * layout.legs, layout.dimension))
    _set_body_rows(rows, mean, interval, angular_acceleration)
    world_turn, moved = rows[0:3, ROTATION], rows[3:6, POSITION]
    lever = np.where(motion.holds[:, None], radii_m[:, None] * motion.normals, motion.position_body @ mean.rotation.T)
    feet = rows[:, layout.feet].reshape(len(rows), layout.legs, 3)  # a copy: written back below
    feet[0:3] = np.einsum("nij,rj->rni", -so3.hat(lever), world_turn)
    feet[3:6, ~motion.holds] = moved[:, None]
    carried = np.where(motion.is_known[:, None, None], foot_noise, UNKNOWN_LEG_NOISE_M * np.eye(3))
    creep = (interval.foothold_creep * np.sqrt(interval.dt_s))[:, None, None] * np.eye(3)
    own = np.where(motion.holds[:, None, None], creep, np.swapaxes(mean.rotation @ carried, 1, 2))
    each = np.arange(layout.legs)
    feet[own_rows].reshape(layout.legs, 3, layout.legs, 3)[each, :, each] = own
    rows[:, layout.feet] = feet.reshape(len(rows), -1)
    world = mean.vector[layout.world].reshape(-1, 3)
    turned = np.einsum("nij,rj->rni", -so3.hat(world), world_turn)
    rows[0:3, layout.world] -= turned.reshape(3, -1)
    return rows


def _set_body_rows(rows: Array, mean: State, interval: Interval, angular: float) -> None:
    """Write the noise of the body's accelerations, and a row for each error that has a random walk."""
    dt_s, imu_delay_s, linear, _ = interval
    root, identity, layout = np.sqrt(dt_s), np.eye(3), mean.layout
    rows[0:3, ROTATION] = angular * root * (0.5 * dt_s + imu_delay_s) * mean.rotation.T
    rows[0:3, RATE] = angular * root * identity
    rows[3:6, POSITION] = linear * root * 0.5 * dt_s * identity
    rows[3:6, VELOCITY] = linear * root * identity
    walking = layout.walking
    rows[_ACCELERATIONS + np.arange(len(walking)), walking] = layout.walks[walking] * root
