# SPDX-License-Identifier: BSD-3-Clause
"""A simulated trial on the disk: the recording for everyone, and the truth in a folder that no reader opens."""

import tempfile
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass
from enum import Enum
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import yaml
from pydantic import Field

from coclo_vio import __version__
from coclo_vio.config import StageConfig, merged
from coclo_vio.datasets.contents import RecordingContents
from coclo_vio.datasets.rosbag.writing.recording import write_bag
from coclo_vio.datasets.writer import write_euroc_folder
from coclo_vio.errors import DatasetError
from coclo_vio.measurements import EncodedStereoFrame
from coclo_vio.robot.description import RobotDescription, load_robot
from coclo_vio.simulation.trial.imperfection import IDEAL
from coclo_vio.simulation.trial.terrain import TerrainName
from coclo_vio.simulation.trial.trial import Trial, TrialConfig, preset, simulate
from coclo_vio.simulation.visuals.cameras import add_cameras
from coclo_vio.simulation.visuals.config import CameraConfig, SceneConfig
from coclo_vio.simulation.visuals.scene import add_visuals
from coclo_vio.simulation.visuals.stereo_renderer import render_stereo
from coclo_vio.trajectory import write_tum

SIMULATED_ROBOT = "daisy"


class RecordingFormat(Enum):
    """How a trial is stored."""

    EUROC = "euroc"
    ROS1 = "ros1"
    MCAP = "mcap"
    ROS2 = "ros2"

    @classmethod
    def of(cls, path: Path) -> "RecordingFormat":
        """By the suffix: ``.bag``, ``.mcap``, ``.db3``; a path without one is an EuRoC-style folder.

        Raises:
            DatasetError: another suffix.
        """
        formats = {".bag": cls.ROS1, ".mcap": cls.MCAP, ".db3": cls.ROS2, "": cls.EUROC}
        if path.suffix not in formats:
            raise DatasetError(
                f"{path} ends in {path.suffix}, which no format has; end it in .bag (ROS 1), .mcap or .db3 (ROS 2), or "
                "in nothing for an EuRoC-style folder"
            )
        return formats[path.suffix]


class SimulationConfig(StageConfig):
    """A whole simulated recording: the trial, what there is to see, and how the cameras see it."""

    trial: Annotated[TrialConfig, Field(description="robot, gait, physics, sensors, motion capture")] = TrialConfig()
    scene: Annotated[SceneConfig, Field(description="the room")] = SceneConfig()
    camera: Annotated[CameraConfig, Field(description="imagers, exposure, light, encoding")] = CameraConfig()


@dataclass(frozen=True, slots=True)
class Progress:
    """Who is told how far a simulation has come.

    Attributes:
        walked: called with the simulated time, s.
        drawn: called with the number of stereo frames drawn, and how many there are.
    """

    walked: Callable[[float], None] = lambda time_s: None
    drawn: Callable[[int, int], None] = lambda done, total: None


def simulation_config(name: TerrainName, *changes: dict[str, Any], ideal: bool = False) -> SimulationConfig:
    """The configuration of one of the paper's trials; later changes win.

    Raises:
        ConfigError: a key that does not exist, or a value out of bounds.
    """
    values: dict[str, Any] = {"trial": preset(name)}
    if ideal:
        values = merged(values, {"trial": {"imperfection": IDEAL.model_dump()}})
    for change in changes:
        values = merged(values, change)
    return SimulationConfig.parse(values, f"trial {name}")


def simulate_recording(
    path: Path,
    name: TerrainName,
    config: SimulationConfig,
    seed: int,
    *,
    kind: RecordingFormat | None = None,
    images: bool = True,
    until_s: float | None = None,
    workers: int = 2,
    progress: Progress | None = None,
) -> Trial:
    """Simulate a trial and write it to ``path``; what is true of it goes to ``truth_folder(path)``.

    Args:
        path: of the recording; must not exist.
        name: the terrain.
        config: the simulation.
        seed: decides everything random; the same seed makes the same bytes.
        kind: how to store it; by the suffix of ``path`` if None.
        images: whether the cameras record.
        until_s: cut the trial short after so many seconds.
        workers: processes that draw.
        progress: who is told.

    Raises:
        DatasetError: the path is taken or cannot be written.
        SimulationError: the robot fell, or what draws off screen is missing.
    """
    kind, told = kind or RecordingFormat.of(path), progress or Progress()
    if path.exists():
        raise DatasetError(f"{path} is there already; name another path, or remove it first")
    robot = load_robot(SIMULATED_ROBOT)
    trial = simulate(name, robot, config.trial, seed, until_s=until_s, progress=told.walked)
    with tempfile.TemporaryDirectory() as scratch:
        frames = _frames(trial, config, seed, workers, Path(scratch) / "model.mjb", told) if images else ()
        _write(path, kind, _contents(trial, robot, frames, images=images))
    _write_truth(truth_folder(path), trial, name, config, seed)
    return trial


def truth_folder(path: Path) -> Path:
    """Where the truth of the recording at ``path`` is kept: beside it, so that no reader comes across it."""
    return path.with_name(f"{path.stem}_truth")


def _frames(
    trial: Trial, config: SimulationConfig, seed: int, workers: int, model_path: Path, told: Progress
) -> Iterable[EncodedStereoFrame]:
    import mujoco  # noqa: PLC0415 -- an extra

    body = trial.spec.bodies[1].name
    add_cameras(trial.spec, trial.truth.stereo, body)
    add_visuals(trial.spec, trial.terrain.surfaces, config.scene, seed, trial.terrain.bounds)
    mujoco.mj_saveModel(trial.spec.compile(), str(model_path))
    total = len(trial.frame_ns)
    return render_stereo(
        model_path,
        trial.frame_qpos,
        trial.frame_ns,
        config.camera,
        seed,
        workers,
        lambda done: told.drawn(done, total),
        trial.frame_qvel,
    )


def _contents(
    trial: Trial, robot: RobotDescription, frames: Iterable[EncodedStereoFrame], *, images: bool
) -> RecordingContents:
    stereo = trial.stereo if images else None
    return RecordingContents(robot, trial.measurements, trial.vicon, trial.imu, trial.camera_imu, stereo, frames)


def _write(path: Path, kind: RecordingFormat, contents: RecordingContents) -> None:
    if kind is RecordingFormat.EUROC:
        write_euroc_folder(path, contents)
    else:
        write_bag(path, contents)


def _write_truth(folder: Path, trial: Trial, name: TerrainName, config: SimulationConfig, seed: int) -> None:
    """Exact poses, contacts, biases, and how the robot differs from its description."""
    truth = trial.truth
    try:
        folder.mkdir(parents=True, exist_ok=True)
        write_tum(truth.trajectory, folder / "groundtruth.tum")
        _write_contacts(folder / "contacts.csv", trial)
        story = {
            "version": __version__,
            "trial": name,
            "seed": seed,
            "path_length_m": trial.terrain.path_length_m,
            "vicon_clock_ahead_s": truth.vicon_offset_s,
            "legs_touching_each_other": truth.self_contacts,
            "legs_touching_the_ground": truth.ground_contacts,
            "gyroscope_bias_at_start_radps": truth.imu.gyroscope_bias[0].tolist(),
            "accelerometer_bias_at_start_mps2": truth.imu.accelerometer_bias[0].tolist(),
            "stereo": truth.stereo.model_dump(mode="json"),
            "robot": {key: np.asarray(value).tolist() for key, value in asdict(truth.imperfection).items()},
            "config": config.model_dump(mode="json"),
        }
        (folder / "trial.yaml").write_text(yaml.safe_dump(story, sort_keys=False), encoding="utf-8")
    except OSError as error:
        raise DatasetError(f"cannot write {folder}: {error.strerror}; choose another place") from error


def _write_contacts(path: Path, trial: Trial) -> None:
    """Which feet touch the ground: a row at the beginning and at every change, exact to the physics' step."""
    contact, stamps = trial.truth.contact, trial.truth.contact_ns
    changes = [0, *(np.flatnonzero((contact[1:] != contact[:-1]).any(axis=1)) + 1)]
    with path.open("w", encoding="ascii", newline="\n") as out:
        out.write(",".join(["stamp_ns", *trial.robot.leg_names]) + "\n")
        for row in changes:
            out.write(",".join([str(int(stamps[row])), *(str(int(value)) for value in contact[row])]) + "\n")
