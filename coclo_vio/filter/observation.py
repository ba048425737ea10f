# SPDX-License-Identifier: BSD-3-Clause
"""Measurements of the ``robust`` profile, built from blocks of rows. A block that has nothing to say is not there.

Blocks (paper section III-D): gyroscope, gravity while all feet stand, body velocity and rate seen by each stance leg
(the rows of the least squares of eq. (6), so that the filter weighs them itself and one leg can be turned down),
relative position of each foot that holds; and rest, while the robot stands still. While no foot carries the body (it
lies, or its contact sensing fails) every foot is asked, and hardly believed: better than coasting.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from coclo_vio.arrays import Array
from coclo_vio.filter.config import RobustConfig
from coclo_vio.filter.process import UP, lengthened
from coclo_vio.filter.stance import FootMotion, Reading
from coclo_vio.filter.state import ACCELEROMETER_BIAS, GYROSCOPE_BIAS, LEG_SCALE, POSITION, RATE, VELOCITY, State
from coclo_vio.geometry import so3
from coclo_vio.robot.description import RobotDescription
from coclo_vio.robot.foot_load import GRAVITY_MPS2

CURVED_COLUMNS = 4  # rotation and leg scale bend these models; all else is linear given them


@dataclass(frozen=True, slots=True, eq=False)
class Block:
    """A few rows of measurement with their model and noise.

    Attributes:
        measured: (m,).
        model: from a stack of states to predicted measurements (points, m).
        noise: lower factor of the noise covariance, (m, m).
        leg: the leg that the rows come from, None for the IMU.
    """

    measured: Array
    model: Callable[[State], Array]
    noise: Array
    leg: int | None = None


def gyroscope(stack: State) -> Array:
    """Rate plus bias, body frame, rad/s, (points, 3)."""
    rate: Array = stack.vector[:, RATE] + stack.vector[:, GYROSCOPE_BIAS]
    return rate


def specific_force_at_rest(stack: State) -> Array:
    """``R^T g + b_a`` of a body at rest (section III-D), body frame, m/s^2, (points, 3)."""
    up_body = GRAVITY_MPS2 * stack.rotation[:, 2, :]
    force: Array = up_body + stack.vector[:, ACCELEROMETER_BIAS]
    return force


def _rest(stack: State) -> Array:
    return np.concatenate((stack.vector[:, VELOCITY], stack.vector[:, RATE]), axis=1)


def _velocity_of(lever: Array, rolling: Array) -> Callable[[State], Array]:
    """Velocity ``R^T v + w x lever`` of the body point at the contact, body frame, as a leg of nominal length sees it.

    Args:
        lever: from the body origin to the contact, m, body frame, (3,).
        rolling: the part of the velocity that the turning foot link makes, m/s, body frame, (3,): not scaled.
    """
    cross = so3.hat(lever)

    def model(stack: State) -> Array:
        body = (stack.vector[:, None, VELOCITY] @ stack.rotation)[:, 0]
        velocity = body + stack.vector[:, RATE] @ cross
        velocity[:, :2] -= stack.vector[:, LEG_SCALE] * (velocity - rolling)[:, :2]
        return np.asarray(velocity)

    return model


def _position_of(leg: int, position_body: Array, hip_body: Array) -> Callable[[State], Array]:
    """Position ``R^T (p - r)`` of a foot centre in the body frame, as a leg of nominal length sees it."""

    def model(stack: State) -> Array:
        relative = stack.feet[:, leg] - stack.vector[:, POSITION]
        added = lengthened(stack.vector[:, LEG_SCALE], position_body[None], hip_body[None])
        position: Array = (relative[:, None] @ stack.rotation - added)[:, 0]
        return position

    return model


def blocks(
    reading: Reading,
    motion: FootMotion,
    mean: State,
    *,
    radii_m: Array,
    hips_body: Array,
    foot_noise: Array,
    robot: RobotDescription,
    config: RobustConfig,
    gyroscope_noise_radps: float,
) -> list[Block]:
    """The measurements of one joint sample.

    Args:
        reading: what the sensors say.
        motion: how the feet moved.
        mean: the predicted mean, for the direction of the ground under a rolling foot.
        radii_m: radius of each foot, (n,).
        hips_body: where each leg begins, body frame, m, (n, 3).
        foot_noise: lower factors of each foot position's covariance, body frame, m, (n, 3, 3).
        robot: noise of its sensors.
        config: parameters.
        gyroscope_noise_radps: one sigma of the gyroscope mean, rad/s.
    """
    identity = np.eye(3)
    result: list[Block] = []
    if reading.angular_velocity is not None:
        result.append(Block(reading.angular_velocity, gyroscope, gyroscope_noise_radps * identity))
    stance = reading.is_stance
    if reading.specific_force is not None and stance.all():
        result.append(Block(reading.specific_force, specific_force_at_rest, config.gravity_noise_mps2 * identity))
    if reading.is_stationary:
        sigma = np.repeat((config.standstill_velocity_noise_mps, config.standstill_rate_noise_radps), 3)
        result.append(Block(np.zeros(6), _rest, np.diag(sigma)))
    up_body = mean.rotation.T @ UP
    feet = reading.feet
    contact_jacobian = feet.jacobian[:, 3:] + so3.hat(radii_m[:, None] * up_body) @ feet.jacobian[:, :3]
    squared = contact_jacobian @ np.swapaxes(contact_jacobian, 1, 2) * robot.joint_velocity_noise_radps**2
    slip = config.foot_velocity_noise_mps if stance.any() else config.no_contact_velocity_noise_mps
    for leg in np.flatnonzero(stance if stance.any() else reading.is_known):
        contact_arm = radii_m[leg] * up_body
        rolling = np.cross(feet.angular_velocity_body[leg], contact_arm)
        measured = rolling - feet.velocity_body[leg]
        noise = np.linalg.cholesky(squared[leg] + slip**2 * identity)
        lever = feet.position_body[leg] - contact_arm
        result.append(Block(measured, _velocity_of(lever, rolling), noise, int(leg)))
        if motion.holds[leg]:
            centre = feet.position_body[leg]
            model = _position_of(int(leg), centre, hips_body[leg])
            result.append(Block(centre, model, foot_noise[leg], int(leg)))
    return result
