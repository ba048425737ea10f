# SPDX-License-Identifier: BSD-3-Clause
"""What standing feet say of the body's motion: two of them keep their distance, and turn with the body only."""

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from coclo_vio.adoption.recorded_legs import RecordedLegs
from coclo_vio.robot.model import RobotModel
from coclo_vio.values.arrays import Array, BoolArray, IntArray
from coclo_vio.values.units import GRAVITY_MPS2, NS_PER_S


@dataclass(frozen=True, slots=True, eq=False)
class FeetMotion:
    """The feet at all joint samples, relative to the body, body axes.

    Attributes:
        position: foot centres, m, (N, legs, 3).
        velocity: m/s, (N, legs, 3).
        angular_velocity: of the foot links, rad/s, (N, legs, 3).
        rotation: ``R_body_foot``, (N, legs, 3, 3).
        radii_m: (legs,).
    """

    position: Array
    velocity: Array
    angular_velocity: Array
    rotation: Array
    radii_m: Array

    def contact_points(self, up_body: Array) -> tuple[Array, Array]:
        """Where the feet touch the ground, m, and the velocity of that material point, m/s, (N, legs, 3) each."""
        below = -self.radii_m[:, None] * up_body
        return self.position + below, self.velocity + np.cross(self.angular_velocity, below)


@dataclass(frozen=True, slots=True, eq=False)
class StandingPairs:
    """Pairs of standing feet, P of them: what the rotation of the body has to explain.

    Attributes:
        sample: index of the joint sample, (P,).
        apart: vector between the contact points, m, body axes, (P, 3).
        velocity: of that vector relative to the body, m/s, body axes, (P, 3): ``-omega x apart``.
    """

    sample: IntArray
    apart: Array
    velocity: Array


def feet_motion(robot: RobotModel, recorded: RecordedLegs) -> FeetMotion:
    """Kinematics of the feet at every joint sample."""
    count, legs = len(recorded.joint_ns), len(robot.leg_names)
    centres, velocities, rates = (np.empty((count, legs, 3)) for _ in range(3))
    rotation = np.empty((count, legs, 3, 3))
    for k, (position, velocity) in enumerate(zip(recorded.position, recorded.velocity, strict=True)):
        feet = robot.feet(position, velocity)
        centres[k], velocities[k], rates[k] = feet.position_body, feet.velocity_body, feet.angular_velocity_body
        rotation[k] = feet.rotation_body_foot
    return FeetMotion(centres, velocities, rates, rotation, robot.foot_radii_m)


def foot_loads(robot: RobotModel, recorded: RecordedLegs, up_body: Array, *, with_inertia: bool) -> Array:
    """Loads along the vertical by joint torques, N, (N, legs); the body is taken as upright and not turning."""
    times_s = (recorded.joint_ns - recorded.joint_ns[0]) / NS_PER_S
    steps = np.diff(times_s, prepend=2 * times_s[0] - times_s[1])[:, None]
    acceleration = np.diff(recorded.velocity, axis=0, prepend=recorded.velocity[:1]) / steps
    loads = np.empty((len(times_s), len(robot.leg_names)))
    still = np.zeros(3)
    for k in range(len(times_s)):
        forces = robot.foot_forces(
            recorded.position[k],
            recorded.velocity[k],
            recorded.effort[k],
            specific_force_body=GRAVITY_MPS2 * up_body,
            angular_velocity_body=still if with_inertia else None,
            acceleration=acceleration[k] if with_inertia else None,
        )
        loads[k] = forces @ up_body
    return loads


def standing_pairs(motion: FeetMotion, is_stance: BoolArray, up_body: Array, most: int = 20_000) -> StandingPairs:
    """All pairs of feet (N, legs) that stand at the same sample, thinned to about ``most``."""
    points, velocities = motion.contact_points(up_body)
    known = is_stance & np.isfinite(velocities).all(axis=2)
    samples, apart, change = [], [], []
    for first, second in combinations(range(known.shape[1]), 2):
        rows = np.flatnonzero(known[:, first] & known[:, second])
        samples.append(rows)
        apart.append(points[rows, first] - points[rows, second])
        change.append(velocities[rows, first] - velocities[rows, second])
    step = max(sum(map(len, samples)) // most, 1)
    return StandingPairs(*(np.concatenate(values)[::step] for values in (samples, apart, change)))


def floor_normal(points: Array) -> tuple[Array, float]:
    """Normal (3,) of the plane through points (n, 3), z up, and how well they span it, 0 (a line) to 1."""
    if len(points) < 3:
        return np.array([0.0, 0.0, 1.0]), 0.0
    centred = points - points.mean(axis=0)
    _, spread, axes = np.linalg.svd(centred, full_matrices=False)
    normal = axes[2] if axes[2][2] >= 0.0 else -axes[2]
    return normal, float((spread[1] - spread[2]) / max(spread[0], 1e-9))
