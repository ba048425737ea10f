# SPDX-License-Identifier: BSD-3-Clause
"""Measurements of the ``robust`` profile, built from blocks of rows. A block without data is left out.

Blocks (paper section III-D): gyroscope; body velocity and rate from each stance leg (the rows of the least squares of
eq. (6), so that the filter weighs them itself and can reject a single leg); relative position of each foot that holds;
zero velocity and rate while the robot stands still. While no foot is in stance (the robot lies, or its contact sensing
fails) every known leg is used with a large noise, which bounds the drift of dead reckoning. Gravity is an update of
its own (``gravity``).
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from coclo_vio.filter.config import RobustConfig
from coclo_vio.filter.ground_plane import UP
from coclo_vio.filter.process_model import leg_scale_offset, slip_velocity
from coclo_vio.filter.stance import FootMotion, Reading
from coclo_vio.filter.state import (
    ACCELEROMETER_BIAS,
    GYROSCOPE_BIAS,
    GYROSCOPE_SCALE,
    LEG_COMPLIANCE,
    LEG_SCALE,
    POSITION,
    RATE,
    VELOCITY,
    State,
)
from coclo_vio.geometry import so3
from coclo_vio.values.arrays import Array, IntArray
from coclo_vio.values.units import GRAVITY_MPS2

NO_LEG = -1


@dataclass(frozen=True, slots=True, eq=False)
class Block:
    """Rows of measurement, three at a time, with their model and noise.

    Attributes:
        measured: (3 k,).
        model: from a stack of states to predicted measurements (points, 3 k).
        noise: lower factors of the noise covariance of each three rows, (k, 3, 3).
        legs: the leg that each three rows come from, (k,); ``NO_LEG`` for rows of no leg.
    """

    measured: Array
    model: Callable[[State], Array]
    noise: Array
    legs: IntArray


def gyroscope(stack: State, reading: Array) -> Array:
    """Rate plus bias plus error of scale, body frame, rad/s, (points, 3).

    The scale multiplies the rate as read, (3,), not as estimated: the difference is of second order, and the model is
    linear.
    """
    vector = stack.vector
    rate: Array = vector[:, RATE] + vector[:, GYROSCOPE_BIAS] + reading * vector[:, GYROSCOPE_SCALE]
    return rate


def specific_force_at_rest(stack: State) -> Array:
    """``R^T g + b_a`` of a body at rest (section III-D), body frame, m/s^2, (points, 3)."""
    up_body = GRAVITY_MPS2 * stack.rotation[:, 2, :]
    force: Array = up_body + stack.vector[:, ACCELEROMETER_BIAS]
    return force


def _rest(stack: State) -> Array:
    return np.concatenate((stack.vector[:, VELOCITY], stack.vector[:, RATE]), axis=1)


def _velocity_of(
    levers: Array, rolling: Array, compliance_velocity: Array, takeover_speed: float
) -> Callable[[State], Array]:
    """Velocities ``R^T v + w x lever`` of body points at contacts, body frame, as legs of nominal length measure them.

    Args:
        levers: from the body origin to each contact, m, body frame, (k, 3).
        rolling: the part of the velocity due to the rotation of the foot link, m/s, body frame, (k, 3): not scaled.
        compliance_velocity: velocity at which each leg is compressed, m/s, body frame, (k, 3), at the mean of the leg
            compliance: a constant here, because the rate of a noisy load is mostly noise, and an estimate from it would
            be biased to zero.
        takeover_speed: as in ``FootMotion``.
    """
    cross = np.concatenate(list(so3.hat(levers)), axis=1)

    def model(stack: State) -> Array:
        count = len(stack.vector)
        velocity = (stack.vector[:, RATE] @ cross).reshape(count, -1, 3)
        velocity += stack.vector[:, None, VELOCITY] @ stack.rotation
        velocity -= slip_velocity(stack, levers, takeover_speed)
        velocity[..., :2] -= stack.vector[:, LEG_SCALE, None] * (velocity - rolling)[..., :2]
        velocity += compliance_velocity
        return np.asarray(velocity.reshape(count, -1))

    return model


def _position_of(
    legs: IntArray, positions_body: Array, hips_body: Array, compliance_axes: Array
) -> Callable[[State], Array]:
    """Positions ``R^T (p - r)`` of foot centres in the body frame, (k, 3), as measured by rigid legs of nominal length.

    Args:
        legs: which, (k,).
        positions_body: feet by the kinematics, m, body frame, (k, 3).
        hips_body: first joint of each leg, m, body frame, (k, 3).
        compliance_axes: upward direction times load ratio of each leg, body frame, (k, 3).
    """

    def model(stack: State) -> Array:
        relative = stack.feet[:, legs] - stack.vector[:, None, POSITION]
        position = relative @ stack.rotation - leg_scale_offset(stack.vector[:, LEG_SCALE], positions_body, hips_body)
        position -= stack.vector[:, LEG_COMPLIANCE, None] * compliance_axes
        return np.asarray(position.reshape(len(position), -1))

    return model


@dataclass(frozen=True, slots=True, eq=False)
class LegConstants:
    """What the measurement model knows of the robot and its parameters; the same at every sample.

    Attributes:
        radii_m: radius of each foot, (n,).
        hips_body: first joint of each leg, body frame, m, (n, 3).
        joint_velocity_noise_radps: one sigma of a joint velocity, rad/s.
        config: parameters.
        takes_slip_for_known: whether legs correct the state as if the common slip were known.
    """

    radii_m: Array
    hips_body: Array
    joint_velocity_noise_radps: float
    config: RobustConfig
    takes_slip_for_known: bool = False


def blocks(
    sensing: LegConstants,
    reading: Reading,
    motion: FootMotion,
    mean: State,
    *,
    foot_noise: Array,
    foot_velocity_noise_mps: Array,
    gyroscope_noise_radps: float,
) -> list[Block]:
    """The measurements of one joint sample.

    Args:
        sensing: the legs and the parameters.
        reading: the measured values.
        motion: how the feet moved.
        mean: the predicted mean, for the direction of gravity and of the ground's normal in the body.
        foot_noise: lower factors of each foot position's covariance, body frame, m, (n, 3, 3).
        foot_velocity_noise_mps: one sigma of the velocity of each foot beside that of its joints, m/s, (n,).
        gyroscope_noise_radps: one sigma of the gyroscope mean, rad/s.
    """
    config = sensing.config
    result: list[Block] = []
    if reading.angular_velocity is not None:
        rate = reading.angular_velocity
        result.append(_imu_block(rate, partial(gyroscope, reading=rate), gyroscope_noise_radps))
    stance = reading.is_stance
    if reading.is_stationary:
        sigmas = (config.standstill_velocity_noise_mps, config.standstill_rate_noise_radps)
        result.append(_imu_block(np.zeros(6), _rest, *sigmas))
    legs = np.flatnonzero(stance if stance.any() else reading.is_known)
    if not len(legs):
        return result
    up_body = mean.rotation.T @ UP
    result.append(_velocity_block(sensing, reading, motion, mean, legs, foot_velocity_noise_mps[legs]))
    held = legs[motion.holds[legs]]
    if len(held):
        centres = reading.feet.position_body[held]
        compliance_axes = motion.load_ratio[held, None] * up_body
        model = _position_of(held, centres, sensing.hips_body[held], compliance_axes)
        result.append(Block(centres.ravel(), model, foot_noise[held], held))
    return result


def _velocity_block(
    sensing: LegConstants, reading: Reading, motion: FootMotion, mean: State, legs: IntArray, sigmas_mps: Array
) -> Block:
    """Velocity of the body over the contact point of each of the ``legs`` (k,), eq. (6), 3 k rows.

    Args:
        sensing: the legs and the parameters.
        reading: the measured values.
        motion: how the feet moved.
        mean: the predicted mean.
        legs: which.
        sigmas_mps: noise of each one's velocity beside that of its joints, m/s, (k,).
    """
    feet = reading.feet
    up_body = mean.rotation.T @ UP
    arms = sensing.radii_m[legs, None] * (motion.normals[legs] @ mean.rotation)
    arms_cross = so3.hat(arms)
    jacobian = feet.jacobian[legs]
    contact_jacobian = jacobian[:, 3:] + arms_cross @ jacobian[:, :3]
    squared = contact_jacobian @ np.swapaxes(contact_jacobian, 1, 2) * sensing.joint_velocity_noise_radps**2
    rolling = -(arms_cross @ feet.angular_velocity_body[legs, :, None])[:, :, 0]
    measured = rolling - feet.velocity_body[legs]
    compliance_velocity = mean.vector[LEG_COMPLIANCE] * motion.load_ratio_rate[legs, None] * up_body
    model = _velocity_of(feet.position_body[legs] - arms, rolling, compliance_velocity, motion.takeover_speed)
    noise = np.asarray(np.linalg.cholesky(squared + sigmas_mps[:, None, None] ** 2 * np.eye(3)))
    return Block(measured.ravel(), model, noise, legs)


def _imu_block(measured: Array, model: Callable[[State], Array], *sigmas: float, owner: int = NO_LEG) -> Block:
    """Rows of no leg; one sigma for each three."""
    noise = np.array(sigmas)[:, None, None] * np.eye(3)
    return Block(measured, model, noise, np.full(len(sigmas), owner))
