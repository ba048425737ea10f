# SPDX-License-Identifier: BSD-3-Clause
"""The trot of a trial: what is drawn before it, and its motion, simulated or from a file."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import mujoco
import numpy as np

from coclo_vio.robot.description import RobotDescription
from coclo_vio.robot.model import RobotModel
from coclo_vio.simulation.trial.config import hashed_key
from coclo_vio.simulation.trial.motion import Motion
from coclo_vio.simulation.trial.physics import FootFriction, Pusher
from coclo_vio.simulation.trial.slippery_ground import SlipperyGround
from coclo_vio.simulation.trial.walk import kept_motion, make_generators
from coclo_vio.simulation.trot.config import OF_SENSORS, TrotConfig
from coclo_vio.simulation.trot.controller import TrotController
from coclo_vio.simulation.trot.foot_sensor import foot_force_samples
from coclo_vio.simulation.trot.ground import TrotGround, make_ground
from coclo_vio.simulation.trot.quadruped import QUADRUPED_PARTS
from coclo_vio.simulation.trot.quadruped_body import QuadrupedBody
from coclo_vio.simulation.trot.quadruped_spec import make_trot_spec
from coclo_vio.simulation.trot.reference import ReferenceTracker
from coclo_vio.simulation.trot.trot_gait import TrotGait
from coclo_vio.simulation.trot.trot_imperfection import TrotImperfection, draw_trot_imperfection
from coclo_vio.simulation.trot.trot_physics import TrotSimulator
from coclo_vio.values.measurements import FootForceSample

_STREAMS = (  # new ones at the end
    *("imperfection", "gait", "push", "imu", "camera_imu", "joints", "vicon", "slip"),
    *("ground", "speed", "feet"),
)


@dataclass(frozen=True, slots=True, eq=False)
class TrotWalk:
    """A trot before it is walked; made by ``draw``.

    Attributes:
        robot: the described robot.
        config: the trial.
        seed: decides everything random.
        until_s: end of the simulation, s; None for the whole trial.
        terrain: the ground.
        imperfection: how the robot that walks differs from its description.
        slippery: areas of low friction; None on ground of one friction.
        generators: one for each part of the trial.
    """

    robot: RobotDescription
    config: TrotConfig
    seed: int
    until_s: float | None
    terrain: TrotGround
    imperfection: TrotImperfection
    slippery: SlipperyGround | None
    generators: Mapping[str, np.random.Generator]

    @classmethod
    def draw(cls, robot: RobotDescription, config: TrotConfig, seed: int, until_s: float | None) -> "TrotWalk":
        """Draw the robot and the ground of a trial."""
        generators = make_generators(seed, _STREAMS)
        ground = make_ground(config.ground, config.gait.distance_m, generators["ground"])
        imperfection = draw_trot_imperfection(config.imperfection, len(robot.legs), generators["imperfection"])
        slippery = SlipperyGround.draw(config.slip, None, ground, generators["slip"]) if config.slip.is_active else None
        return cls(robot, config, seed, until_s, ground, imperfection, slippery, generators)

    def spec(self) -> mujoco.MjSpec:
        """The robot on its ground, without textures and cameras."""
        spec = make_trot_spec(self.robot, self.config.body, self.imperfection, self.terrain)
        spec.compile()
        return spec

    def motion(self, progress: Callable[[float], None] | None = None, motions: Path | None = None) -> Motion:
        """The true motion.

        Args:
            progress: called with the simulated time (s) now and then.
            motions: folder of motions; one that is missing is simulated and added. None: simulated, not kept.

        Raises:
            SimulationError: the robot fell or stuck.
            DatasetError: the folder cannot be written, or a file in it is damaged.
        """
        name = f"trot_{self.config.robot}_{self.config.ground}"
        key = hashed_key(name, self.config, OF_SENSORS, self.seed, self.until_s)
        return kept_motion(key, lambda: self._simulate(progress), motions)

    def foot_forces(self, motion: Motion) -> Iterable[FootForceSample]:
        """Readings of the foot sensors, at the stamps of the joints."""
        config = self.config
        return foot_force_samples(motion, config.feet, config.joints.rate_hz, self.generators["feet"])

    def _simulate(self, progress: Callable[[float], None] | None) -> Motion:
        config, generators, parts = self.config, self.generators, QUADRUPED_PARTS[self.config.robot]
        model = RobotModel(self.robot, is_compiled=False)
        height_m = config.gait.height_m or parts.height_m
        body = QuadrupedBody.of(model, parts, height_m)
        gait = TrotGait(config.gait, model.hip_position_body, generators["gait"])
        tracker = ReferenceTracker(self.terrain, config.gait, height_m, generators["speed"])
        controller = TrotController(body, self.terrain, gait, tracker, config.stand_s)
        friction = None if self.slippery is None else partial(FootFriction, ground=self.slippery)
        simulator = TrotSimulator(self.spec().compile(), self.robot, self.terrain, friction)
        pusher = Pusher(config.push, generators["push"])
        return simulator.walk(controller, body, config.end_s, pusher, until_s=self.until_s, progress=progress)
