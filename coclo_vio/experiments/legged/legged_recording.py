# SPDX-License-Identifier: BSD-3-Clause
"""The recordings of the benchmark: how each is named, made, read, and what is true of it."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from coclo_vio.experiments.legged.legged_record import RecordingKind
from coclo_vio.simulation.simulated_recording import Execution, simulate_recording, simulation_config, truth_folder
from coclo_vio.simulation.simulated_trot import simulate_trot, trot_config
from coclo_vio.simulation.trial.terrain import TERRAINS, TerrainName
from coclo_vio.simulation.trot.ground import GROUNDS
from coclo_vio.values.errors import DatasetError
from coclo_vio.values.trajectory import GroundTruth, read_tum

TROT_ROBOTS = ("go1", "anymal_b")
WALK_ROBOT = "daisy"
WALK_UNTIL_S = 40.0
DISTANCES_M: Mapping[str, float] = {"flat": 50.0, "rough": 22.0, "ramp": 22.0, "stairs": 22.0, "slippery": 14.0}
"""Path of a trot by its ground, m: as far as a robot reaches the end with each seed."""
IMPACT_DISTANCE_M = 22.0
IMPACT_CHANGES: Mapping[str, Mapping[str, float]] = {
    "touch-down at 0.1 m/s": {"touch_speed_mps": 0.1},
    "touch-down at 0.4 m/s": {"touch_speed_mps": 0.4},
    "touch-down at 1.0 m/s": {"touch_speed_mps": 1.0},
    "speed 0.3 m/s": {"speed_mps": 0.3},
    "speed 0.9 m/s": {"speed_mps": 0.9},
    "speed 1.2 m/s": {"speed_mps": 1.2},
}
"""Changes of the gait that change how hard feet land, by what they are called."""
LOGS: Mapping[str, str] = {"go1_mocap": "go1", "icub_sway": "icub.yaml"}
"""Real logs with ground truth by the name of their folder: a known robot, or its file beside the log."""


@dataclass(frozen=True, slots=True)
class LeggedRecording:
    """One recording; can be pickled for another process.

    Attributes:
        kind: a trot, a trot of which impacts are varied, a walk of the Daisy, or a real log.
        group: what it has in common with those of other seeds, and what tables call it.
        robot: name of the robot, or path of its description.
        ground: of a simulated one.
        seed: of a simulated one; None of a log.
        trial: changes of a trot's trial, such as ``{"gait": {"speed_mps": 0.9}}``.
        images: whether cameras record.
        log: folder of a real one.
    """

    kind: RecordingKind
    group: str
    robot: str
    ground: str = ""
    seed: int | None = None
    trial: Mapping[str, Any] = field(default_factory=dict)
    images: bool = False
    log: Path | None = None

    @property
    def name(self) -> str:
        """Name of its file, without what not every file system allows."""
        plain = "".join(letter if letter.isalnum() or letter in ".-" else "_" for letter in self.group)
        parts = [plain, *(["images"] if self.images else []), *([] if self.seed is None else [str(self.seed)])]
        return "_".join(parts)


@dataclass(frozen=True, slots=True)
class LeggedRecordings:
    """The folder of simulated recordings, each with its truth beside it.

    Attributes:
        folder: where they are, or will be.
    """

    folder: Path

    def path(self, recording: LeggedRecording) -> Path:
        """Where a recording is, or will be."""
        return recording.log or self.folder / f"{recording.name}.mcap"

    def make(self, recording: LeggedRecording) -> None:
        """Simulate a recording if it is missing; one that is there is whole.

        Raises:
            SimulationError: the robot fell, or there is no OpenGL to render with.
            RobotModelError: the robot's URDF is in an extra that is not installed.
            DatasetError: the folder cannot be written, or a log is missing.
        """
        path = self.path(recording)
        if path.exists():
            return
        if recording.log is not None:
            raise DatasetError(f"there is no {path}; name the folder of the logs with --data, or leave them out")
        execution, seed = Execution(workers=1), recording.seed or 0
        if recording.kind == "walk":
            ground, until_s = _terrain(recording.ground), WALK_UNTIL_S
            config = simulation_config(ground)
            simulate_recording(
                path, ground, config, seed, images=recording.images, until_s=until_s, execution=execution
            )
        else:
            simulate_trot(
                path, trot_config(_trot_changes(recording)), seed, images=recording.images, execution=execution
            )

    def truth(self, recording: LeggedRecording) -> GroundTruth | None:
        """The exact poses of a simulated recording; None of a log, which has its motion capture.

        Raises:
            DatasetError: they are missing.
        """
        if recording.log is not None:
            return None
        path = truth_folder(self.path(recording)) / "groundtruth.tum"
        return GroundTruth(read_tum(path), True, "truth")


def recordings_of(
    seeds: Sequence[int],
    *,
    data: Path | None = None,
    distance_m: float | None = None,
    images: bool = False,
    impacts: bool = False,
) -> list[LeggedRecording]:
    """All recordings of the benchmark, the real ones first, then those of a seed together.

    Args:
        seeds: of the simulated ones.
        data: folder of the real logs; those that are not there are left out.
        distance_m: length of all trots, m; None for ``DISTANCES_M``.
        images: whether simulated cameras record.
        impacts: whether there are the trots of ``IMPACT_CHANGES`` too.
    """
    found = [] if data is None else list(_logs(data))
    for seed in seeds:
        found += list(_trots(seed, distance_m, images=images))
        found += [LeggedRecording("walk", f"daisy {name}", WALK_ROBOT, name, seed, images=images) for name in TERRAINS]
        found += list(_impacts(seed, distance_m)) if impacts else []
    return found


def _logs(data: Path) -> Iterator[LeggedRecording]:
    for name, robot in LOGS.items():
        folder = data.resolve() / name
        if folder.is_dir():
            described = str(folder / robot) if robot.endswith(".yaml") else robot
            yield LeggedRecording("log", name, described, log=folder)


def _trots(seed: int, distance_m: float | None, *, images: bool) -> Iterator[LeggedRecording]:
    for robot in TROT_ROBOTS:
        for ground in GROUNDS:
            along_m = distance_m or DISTANCES_M[ground]
            group, trial = f"{robot} {ground} {along_m:g} m", {"gait": {"distance_m": along_m}}
            yield LeggedRecording("trot", group, robot, ground, seed, trial, images)


def _impacts(seed: int, distance_m: float | None) -> Iterator[LeggedRecording]:
    along_m = distance_m or IMPACT_DISTANCE_M
    for robot in TROT_ROBOTS:
        for name, change in IMPACT_CHANGES.items():
            group, trial = f"{robot} {name} {along_m:g} m", {"gait": {"distance_m": along_m, **change}}
            yield LeggedRecording("impacts", group, robot, "flat", seed, trial)


def _trot_changes(recording: LeggedRecording) -> Mapping[str, Any]:
    return {"trial": {"robot": recording.robot, "ground": recording.ground, **recording.trial}}


def _terrain(name: str) -> TerrainName:
    return next(terrain for terrain in TERRAINS if terrain == name)
