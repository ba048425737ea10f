# SPDX-License-Identifier: BSD-3-Clause
"""The loop of controller and contact physics: a quadruped trots along its path, recorded at every step."""

from collections.abc import Callable

import mujoco
import numpy as np

from coclo_vio.robot.description import RobotDescription
from coclo_vio.simulation.trial.motion import Motion
from coclo_vio.simulation.trial.physics import ContactCounts, FootFriction, Pusher, motion_of
from coclo_vio.simulation.trot.controller import QuadrupedState, TrotController
from coclo_vio.simulation.trot.ground import TrotGround
from coclo_vio.simulation.trot.quadruped_body import QuadrupedBody
from coclo_vio.values.arrays import Array
from coclo_vio.values.errors import SimulationError

_TRUNK = 6  # the first six velocities are those of the trunk
_SETTLING_S = 1.0  # standing before the trial begins
_CONTROL_EVERY_S = 0.002
_FALLEN_COSINE = 0.6  # of the trunk's tilt (53 deg)
_FALLEN_HEIGHT = 0.45  # of its height when it trots
_MAX_DURATION_RATIO = 2.0  # of the trot's duration to the planned one
_START_HEIGHT_M = 0.002  # of the soles when the robot is put down


class TrotSimulator:
    """Simulates a quadruped in a compiled model.

    Args:
        model: made by ``quadruped_spec.make_trot_spec``.
        description: of the robot.
        ground: it stands on.
        friction: that of each foot by its place; None on ground of one friction.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        description: RobotDescription,
        ground: TrotGround,
        make_friction: Callable[[mujoco.MjModel, list[int], Array], FootFriction] | None = None,
    ) -> None:
        self.model = model
        self._ground = ground
        self._data = mujoco.MjData(model)
        joints = [model.joint(name) for name in description.joint_names]
        self._q = np.array([joint.qposadr[0] for joint in joints])
        self._v = np.array([joint.dofadr[0] for joint in joints])
        feet = [leg.foot_frame for leg in description.legs]
        self._sites = [int(model.site(f"{foot}_sole").id) for foot in feet]
        self._touch = np.array([model.sensor(f"{foot}_touch").adr[0] for foot in feet])
        self._own = self._v.reshape(len(feet), -1)
        self._jacobian = np.zeros((3, model.nv))
        self._mass = np.zeros((model.nv, model.nv))
        self._rotation = np.zeros(9)
        soles = [int(model.geom(foot).id) for foot in feet]
        grounds = [index for index in range(model.ngeom) if model.geom(index).name.startswith("ground")]
        self._counts = ContactCounts(frozenset(soles), frozenset(grounds))
        self._friction = None if make_friction is None else make_friction(model, soles, self._touch)

    def walk(
        self,
        controller: TrotController,
        body: QuadrupedBody,
        end_s: float,
        pusher: Pusher,
        *,
        until_s: float | None = None,
        progress: Callable[[float], None] | None = None,
    ) -> Motion:
        """Trot to the end of the path, stand for ``end_s`` seconds, and return the motion.

        Args:
            controller: of the robot, not used before.
            body: what it knows of the robot.
            end_s: standing at the end, s.
            pusher: of the trunk.
            until_s: cut the trial short at this time.
            progress: called with the simulated time (s) now and then.

        Raises:
            SimulationError: the robot fell, or got stuck.
        """
        self._place(controller, body)
        data, step_s = self._data, self.model.opt.timestep
        every = max(1, round(_CONTROL_EVERY_S / step_s))
        limit_s = _limit_s(controller, end_s)
        log: list[tuple[Array, ...]] = []
        stop_s, cut_s = None, np.inf if until_s is None else until_s
        while data.time < cut_s and (stop_s is None or data.time < stop_s):
            data.ctrl[:] = controller.torques(data.time, every * step_s, self._state()).ravel()
            if self._friction is not None:
                self._friction.update(data)
            data.xfrc_applied[1] = pusher.at(data.time) if controller.tracker.travelled_m > 0.0 else 0.0
            for _ in range(every):
                before = (data.qpos.copy(), data.qvel.copy(), data.act.copy())
                mujoco.mj_step(self.model, data)  # acceleration and forces then belong to the state before the step
                log.append((*before, data.qacc[:_TRUNK].copy(), data.sensordata[self._touch]))
            self._counts.count(data)
            self._check(controller, limit_s)
            if stop_s is None and controller.is_done:
                stop_s = data.time + end_s
            if progress is not None and len(log) % 500 < every:
                progress(data.time)
        return motion_of(log, self.model.opt.timestep, (self._q, self._v), self._counts, self._friction)

    def _place(self, controller: TrotController, body: QuadrupedBody) -> None:
        """Put the robot on its feet at the beginning of the path and let it settle."""
        data = self._data
        mujoco.mj_resetData(self.model, data)
        data.qpos[self._q] = body.standing
        mujoco.mj_forward(self.model, data)
        lowest = min(float(data.site_xpos[site][2]) for site in self._sites)
        data.qpos[2] = body.foot_radius_m + _START_HEIGHT_M - lowest + float(data.qpos[2])
        mujoco.mj_forward(self.model, data)
        every = max(1, round(_CONTROL_EVERY_S / self.model.opt.timestep))
        while data.time < _SETTLING_S:
            data.ctrl[:] = controller.torques(-1.0, _CONTROL_EVERY_S, self._state()).ravel()
            mujoco.mj_step(self.model, data, every)
        data.time = 0.0

    def _state(self) -> QuadrupedState:
        """The true state; positions are those before the last step of the physics, 1 ms old."""
        model, data, own = self.model, self._data, self._own
        legs = len(own)
        feet, velocity, jacobian = np.empty((legs, 3)), np.empty((legs, 3)), np.empty((legs, 3, 3))
        mujoco.mj_fullM(model, data, self._mass)
        for leg, site in enumerate(self._sites):
            mujoco.mj_jacSite(model, data, self._jacobian, None, site)
            feet[leg] = data.site_xpos[site]
            velocity[leg] = self._jacobian @ data.qvel
            jacobian[leg] = self._jacobian[:, own[leg]]
        mujoco.mju_quat2Mat(self._rotation, data.qpos[3:7])
        R = self._rotation.reshape(3, 3).copy()
        return QuadrupedState(
            position=data.qpos[:3].copy(),
            rotation=R,
            velocity=data.qvel[:3].copy(),
            rate=R @ data.qvel[3:6],
            centre_of_mass=data.subtree_com[1].copy(),
            feet=feet,
            feet_velocity=velocity,
            jacobian=jacobian,
            leg_inertia=self._mass[own[:, :, None], own[:, None, :]],
            bias=data.qfrc_bias[own],
            joint_velocity=data.qvel[own],
            load=data.sensordata[self._touch],
        )

    def _check(self, controller: TrotController, limit_s: float) -> None:
        data = self._data
        position = data.qpos[:3]
        if not np.isfinite(position).all():
            raise SimulationError(f"the physics diverged after {data.time:.1f} s; lower trial.body.time_step_s")
        _, x, y, _ = data.qpos[3:7]
        tilt_cosine = 1.0 - 2.0 * (x * x + y * y)
        height = position[2] - float(self._ground.map.heights(position[None, :2])[0])
        if tilt_cosine < _FALLEN_COSINE or height < _FALLEN_HEIGHT * controller.tracker.height_m:
            raise SimulationError(
                f"the robot fell after {data.time:.1f} s at x = {position[0]:.2f} m, y = {position[1]:.2f} m; "
                "lower trial.gait.speed_mps, raise trial.body.friction, or take another seed"
            )
        if data.time > limit_s:
            raise SimulationError(
                f"the robot got stuck after {controller.tracker.travelled_m:.1f} m of its path in {data.time:.0f} s; "
                "lower trial.gait.speed_mps or raise trial.gait.clearance_m"
            )


def _limit_s(controller: TrotController, end_s: float) -> float:
    tracker = controller.tracker
    planned_s = controller.ground.path.length_m / tracker.gait.speed_mps
    return controller.start_s + _MAX_DURATION_RATIO * planned_s + 10.0 + end_s
