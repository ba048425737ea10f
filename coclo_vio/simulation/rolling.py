# SPDX-License-Identifier: BSD-3-Clause
"""The legs of an analytic trial: stance feet are spheres that roll without slipping, swing feet follow a curve.

A stance foot of radius r on flat ground with normal e_z moves its centre with ``c_dot = omega_foot x (r e_z)``.
With ``c_dot = v + omega x p + J_lin q_dot`` and ``omega_foot = omega + J_ang q_dot`` (body axes, n = R^T e_z) this is
linear in the joint velocities: ``(J_lin + r hat(n) J_ang) q_dot = omega x (r n) - v - omega x p``. A swing foot takes
the velocity of its curve, ``J_lin q_dot = R^T c_dot - v - omega x p``. The joints solve this equation over time.
"""

from dataclasses import dataclass

import numpy as np

from coclo_vio.geometry import so3
from coclo_vio.robot.model import RobotModel
from coclo_vio.simulation.body_motion import BodyMotion, BodyStates
from coclo_vio.simulation.gait import Swing, SwingCurve
from coclo_vio.values.arrays import Array
from coclo_vio.values.errors import RobotModelError

_REACH_TOLERANCE_M = 1e-12
_FOLLOW_TOLERANCE_M = 1e-6
_REACH_STEPS = 50
_LONGEST_REACH_STEP_RAD = 0.3


@dataclass(frozen=True, slots=True, eq=False)
class LegPath:
    """Joints and feet at the samples of a trial.

    Attributes:
        position: rad, (N, J).
        velocity: rad/s, (N, J); at lift-off and touchdown both laws agree.
        feet_world: foot centres, m, world, (N, legs, 3).
    """

    position: Array
    velocity: Array
    feet_world: Array


@dataclass(frozen=True, slots=True, eq=False)
class FootPlan:
    """Where feet touch down, and how high they swing.

    Attributes:
        nominal_xy: foot centres under the body at mid-stance, m, body frame, (legs, 2).
        stance_s: time a foot stands after touchdown, s.
        lift_m: height of a step, m.
        jitter_xy: added to the foothold of each swing, m, world, (swings, 2).
    """

    nominal_xy: Array
    stance_s: float
    lift_m: float
    jitter_xy: Array


class RollingLegs:
    """Moves the joints of a robot so that its feet roll or swing under a given motion of the body.

    Raises:
        RobotModelError: a leg has fewer than three joints, so that its foot cannot follow a path in space.
    """

    def __init__(self, robot: RobotModel, motion: BodyMotion) -> None:
        short = [leg.name for leg in robot.description.legs if len(leg.joints) < 3]
        if short:
            raise RobotModelError(
                f"legs {', '.join(short)} of {robot.description.name!r} have fewer than three joints: their feet "
                "cannot roll while the body moves freely; take a robot with three or more joints a leg"
            )
        self._robot, self._motion = robot, motion
        self._is_square = len(robot.joint_names) == 3 * len(robot.leg_names)
        self._no_velocity = np.zeros(len(robot.joint_names))
        self._curves: list[SwingCurve | None] = [None] * len(robot.leg_names)

    def walk(self, time_s: Array, start: Array, swings: list[Swing], plan: FootPlan, substeps: int) -> LegPath:
        """Joints and feet over the samples ``time_s`` (N,), from joint positions ``start`` (J,).

        Classical Runge-Kutta with ``substeps`` steps between samples; swing feet are then set onto their curve by one
        Newton step.

        Raises:
            RobotModelError: a leg does not reach its foothold, or leaves its path.
        """
        bodies = self._motion.at(time_s)
        starting: dict[int, list[int]] = {}
        for number, swing in enumerate(swings):
            starting.setdefault(swing.start, []).append(number)
        position = start.copy()
        positions, velocities, feet = [], [], []
        for sample in range(len(time_s)):
            now_s, body = float(time_s[sample]), _row(bodies, sample)
            positions.append(position)
            velocities.append(self._rates(position, body, now_s))
            centres = self._robot.feet(position, self._no_velocity).position_body
            feet.append(body.position[0] + centres @ body.rotation[0].T)
            self._check_followed(feet[-1], now_s)
            if sample + 1 == len(time_s):
                break
            self._curves = [None if curve is None or curve.end_s <= now_s else curve for curve in self._curves]
            lift_offs = [(swings[number], plan.jitter_xy[number]) for number in starting.get(sample, [])]
            for swing, jitter_xy in lift_offs:
                ends_s = (now_s, float(time_s[swing.end]))
                foothold = self._foothold(swing.leg, ends_s[1], plan, jitter_xy)
                self._curves[swing.leg] = self._curve(swing.leg, ends_s, position, foothold, plan.lift_m)
            position = self._advance(position, now_s, float(time_s[sample + 1]), substeps)
            position = self._on_curve(position, _row(bodies, sample + 1), float(time_s[sample + 1]))
        return LegPath(np.array(positions), np.array(velocities), np.array(feet))

    def stand(self, posture: Array, targets_world: Array, body: BodyStates) -> Array:
        """Inverse kinematics: joints (J,) near ``posture`` with the foot centres at ``targets_world`` (legs, 3), m.

        Raises:
            RobotModelError: a leg does not reach its target.
        """
        position = posture.copy()
        for _ in range(_REACH_STEPS):
            feet = self._robot.feet(position, self._no_velocity)
            error = (targets_world - body.position[0]) @ body.rotation[0] - feet.position_body
            if float(np.abs(error).max()) < _REACH_TOLERANCE_M:
                return position
            step = self._solve(feet.jacobian[:, 3:], error)
            position = position + step * min(1.0, _LONGEST_REACH_STEP_RAD / float(np.abs(step).max()))
        leg = int(np.abs(error).max(axis=1).argmax())
        raise RobotModelError(
            f"leg {self._robot.leg_names[leg]!r} misses its foothold by {np.linalg.norm(error[leg]):.3g} m: the step "
            "is too long for the leg; lower speed_mps or cycle_s, or set standing_rad to a stand with bent legs"
        )

    def _rates(self, position: Array, body: BodyStates, time_s: float) -> Array:
        """Joint velocities (J,) under which stance feet roll and swing feet follow their curves."""
        feet = self._robot.feet(position, self._no_velocity)
        rotation, rate = body.rotation[0], body.angular_velocity[0]
        velocity = rotation.T @ body.velocity[0]
        lever = self._robot.foot_radii_m[:, None] * rotation[2]  # r n in body axes, (legs, 3)
        matrix = feet.jacobian[:, 3:] + so3.hat(lever) @ feet.jacobian[:, :3]
        rates = (lever - feet.position_body) @ so3.hat(rate).T - velocity
        for leg, curve in enumerate(self._curves):
            if curve is not None:
                matrix[leg] = feet.jacobian[leg, 3:]
                rates[leg] += curve.at(time_s)[1] @ rotation - so3.hat(rate) @ lever[leg]
        return self._solve(matrix, rates)

    def _solve(self, matrix: Array, target: Array) -> Array:
        """``matrix`` (legs, 3, J) ``@ x = target`` (legs, 3), of smallest norm where a leg has joints to spare."""
        rows = matrix.reshape(-1, matrix.shape[-1])
        if self._is_square:
            return np.asarray(np.linalg.solve(rows, target.ravel()), dtype=np.float64)
        return np.asarray(np.linalg.pinv(rows) @ target.ravel(), dtype=np.float64)

    def _advance(self, position: Array, from_s: float, to_s: float, substeps: int) -> Array:
        step = (to_s - from_s) / substeps
        halves: Array = from_s + 0.5 * step * np.arange(2 * substeps + 1, dtype=np.float64)
        bodies = self._motion.at(halves)
        for number in range(substeps):
            start_s, middle_s, end_s = (float(halves[2 * number + i]) for i in range(3))
            start, middle, end = (_row(bodies, 2 * number + i) for i in range(3))
            k1 = self._rates(position, start, start_s)
            k2 = self._rates(position + 0.5 * step * k1, middle, middle_s)
            k3 = self._rates(position + 0.5 * step * k2, middle, middle_s)
            k4 = self._rates(position + step * k3, end, end_s)
            position = position + step / 6.0 * (k1 + 2.0 * (k2 + k3) + k4)
        return position

    def _on_curve(self, position: Array, body: BodyStates, time_s: float) -> Array:
        """``position`` with the swing feet moved onto their curves by one Newton step."""
        feet = self._robot.feet(position, self._no_velocity)
        error = np.zeros((len(self._curves), 3))
        for leg, curve in enumerate(self._curves):
            if curve is not None:
                target = curve.at(time_s)[0]
                error[leg] = (target - body.position[0]) @ body.rotation[0] - feet.position_body[leg]
        return position + self._solve(feet.jacobian[:, 3:], error)

    def _check_followed(self, feet_world: Array, time_s: float) -> None:
        """Stance feet must be on the ground, swing feet on their curves: a leg near its limits is integrated badly."""
        for leg, curve in enumerate(self._curves):
            height = feet_world[leg, 2:] - self._robot.foot_radii_m[leg]
            miss = height if curve is None else feet_world[leg] - curve.at(time_s)[0]
            if float(np.abs(miss).max()) > _FOLLOW_TOLERANCE_M:
                raise RobotModelError(
                    f"leg {self._robot.leg_names[leg]!r} leaves its path by {np.abs(miss).max():.2g} m at {time_s:.3f} "
                    f"s, more than {_FOLLOW_TOLERANCE_M:g} m: it is near its limits; lower speed_mps or cycle_s, "
                    "or raise substeps"
                )

    def _foothold(self, leg: int, touchdown_s: float, plan: FootPlan, jitter_xy: Array) -> Array:
        """Where the foot centre lands, m, world, (3,): under its nominal position in the body at mid-stance."""
        middle = self._body_at(touchdown_s + 0.5 * plan.stance_s)
        heading = so3.about_z(float(so3.yaw(middle.rotation)[0]))
        foothold: Array = middle.position[0] + heading @ np.append(plan.nominal_xy[leg], 0.0)
        foothold[:2] += jitter_xy
        foothold[2] = self._robot.foot_radii_m[leg]
        return foothold

    def _curve(
        self, leg: int, ends_s: tuple[float, float], position: Array, foothold: Array, lift_m: float
    ) -> SwingCurve:
        """A step from where the foot is to its foothold, with the velocity of rolling at both ends."""
        liftoff, touchdown = self._body_at(ends_s[0]), self._body_at(ends_s[1])
        centres = self._robot.feet(position, self._no_velocity).position_body
        targets = touchdown.position[0] + centres @ touchdown.rotation[0].T
        targets[leg] = foothold
        landed = self.stand(position, targets, touchdown)
        return SwingCurve(
            *ends_s,
            start=liftoff.position[0] + liftoff.rotation[0] @ centres[leg],
            end=foothold,
            start_velocity=self._rolling_velocity(leg, position, liftoff, ends_s[0]),
            end_velocity=self._rolling_velocity(leg, landed, touchdown, ends_s[1]),
            lift_m=lift_m,
        )

    def _rolling_velocity(self, leg: int, position: Array, body: BodyStates, time_s: float) -> Array:
        """``omega_foot x (r e_z)`` of a leg that stands, m/s, world, (3,)."""
        feet = self._robot.feet(position, self._rates(position, body, time_s))
        spin = body.rotation[0] @ (body.angular_velocity[0] + feet.angular_velocity_body[leg])
        velocity: Array = np.cross(spin, [0.0, 0.0, float(self._robot.foot_radii_m[leg])])
        return velocity

    def _body_at(self, time_s: float) -> BodyStates:
        return self._motion.at(np.array([time_s]))


def _row(bodies: BodyStates, index: int) -> BodyStates:
    """One of several states, as a stack of one."""
    row = slice(index, index + 1)
    return BodyStates(
        bodies.position[row],
        bodies.velocity[row],
        bodies.acceleration[row],
        bodies.rotation[row],
        bodies.angular_velocity[row],
        bodies.angular_acceleration[row],
    )
