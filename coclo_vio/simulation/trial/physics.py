# SPDX-License-Identifier: BSD-3-Clause
"""The loop of controller and contact physics: a robot walks its path, recorded at 1 kHz."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Any

import mujoco
import numpy as np
from pydantic import Field

from coclo_vio.geometry import se3, so3
from coclo_vio.robot.model import RobotModel
from coclo_vio.simulation.trial.gait_controller import Command, GaitController
from coclo_vio.simulation.trial.motion import Motion
from coclo_vio.simulation.trial.slippery_ground import SlipperyGround
from coclo_vio.values.arrays import Array
from coclo_vio.values.config import StageConfig
from coclo_vio.values.errors import SimulationError
from coclo_vio.values.measurements import JointSample
from coclo_vio.values.units import NS_PER_S

_TRUNK = 6  # the first six velocities are those of the trunk
_SETTLING_S = 2.0  # settling on its springs, before the trial begins
_CONTROL_EVERY = 5  # steps of the physics, 5 ms
_FALLEN_COSINE = 0.5  # of the trunk's tilt (60 deg)
_FALLEN_HEIGHT_M = 0.09  # a trunk closer to the ground has fallen
_MAX_DURATION_RATIO = 2.5  # of the walk's duration to the planned one


class PushConfig(StageConfig):
    """Random pushes on the trunk."""

    force_n: Annotated[float, Field(ge=0, le=200, description="largest force, N")] = 0.0
    torque_nm: Annotated[float, Field(ge=0, le=50, description="largest torque, Nm")] = 0.0
    every_s: Annotated[float, Field(gt=0, description="mean time between pushes, s")] = 4.0
    duration_s: Annotated[float, Field(gt=0, le=5, description="mean length of a push, s")] = 0.4


@dataclass(slots=True)
class ContactCounts:
    """Counts contacts that a sound gait does not have.

    Attributes:
        feet: geoms of the feet.
        ground: geoms of the ground.
        self_contacts: times at which a leg touched another.
        ground_contacts: times at which a leg, not its foot, touched the ground.
        max_penetration_m: largest penetration of two bodies in contact.
    """

    feet: frozenset[int]
    ground: frozenset[int]
    self_contacts: int = 0
    ground_contacts: int = 0
    max_penetration_m: float = 0.0

    def count(self, data: mujoco.MjData) -> None:
        """Count the contacts of this moment."""
        if data.ncon == 0:
            return
        self.max_penetration_m = max(self.max_penetration_m, -float(data.contact.dist.min()))
        touches_self = touches_ground = False
        for pair in data.contact.geom:
            on_ground = any(geom in self.ground for geom in pair)
            is_foot = any(geom in self.feet for geom in pair)
            touches_self |= not on_ground
            touches_ground |= on_ground and not is_foot
        self.self_contacts += touches_self
        self.ground_contacts += touches_ground


class FootFriction:
    """The friction of each foot, by its position and the time since it landed.

    MuJoCo takes the larger friction of two bodies unless one has priority; so the feet have it, with the ground's.
    """

    def __init__(self, model: mujoco.MjModel, feet: list[int], sensors: Array, ground: SlipperyGround) -> None:
        self._model, self._feet, self._sensors, self._ground = model, feet, sensors, ground
        self._nominal: Array = model.geom_friction[feet, 0].copy()
        self._in_air_s: Array = np.full(len(feet), -np.inf)
        self.on_tile_s: tuple[float, float] | None = None
        model.geom_priority[feet] = 1

    def update(self, data: mujoco.MjData) -> None:
        """Set the friction for the next steps, by the present positions and loads of the feet."""
        places, touches = data.geom_xpos[self._feet], data.sensordata[self._sensors] > 0.0
        self._in_air_s[~touches] = data.time
        self._model.geom_friction[self._feet, 0] = self._ground.friction(
            places, data.time - self._in_air_s, self._nominal
        )
        tile = self._ground.tile
        if tile is not None and (tile.contains(places) & touches).any():
            first_s = data.time if self.on_tile_s is None else self.on_tile_s[0]
            self.on_tile_s = (first_s, data.time)


class Simulator:
    """Simulates a robot in a compiled model.

    Args:
        model: made by ``robot_spec.make_spec``.
        robot: the described robot.
        slippery: areas of low friction, if there are any.
    """

    def __init__(self, model: mujoco.MjModel, robot: RobotModel, slippery: SlipperyGround | None = None) -> None:
        self.model = model
        self._robot = robot
        self._data = mujoco.MjData(model)
        joints = [model.joint(name) for name in robot.joint_names]
        self._q = np.array([joint.qposadr[0] for joint in joints])
        self._v = np.array([joint.dofadr[0] for joint in joints])
        feet = [leg.foot_frame for leg in robot.description.legs]
        self._feet = np.array([model.sensor(f"{foot}_touch").adr[0] for foot in feet])
        ground = [index for index in range(model.ngeom) if model.geom(index).name.startswith("ground")]
        soles = [int(model.geom(foot).id) for foot in feet]
        self._contact_counts = ContactCounts(frozenset(soles), frozenset(ground))
        self._foot_friction = None if slippery is None else FootFriction(model, soles, self._feet, slippery)
        self.spring: Array = model.actuator_gainprm[: len(joints), 0].copy()

    def walk(
        self,
        controller: GaitController,
        end_s: float,
        pushes: PushConfig,
        generator: np.random.Generator,
        *,
        until_s: float | None = None,
        progress: Callable[[float], None] | None = None,
    ) -> Motion:
        """Walk the whole path, stand for ``end_s`` and return the motion.

        Args:
            controller: a new one.
            end_s: how long to stand at the end, s.
            pushes: on the trunk while it walks.
            generator: of the pushes.
            until_s: end of the simulation if the walk is not over before, s.
            progress: called with the simulated time (s) now and then.

        Raises:
            SimulationError: the robot fell, or got stuck.
        """
        self._place(controller)
        data, step_s = self._data, self.model.opt.timestep
        limit_s = controller.start_s + _MAX_DURATION_RATIO * controller.path.duration_s
        log: list[tuple[Array, ...]] = []
        push = Pusher(pushes, generator)
        stop_s, cut_s = None, np.inf if until_s is None else until_s
        while data.time < cut_s and (stop_s is None or data.time < stop_s):
            pose = _pose(data.qpos)
            command = controller.step(data.time, _CONTROL_EVERY * step_s, pose, self._joints())
            self._control(command)
            if self._foot_friction is not None:
                self._foot_friction.update(data)
            data.xfrc_applied[1] = push.at(data.time) if controller.path_time_s > 0.0 and stop_s is None else 0.0
            for _ in range(_CONTROL_EVERY):
                before = (data.qpos.copy(), data.qvel.copy(), self._spring_torque())
                mujoco.mj_step(self.model, data)  # acceleration and forces then belong to the state before the step
                log.append((*before, data.qacc[:_TRUNK].copy(), data.sensordata[self._feet]))
            self._contact_counts.count(data)
            self._check(controller, limit_s)
            if stop_s is None and controller.is_done:
                stop_s = data.time + end_s
            if progress is not None and len(log) % 1000 < _CONTROL_EVERY:
                progress(data.time)
        return motion_of(log, step_s, (self._q, self._v), self._contact_counts, self._foot_friction)

    def _place(self, controller: GaitController) -> None:
        """Put the robot on its feet at the beginning of the path, with motor angles that carry its weight."""
        data = self._data
        mujoco.mj_resetData(self.model, data)
        start = controller.path.pose_at(0.0)
        data.qpos[:3] = start[:3, 3]
        data.qpos[3:7] = so3.to_quat_xyzw(start[:3, :3])[[3, 0, 1, 2]]
        data.qpos[self._q] = controller.standing_joints
        data.act[:] = data.qpos[self._q]  # springs without torque
        step_s = _CONTROL_EVERY * self.model.opt.timestep
        data.act[:] = controller.step(0.0, step_s, start, self._joints()).position
        while data.time < _SETTLING_S:
            self._control(controller.step(0.0, step_s, _pose(data.qpos), self._joints()))
            mujoco.mj_step(self.model, data, _CONTROL_EVERY)
        data.time = 0.0

    def _control(self, command: Command) -> None:
        joints = len(self._q)
        self._data.ctrl[:joints], self._data.ctrl[joints:] = command.position, command.velocity

    def _joints(self) -> JointSample:
        """The joint measurements of the robot's own controller, without noise."""
        data = self._data
        return JointSample(round(data.time * NS_PER_S), data.qpos[self._q], data.qvel[self._v], self._spring_torque())

    def _spring_torque(self) -> Array:
        data = self._data
        return np.asarray(self.spring * (data.act - data.qpos[self._q]))

    def _check(self, controller: GaitController, limit_s: float) -> None:
        data = self._data
        position, tilt_cosine = data.qpos[:3], _pose(data.qpos)[2, 2]
        is_low = position[2] - controller.terrain.height(float(position[0])) < _FALLEN_HEIGHT_M
        if tilt_cosine < _FALLEN_COSINE or is_low or not np.isfinite(position).all():
            raise SimulationError(
                f"the robot fell after {data.time:.1f} s at x = {position[0]:.2f} m, y = {position[1]:.2f} m; "
                "lower trial.gait.speed_mps, or raise trial.gait.period_s or trial.body.friction"
            )
        if data.time > limit_s:
            raise SimulationError(
                f"the robot got stuck: {controller.path_time_s:.1f} of {controller.path.duration_s:.1f} s of its path "
                f"walked after {data.time:.0f} s; a swing foot found no ground: raise trial.gait.period_s"
            )


def motion_of(
    log: list[tuple[Array, ...]],
    step_s: float,
    joints: tuple[Any, Any],
    counts: ContactCounts,
    friction: FootFriction | None,
) -> Motion:
    """The motion that was logged at each step of the physics.

    Args:
        log: coordinates (nq,), velocities (nv,), joint torques (J,), acceleration of the trunk (6,) and normal force on
            each foot (legs,), a step each.
        step_s: of the physics, s.
        joints: columns of the joints in coordinates and in velocities, (J,) each.
        counts: contacts that a sound gait does not have.
        friction: of the feet; None on ground of one friction.
    """
    qpos, qvel, torque, acceleration, force = (np.array(column) for column in zip(*log, strict=True))
    return Motion(
        time_s=np.asarray(step_s * np.arange(len(qpos)), dtype=np.float64),
        qpos=qpos,
        qvel=qvel,
        trunk_acceleration=acceleration,
        joint_columns=joints[0],
        joint_velocity_columns=joints[1],
        spring_torque=torque,
        foot_force=force,
        self_contacts=counts.self_contacts,
        ground_contacts=counts.ground_contacts,
        max_penetration_m=counts.max_penetration_m,
        on_tile_s=None if friction is None else friction.on_tile_s,
    )


class Pusher:
    """Pushes at random times, each a half sine of force and torque in a random direction."""

    def __init__(self, config: PushConfig, generator: np.random.Generator) -> None:
        self._config = config
        self._generator = generator
        self._begin_s = self._end_s = 0.0
        self._wrench: Array = np.zeros(6)

    def at(self, time_s: float) -> Array:
        """Force and torque [N 3, Nm 3] in the world at ``time_s``, which rises from call to call."""
        config = self._config
        if config.force_n == 0.0 and config.torque_nm == 0.0:
            return self._wrench
        if time_s >= self._end_s:
            self._begin_s = time_s + float(self._generator.exponential(config.every_s))
            self._end_s = self._begin_s + config.duration_s * float(self._generator.uniform(0.5, 1.5))
            force, torque = self._direction() * config.force_n, self._direction() * config.torque_nm
            self._wrench = np.concatenate((force, torque)) * self._generator.uniform(0.3, 1.0)
        if time_s < self._begin_s:
            return np.zeros(6)
        share = (time_s - self._begin_s) / (self._end_s - self._begin_s)
        return np.asarray(self._wrench * np.sin(np.pi * share))

    def _direction(self) -> Array:
        vector = self._generator.standard_normal(3)
        return np.asarray(vector / np.linalg.norm(vector))


def _pose(qpos: Any) -> Array:
    return se3.transform(so3.from_quat_wxyz(np.asarray(qpos[3:7])), np.asarray(qpos[:3]))
