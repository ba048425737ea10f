# SPDX-License-Identifier: BSD-3-Clause
"""The controller that walks the robot: a wave gait whose swings end by contact force.

It stands for the robot's own controller and its operator with the joystick: it is given the true pose of the body, and
detects contact from the measured torques, with the described robot's kinematics, not with the true ones.
"""

from dataclasses import dataclass, field
from typing import Annotated

import numpy as np
from pydantic import Field

from coclo_vio.geometry import se3, so3
from coclo_vio.robot.model import RobotModel
from coclo_vio.simulation.trial.planned_path import PlannedPath
from coclo_vio.simulation.trial.swing_trajectory import SwingTrajectory
from coclo_vio.simulation.trial.terrain import Terrain
from coclo_vio.values.arrays import Array
from coclo_vio.values.config import StageConfig
from coclo_vio.values.measurements import JointSample
from coclo_vio.values.units import GRAVITY_MPS2

_UP = np.array([0.0, 0.0, 1.0])
_BOUNCE_RADPS = 16.0  # of the body on the springs of its legs
_GYRATION_M = 0.35  # mean distance of the feet's forces from the body's origin
_BEHIND_M = 0.2  # feet further behind the body's origin belong to rear legs
_MAX_FOOT_ERROR_M = 0.06  # largest distance between a commanded foot and the measured one


class WaveGaitConfig(StageConfig):
    """The wave gait. One leg swings at a time, from the rear forward, left side then right side."""

    period_s: Annotated[float, Field(gt=0.5, le=20, description="of a whole cycle, s")] = 3.0
    speed_mps: Annotated[float, Field(gt=0, le=0.5, description="along straight stretches, m/s")] = 0.10
    turn_rate_radps: Annotated[float, Field(gt=0, le=1, description="turning on the spot, rad/s")] = 0.15
    swing_share: Annotated[float, Field(gt=0.2, lt=1, description="planned share of a leg's slot in swing")] = 0.75
    height_m: Annotated[float, Field(gt=0.1, le=0.4, description="of the body's origin over the ground, m")] = 0.20
    reach_m: Annotated[float, Field(gt=0.2, le=0.6, description="of a foot from its leg's base, m")] = 0.40
    rear_reach_m: Annotated[
        float | None, Field(gt=0.2, le=0.6, description="the same of rear legs, m; null: as the others")
    ] = None
    clearance_m: Annotated[float, Field(gt=0, le=0.2, description="of a swing foot over the highest ground, m")] = 0.06
    touch_speed_mps: Annotated[float, Field(gt=0, le=0.6, description="of the foot at touch-down, m/s")] = 0.5
    vertical_speed_mps: Annotated[float, Field(gt=0, le=1, description="largest, of a swing foot, m/s")] = 0.6
    touch_force_n: Annotated[float, Field(gt=0, le=60, description="contact force that ends a swing, N")] = 18.0
    edge_distance_m: Annotated[float, Field(ge=0, le=0.2, description="of footholds beyond a riser, m")] = 0.07
    wall_distance_m: Annotated[
        float, Field(ge=0, le=0.3, description="of a rear leg's footholds before a riser, m")
    ] = 0.20
    foothold_jitter_m: Annotated[float, Field(ge=0, le=0.05, description="standard deviation, each axis, m")] = 0.01
    clearance_jitter_m: Annotated[float, Field(ge=0, le=0.05, description="standard deviation, m")] = 0.008
    timing_jitter: Annotated[float, Field(ge=0, le=0.3, description="of a swing's duration, relative")] = 0.06
    loading_s: Annotated[float, Field(gt=0, le=0.5, description="time to load or unload a foot, s")] = 0.12
    bounce_damping: Annotated[
        float, Field(ge=0, le=2, description="of the body on the joints' springs, by the motors, share of critical")
    ] = 0.5
    easing_s: Annotated[
        float,
        Field(gt=0.02, le=100, description="time constant of the decay of internal forces between legs, s"),
    ] = 0.3
    tracking_per_s: Annotated[float, Field(gt=0, le=10, description="gain from pose error to body velocity, 1/s")] = 1.5


def planned_path(terrain: Terrain, gait: WaveGaitConfig) -> PlannedPath:
    """The terrain's path at the speeds and the body height of a gait."""
    return PlannedPath(terrain, gait.speed_mps, gait.turn_rate_radps, gait.height_m)


@dataclass(frozen=True, slots=True, eq=False)
class Command:
    """Set points of the motors.

    Attributes:
        position: of the motors, on their side of the springs, rad, (joints,).
        velocity: rad/s, (joints,).
    """

    position: Array
    velocity: Array


@dataclass(slots=True)
class _LegState:
    """Phase of a leg in its cycle."""

    swing: SwingTrajectory | None = None
    lifted_s: float = 0.0
    touched_s: float = -1.0
    loaded_periods: int = 0
    slot: int = -1


@dataclass(slots=True)
class GaitController:
    """Walks ``robot`` along ``path``; one call of ``step`` a control period.

    Attributes:
        robot: the described robot.
        terrain: the ground, known exactly.
        gait: the gait.
        spring: stiffness of the joints' springs, Nm/rad, (joints,).
        generator: of the jitter.
        path: the planned path of the body.
        path_time_s: how much of the path's time has passed, s.
        start_s: until then the robot stands.
    """

    robot: RobotModel
    terrain: Terrain
    gait: WaveGaitConfig
    spring: Array
    generator: np.random.Generator
    start_s: float
    path_time_s: float = 0.0
    path: PlannedPath = field(init=False)
    _neutral: Array = field(init=False)
    _feet: Array = field(init=False)
    _joints: Array = field(init=False)
    _motor: Array | None = field(init=False, default=None)
    _previous: Array | None = field(init=False, default=None)
    _legs: list[_LegState] = field(init=False)
    _order: list[int] = field(init=False)
    _limit: Array = field(init=False)

    def __post_init__(self) -> None:
        gait = self.gait
        self.path = planned_path(self.terrain, gait)
        hips = self.robot.hip_position_body
        outward = hips * [1.0, 1.0, 0.0]
        outward = outward / np.linalg.norm(outward, axis=1, keepdims=True)
        reach = np.where(hips[:, 0] < -_BEHIND_M / 2.0, gait.rear_reach_m or gait.reach_m, gait.reach_m)
        self._neutral = hips + reach[:, None] * outward
        self._neutral[:, 2] = self.robot.foot_radii_m - gait.height_m
        self._feet = self._neutral.copy()
        self._joints = np.zeros(len(self.robot.joint_names))
        for _ in range(30):
            self._solve_joints()
        legs = len(hips)
        self._legs = [_LegState() for _ in range(legs)]
        self._order = sorted(range(legs), key=lambda leg: (hips[leg, 1] <= 0.0, hips[leg, 0]))
        self._limit = self.robot.velocity_limits

    @property
    def standing_joints(self) -> Array:
        """Joint angles of the first stance, rad, (joints,)."""
        return self._joints.copy()

    @property
    def is_done(self) -> bool:
        """Whether the path is walked and every foot is in stance."""
        return self.path_time_s >= self.path.duration_s and not any(leg.swing for leg in self._legs)

    def step(self, time_s: float, dt_s: float, T_world_body: Array, joints: JointSample) -> Command:
        """One control period.

        Args:
            time_s: since the beginning of the trial.
            dt_s: length of the period.
            T_world_body: where the body is, (4, 4).
            joints: what the joints measure.
        """
        up_body = T_world_body[:3, :3].T @ _UP
        weight = GRAVITY_MPS2 * up_body
        if time_s >= self.start_s:
            forces = self.robot.foot_forces(joints.position, joints.velocity, joints.effort, specific_force_body=weight)
            self._advance(time_s, dt_s, T_world_body, forces @ up_body)
        error_body = self._feet - self.robot.feet(joints.position, joints.velocity).position_body
        self._move_stance_feet(dt_s, T_world_body, error_body)
        self._move_swing_feet(time_s, dt_s, T_world_body, error_body)
        self._solve_joints()
        force = self._shared_weight(time_s, dt_s, T_world_body)
        torque = self.robot.holding_torques(self._joints, force, weight)
        return self._command(self._joints + torque / self.spring, dt_s)

    def _advance(self, time_s: float, dt_s: float, T_world_body: Array, loads: Array) -> None:
        """Advance on the path unless a swing is late; start the next leg's swing, end those with contact."""
        slot_s = self.gait.period_s / len(self._legs)
        late = [leg for leg in self._legs if leg.swing and time_s - leg.lifted_s > slot_s - self.gait.loading_s]
        if not late and self.path_time_s < self.path.duration_s:
            self.path_time_s += dt_s
        slot = int(self.path_time_s / slot_s)
        swing_leg = self._order[slot % len(self._legs)]
        leg = self._legs[swing_leg]
        may_lift = not late and self.path_time_s < self.path.duration_s and leg.slot != slot and leg.swing is None
        if may_lift and self.path_time_s - slot * slot_s < 0.5 * slot_s:
            leg.slot = slot
            self._lift(swing_leg, time_s, T_world_body)
        for each, load in zip(self._legs, loads, strict=True):
            if each.swing is not None and each.swing.is_descending(time_s - each.lifted_s):
                each.loaded_periods = each.loaded_periods + 1 if load > self.gait.touch_force_n else 0
                if each.loaded_periods >= 2:
                    each.swing, each.touched_s, each.loaded_periods = None, time_s, 0

    def _lift(self, leg: int, time_s: float, T_world_body: Array) -> None:
        gait, slot_s = self.gait, self.gait.period_s / len(self._legs)
        duration = gait.swing_share * slot_s * (1.0 + gait.timing_jitter * self._jitter())
        stance_s = gait.period_s - duration
        pose = self.path.pose_at(self.path_time_s + duration + 0.5 * stance_s)
        goal = se3.apply(pose, self._neutral[leg])
        goal[:2] += gait.foothold_jitter_m * np.array([self._jitter(), self._jitter()])
        goal[0] = self._away_from_edges(goal[0], leans=self._neutral[leg, 0] < -_BEHIND_M)
        radius = self.robot.foot_radii_m[leg]
        goal[2] = self.terrain.height(goal[0]) + radius
        start = se3.apply(T_world_body, self._feet[leg])
        clearance = gait.clearance_m + gait.clearance_jitter_m * self._jitter()
        top_m = max(self.terrain.max_height(start[0], goal[0]) + radius, start[2]) + clearance
        speeds = gait.touch_speed_mps, gait.vertical_speed_mps
        self._legs[leg].swing = SwingTrajectory(start, goal, top_m, duration, *speeds)
        self._legs[leg].lifted_s = time_s

    def _away_from_edges(self, x: float, *, leans: bool) -> float:
        """The foothold nearest to ``x`` with clearance to the risers; rear lower links lean towards the next riser."""
        beyond = self.gait.edge_distance_m
        before = self.gait.wall_distance_m if leans else beyond
        for riser in self.terrain.risers_m:
            if -before < x - riser < beyond:
                return riser + (beyond if x - riser > 0.5 * (beyond - before) else -before)
        return x

    def _move_stance_feet(self, dt_s: float, T_world_body: Array, error_body: Array) -> None:
        """Stance feet move in the body frame opposite to the commanded twist, near the measured feet."""
        target, ahead = self.path.pose_at(self.path_time_s), self.path.pose_at(self.path_time_s + 0.1)
        is_walking = 0.0 < self.path_time_s < self.path.duration_s
        planned = se3.log(se3.inverse(target) @ ahead) / 0.1 if is_walking else np.zeros(6)
        error = se3.log(se3.inverse(T_world_body) @ target)
        twist = planned + self.gait.tracking_per_s * np.clip(error, -0.05, 0.05)
        stance = np.array([leg.swing is None for leg in self._legs])
        moved = self._feet - dt_s * (twist[3:] + np.cross(twist[:3], self._feet))
        moved -= error_body - np.clip(error_body, -_MAX_FOOT_ERROR_M, _MAX_FOOT_ERROR_M)
        self._feet[stance] = moved[stance] - dt_s / self.gait.easing_s * _strain(self._feet[stance], error_body[stance])

    def _move_swing_feet(self, time_s: float, dt_s: float, T_world_body: Array, error_body: Array) -> None:
        """Feet in the air follow their swing, which waits while a foot lags behind its command."""
        for index, leg in enumerate(self._legs):
            if leg.swing is not None:
                if np.linalg.norm(error_body[index]) > _MAX_FOOT_ERROR_M:
                    leg.lifted_s += dt_s
                self._feet[index] = se3.apply(se3.inverse(T_world_body), leg.swing.position(time_s - leg.lifted_s))

    def _solve_joints(self) -> None:
        """A Newton step of the inverse kinematics, from the last angles."""
        feet = self.robot.feet(self._joints, np.zeros_like(self._joints))
        error = self._feet - feet.position_body
        for leg, joints in enumerate(self.robot.leg_joint_slices):
            jacobian = feet.jacobian[leg, 3:, joints]
            damped = jacobian @ jacobian.T + 1e-5 * np.eye(3)
            self._joints[joints] += np.clip(jacobian.T @ np.linalg.solve(damped, error[leg]), -0.2, 0.2)

    def _shared_weight(self, time_s: float, dt_s: float, T_world_body: Array) -> Array:
        """Vertical forces on the stance feet, the least-squares distribution, N, body frame, (legs, 3).

        They carry the robot, and damp its bouncing and rocking on the springs.
        """
        up_body = T_world_body[:3, :3].T @ _UP
        previous, self._previous = T_world_body if self._previous is None else self._previous, T_world_body
        twist = se3.log(se3.inverse(previous) @ T_world_body) / dt_s
        share = np.array([self._share(index, leg, time_s) for index, leg in enumerate(self._legs)])
        mass = self.robot.mass_kg
        damping = 2.0 * self.gait.bounce_damping * mass * _BOUNCE_RADPS
        lift = mass * GRAVITY_MPS2 - damping * float(up_body @ twist[3:])
        level = so3.hat(up_body)  # moments about the trunk's origin, in its axes
        moment = mass * GRAVITY_MPS2 * level @ self.robot.centre_of_mass_body(self._joints)
        moment += _GYRATION_M**2 * damping * (twist[:3] - up_body * (up_body @ twist[:3]))
        rows = np.vstack((np.ones(len(share)), level @ self._feet.T))
        weighted = rows * share
        wrench = np.concatenate(([lift], moment))
        forces = weighted.T @ np.linalg.lstsq(weighted @ rows.T + 1e-9 * np.eye(4), wrench, rcond=1e-6)[0]
        return np.asarray(np.clip(forces, 0.0, mass * GRAVITY_MPS2)[:, None] * up_body)

    def _share(self, index: int, leg: _LegState, time_s: float) -> float:
        """Load factor of a leg, 0 to 1: 0 in swing, ramped after touch-down and before lift-off."""
        if leg.swing is not None:
            return 0.0
        loading = self.gait.loading_s
        landed = 1.0 if leg.touched_s < 0.0 else min((time_s - leg.touched_s) / loading, 1.0)
        slot_s = self.gait.period_s / len(self._legs)
        rank = self._order.index(index)
        to_lift = (rank - self.path_time_s / slot_s) % len(self._legs) * slot_s
        is_next = 0.0 < self.path_time_s < self.path.duration_s and to_lift < loading
        return max(min(landed, to_lift / loading if is_next else 1.0), 0.02)

    def _command(self, motor: Array, dt_s: float) -> Command:
        """Motor angles within the motors' velocity limits."""
        if self._motor is None:
            self._motor = motor
        step = np.clip(motor - self._motor, -self._limit * dt_s, self._limit * dt_s)
        self._motor = self._motor + step
        return Command(self._motor, step / dt_s)

    def _jitter(self) -> float:
        return float(np.clip(self.generator.standard_normal(), -2.5, 2.5))


def _strain(feet: Array, error_body: Array) -> Array:
    """Internal strain: the part of the feet's errors (n, 3), m, that no rigid motion of the body explains."""
    if len(feet) < 3:
        return np.zeros_like(feet)
    by_turning = -so3.hat(feet)
    motions = np.concatenate((np.tile(np.eye(3), (len(feet), 1)), by_turning.reshape(-1, 3)), axis=1)
    explained = motions @ np.linalg.lstsq(motions, error_body.ravel(), rcond=None)[0]
    return np.asarray(error_body - explained.reshape(-1, 3))
