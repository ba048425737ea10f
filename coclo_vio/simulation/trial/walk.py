# SPDX-License-Identifier: BSD-3-Clause
"""The walk of a trial: what is drawn before it, and its motion, simulated or from a file."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from coclo_vio.robot.description import RobotDescription
from coclo_vio.robot.model import RobotModel
from coclo_vio.simulation.trial.config import TrialConfig, motion_key
from coclo_vio.simulation.trial.gait_controller import GaitController, planned_path
from coclo_vio.simulation.trial.imperfection import Imperfection, draw_imperfection
from coclo_vio.simulation.trial.motion import Motion, read_motion, write_motion
from coclo_vio.simulation.trial.physics import Simulator
from coclo_vio.simulation.trial.robot_spec import make_spec
from coclo_vio.simulation.trial.slippery_ground import SlipperyGround
from coclo_vio.simulation.trial.slippery_tile import SlipperyTile
from coclo_vio.simulation.trial.terrain import Terrain, TerrainName, make_terrain
from coclo_vio.values.measurements import FootForceSample

_STREAMS = ("imperfection", "gait", "push", "imu", "camera_imu", "joints", "vicon", "slip")  # new ones at the end


@dataclass(frozen=True, slots=True, eq=False)
class Walk:
    """A trial before it is walked; made by ``draw``.

    Attributes:
        name: of the terrain.
        robot: the described robot.
        config: the trial.
        seed: decides everything random.
        until_s: end of the simulation, s; None for the whole trial.
        terrain: the ground.
        imperfection: how the robot that walks differs from its description.
        slippery: areas of low friction; None on ground of one friction.
        generators: one for each part of the trial.
    """

    name: TerrainName
    robot: RobotDescription
    config: TrialConfig
    seed: int
    until_s: float | None
    terrain: Terrain
    imperfection: Imperfection
    slippery: SlipperyGround | None
    generators: Mapping[str, np.random.Generator]

    @classmethod
    def draw(
        cls, name: TerrainName, robot: RobotDescription, config: TrialConfig, seed: int, until_s: float | None
    ) -> "Walk":
        """Draw the robot and the ground of a trial."""
        generators, terrain = make_generators(seed, _STREAMS), make_terrain(name)
        imperfection = draw_imperfection(
            config.imperfection, len(robot.legs), len(robot.joint_names), generators["imperfection"]
        )
        slippery = _slippery_ground(terrain, config, generators["slip"])
        return cls(name, robot, config, seed, until_s, terrain, imperfection, slippery, generators)

    def spec(self) -> mujoco.MjSpec:
        """The robot on its terrain, without textures and cameras."""
        spec = make_spec(self.robot, self.config.body, self.imperfection, self.terrain)
        spec.compile()  # drops the URDF's own visual shapes, which would flicker through those of feet and legs
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
        key = motion_key(self.name, self.config, self.seed, self.until_s)
        return kept_motion(key, lambda: self._simulate(progress), motions)

    def foot_forces(self, motion: Motion) -> Iterable[FootForceSample]:
        """A Daisy has no foot sensors."""
        return ()

    def _simulate(self, progress: Callable[[float], None] | None) -> Motion:
        model = RobotModel(self.robot, is_compiled=False)  # contacts make much of rounding: same bytes without numba
        config = self.config
        simulator = Simulator(self.spec().compile(), model, self.slippery)
        gait = self.generators["gait"]
        controller = GaitController(model, self.terrain, config.gait, simulator.spring, gait, config.stand_s)
        return simulator.walk(
            controller, config.end_s, config.push, self.generators["push"], until_s=self.until_s, progress=progress
        )


def make_generators(seed: int, streams: Sequence[str]) -> dict[str, np.random.Generator]:
    """An independent random generator for each part of a trial; further streams do not change the first ones."""
    sequences = np.random.SeedSequence(seed).spawn(len(streams))
    return {stream: np.random.default_rng(sequence) for stream, sequence in zip(streams, sequences, strict=True)}


def kept_motion(key: str, simulate: Callable[[], Motion], motions: Path | None) -> Motion:
    """The motion of this name in a folder of motions, simulated and added if it is missing.

    Raises:
        DatasetError: the folder cannot be written, or a file in it is damaged.
    """
    if motions is None:
        return simulate()
    path = motions / f"{key}.npz"
    if path.is_file():
        return read_motion(path)
    motion = simulate()
    write_motion(motion, path)
    return motion


def _slippery_ground(terrain: Terrain, config: TrialConfig, generator: np.random.Generator) -> SlipperyGround | None:
    tile = None
    if config.slippery_tile is not None:
        tile = SlipperyTile.on_path(planned_path(terrain, config.gait), config.slippery_tile)
    if tile is None and not config.slip.is_active:
        return None
    return SlipperyGround.draw(config.slip, tile, terrain, generator)
