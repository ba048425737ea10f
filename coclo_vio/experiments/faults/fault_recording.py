# SPDX-License-Identifier: BSD-3-Clause
"""The recordings of the matrix: a walk of the Daisy and a trot of the Go1, short and with images, simulated here."""

from dataclasses import dataclass
from pathlib import Path

from coclo_vio.experiments.studies.study import JPEG
from coclo_vio.simulation.simulated_recording import Execution, simulate_recording, simulation_config, truth_folder
from coclo_vio.simulation.simulated_trot import simulate_trot, trot_config
from coclo_vio.values.errors import ConfigError, listing
from coclo_vio.values.trajectory import Trajectory, read_tum

ROBOTS = ("daisy", "go1")
WALK_UNTIL_S, WALK_FRAMES_HZ = 18.0, 7.5  # half the frames cost nothing in accuracy at this walking speed
TROT_DISTANCE_M = 6.0


@dataclass(frozen=True, slots=True)
class FaultRecording:
    """One recording; can be pickled for another process.

    Attributes:
        robot: name of the robot.
        seed: decides everything random in it.
        folder: where it is, or will be.
    """

    robot: str
    seed: int
    folder: Path

    def __post_init__(self) -> None:
        if self.robot not in ROBOTS:
            raise ConfigError(f"there is no recording of {self.robot}; choose some of --robots {listing(ROBOTS)}")

    @property
    def name(self) -> str:
        """Name of its file, without the suffix."""
        return f"{self.robot}_{self.seed}"

    @property
    def path(self) -> Path:
        """Where it is, or will be."""
        return self.folder / f"{self.name}.mcap"

    def make(self) -> None:
        """Simulate it if it is missing; one that is there is whole.

        Raises:
            SimulationError: the robot fell, or there is no OpenGL to render with.
            RobotModelError: the robot's URDF is in an extra that is not installed.
            DatasetError: the folder cannot be written.
        """
        if self.path.exists():
            return
        execution = Execution(workers=1)
        if self.robot == "daisy":
            config = simulation_config("flat", JPEG, {"trial": {"frame_rate_hz": WALK_FRAMES_HZ}})
            simulate_recording(self.path, "flat", config, self.seed, until_s=WALK_UNTIL_S, execution=execution)
        else:
            trial = {"trial": {"robot": self.robot, "ground": "flat", "gait": {"distance_m": TROT_DISTANCE_M}}}
            simulate_trot(self.path, trot_config(trial, JPEG), self.seed, execution=execution)

    def truth(self) -> Trajectory:
        """The exact poses.

        Raises:
            DatasetError: they are missing.
        """
        return read_tum(truth_folder(self.path) / "groundtruth.tum")
