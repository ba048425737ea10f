# SPDX-License-Identifier: BSD-3-Clause
"""The controller that makes a quadruped trot: torques by virtual model control, footholds by Raibert's rule.

It stands for the robot's own controller and its operator: it is given the true state and the heights of the ground.
Standing feet bear the wrench that holds the trunk on its path (Pratt et al., "Virtual model control", 2001), a swing
foot follows its trajectory by the dynamics of its leg, and it lands so that the robot's speed is kept (Raibert, 1986).
"""

from dataclasses import dataclass

import numpy as np

from coclo_vio.geometry import so3
from coclo_vio.simulation.trot.force_distribution import distributed
from coclo_vio.simulation.trot.ground import TrotGround
from coclo_vio.simulation.trot.quadruped_body import QuadrupedBody
from coclo_vio.simulation.trot.reference import Reference, ReferenceTracker
from coclo_vio.simulation.trot.swing import swing_motion
from coclo_vio.simulation.trot.trot_gait import LegState, TrotGait
from coclo_vio.values.arrays import Array, IntArray
from coclo_vio.values.units import GRAVITY_MPS2

_TRUNK_STIFFNESS = np.array([0.0, 0.0, 120.0])  # 1/s^2
_TRUNK_DAMPING = np.array([8.0, 8.0, 18.0])  # 1/s
_TILT_STIFFNESS = np.array([200.0, 200.0, 120.0])  # 1/s^2
_TILT_DAMPING = np.array([22.0, 22.0, 18.0])  # 1/s
_SWING_RADPS = 35.0  # natural frequency of a swing foot about its trajectory
_SPEED_GAIN_S = 0.04  # from an error of speed to the foothold
_USED_FRICTION = 0.55
_LOADING_S = 0.03  # in which a foot takes its load, and gives it away
_TOUCH_SHARE = 0.06  # of the weight: a larger force on a foot is contact
_MAY_TOUCH_FROM = 0.6  # share of a swing
_RETARGET_UNTIL = 0.8  # share of a swing
_JOINT_DAMPING = 0.15  # Nm/(rad/s)
_DAMPED = 0.03**2 * np.eye(3)  # m^2, of the Jacobian of a stretched leg


@dataclass(frozen=True, slots=True, eq=False)
class QuadrupedState:
    """The true state.

    Attributes:
        position: of the trunk's origin, world, m, (3,).
        rotation: ``R_world_body`` (3, 3).
        velocity: world, m/s, (3,).
        rate: angular velocity, world axes, rad/s, (3,).
        centre_of_mass: of the whole robot, world, m, (3,).
        feet: centres of the feet, world, m, (n, 3).
        feet_velocity: m/s, (n, 3).
        jacobian: of the feet to the own joints of their legs, world axes, (n, 3, 3).
        leg_inertia: mass matrix of the joints of each leg, kg m^2, (n, 3, 3).
        bias: torques of gravity and motion, Nm, (n, 3).
        joint_velocity: rad/s, (n, 3).
        load: normal force on each foot, N, (n,).
    """

    position: Array
    rotation: Array
    velocity: Array
    rate: Array
    centre_of_mass: Array
    feet: Array
    feet_velocity: Array
    jacobian: Array
    leg_inertia: Array
    bias: Array
    joint_velocity: Array
    load: Array


class TrotController:
    """Torques of the motors, one call of ``torques`` a control period.

    Args:
        body: of the robot.
        ground: known exactly.
        gait: timing of the legs.
        tracker: of the path.
        start_s: until then the robot stands.
    """

    def __init__(
        self, body: QuadrupedBody, ground: TrotGround, gait: TrotGait, tracker: ReferenceTracker, start_s: float
    ) -> None:
        self.ground = ground
        self.tracker = tracker
        self._body = body
        self._gait = gait
        self.start_s = start_s

    @property
    def is_done(self) -> bool:
        """Whether the path is walked and all feet stand."""
        return self.tracker.is_done and all(leg.phase == "stance" for leg in self._gait.legs)

    @property
    def standing(self) -> IntArray:
        """Which legs are to bear load now."""
        return np.flatnonzero([leg.phase == "stance" for leg in self._gait.legs])

    def torques(self, time_s: float, dt_s: float, state: QuadrupedState) -> Array:
        """One control period: torques (n, 3), Nm."""
        is_walking = time_s >= self.start_s
        reference = self.tracker.step(dt_s, state.position, state.rotation, is_moving=is_walking)
        if is_walking:
            self._gait.advance(dt_s)
            self._switch(time_s, state)
        torque = state.bias - _JOINT_DAMPING * state.joint_velocity
        stance = self.standing
        forces = self._forces(time_s, state, reference, stance)
        for leg, force in zip(stance, forces, strict=True):
            torque[leg] -= state.jacobian[leg].T @ force
        for index, leg in enumerate(self._gait.legs):
            if leg.phase != "stance":
                torque[index] = self._swing_torque(index, leg, time_s, state, reference)
        return torque

    def _switch(self, time_s: float, state: QuadrupedState) -> None:
        """Lift and land feet, by time and by contact."""
        touch_n = _TOUCH_SHARE * self._body.mass_kg * GRAVITY_MPS2
        for index, leg in enumerate(self._gait.legs):
            if leg.phase == "stance":
                if not self.tracker.is_done and self._gait.may_lift(leg):
                    self._gait.lift(leg, state.feet[index], time_s)
                continue
            share = self._gait.swing_share(leg)
            if leg.phase == "swing" and share < 0.0:
                leg.phase = "reach"
            can_touch = leg.phase == "reach" or share > _MAY_TOUCH_FROM
            if can_touch and state.load[index] > touch_n:
                self._gait.land(leg, time_s)

    def _forces(self, time_s: float, state: QuadrupedState, reference: Reference, stance: IntArray) -> Array:
        """The ground's forces on the standing feet that hold the trunk on its path, N, world, (n, 3)."""
        mass, inertia = self._body.mass_kg, self._body.inertia
        error = reference.position - state.position
        push = _TRUNK_STIFFNESS * error + _TRUNK_DAMPING * (reference.velocity - state.velocity)
        push[2] += GRAVITY_MPS2
        R = state.rotation
        tilt = R.T @ so3.log_below_pi(reference.rotation @ R.T)
        turn = R.T @ (reference.rate - state.rate)
        moment = R @ (inertia * (_TILT_STIFFNESS * tilt + _TILT_DAMPING * turn))
        shares = np.array([self._load_share(self._gait.legs[leg], time_s) for leg in stance])
        soles = state.feet[stance] - np.array([0.0, 0.0, self._body.foot_radius_m])
        wrench = np.concatenate((mass * push, moment))
        return distributed(wrench, soles - state.centre_of_mass, shares, _USED_FRICTION)

    def _load_share(self, leg: LegState, time_s: float) -> float:
        if time_s < self.start_s or self.tracker.is_done:
            return 1.0
        landed = (time_s - leg.since_s) / _LOADING_S if leg.since_s >= 0.0 else 1.0
        return max(0.05, min(1.0, landed, self._gait.to_lift_s(leg) / _LOADING_S))

    def _swing_torque(
        self, index: int, leg: LegState, time_s: float, state: QuadrupedState, reference: Reference
    ) -> Array:
        share, swing_s = self._gait.swing_share(leg), (1.0 - leg.duty) * self._gait.period_s
        elapsed_s = share * swing_s if leg.phase == "swing" and share >= 0.0 else time_s - leg.since_s
        if leg.phase == "swing" and share < _RETARGET_UNTIL:
            leg.goal = self._foothold(index, leg, swing_s - elapsed_s, state, reference)
        gait, radius = self.tracker.gait, self._body.foot_radius_m
        clearance = gait.clearance_m + gait.clearance_jitter_m * leg.jitter[2]
        ground_m = self.ground.map.highest_between(leg.start[:2], leg.goal[:2])
        top_m = max(ground_m + radius, leg.start[2]) + clearance
        planned = swing_motion(leg.start, leg.goal, top_m, swing_s, gait.touch_speed_mps, elapsed_s)
        wanted = planned.acceleration + _SWING_RADPS**2 * (planned.position - state.feet[index])
        wanted += 2.0 * _SWING_RADPS * (planned.velocity - state.feet_velocity[index])
        J = state.jacobian[index]
        acceleration = J.T @ np.linalg.solve(J @ J.T + _DAMPED, wanted)
        return np.asarray(state.bias[index] + state.leg_inertia[index] @ acceleration)

    def _foothold(
        self, index: int, leg: LegState, remaining_s: float, state: QuadrupedState, reference: Reference
    ) -> Array:
        """Raibert's foothold: below the hip in the middle of the coming stance, further out if too fast."""
        turn = so3.about_z(reference.rate[2] * remaining_s)
        hip = turn @ state.rotation @ self._body.neutral_feet[index]
        velocity = state.velocity + reference.rate[2] * np.array([-hip[1], hip[0], 0.0])
        place = state.position + state.velocity * remaining_s + hip + 0.5 * self._gait.stance_s * velocity
        place += _SPEED_GAIN_S * (state.velocity - reference.velocity)
        xy = self.ground.map.foothold(place[:2] + self.tracker.gait.foothold_jitter_m * leg.jitter[:2])
        return np.append(xy, self.ground.map.heights(xy[None])[0] + self._body.foot_radius_m)
