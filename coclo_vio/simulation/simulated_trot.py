# SPDX-License-Identifier: BSD-3-Clause
"""A simulated trot of a quadruped on the disk: the recording, and its truth beside it.

The foot forces of a bag are entries of the joints' message, as in the logs of a Go1. Imports MuJoCo.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from coclo_vio.datasets.writer import RecordedJoints
from coclo_vio.robot.description import load_robot
from coclo_vio.simulation.simulated_recording import Execution, Plan, RecordingFormat, record
from coclo_vio.simulation.trial.trial import Trial, recorded
from coclo_vio.simulation.trot.config import TrotConfig, trot_preset
from coclo_vio.simulation.trot.trot_walk import TrotWalk
from coclo_vio.simulation.visuals.config import CameraConfig, SceneConfig
from coclo_vio.values.config import StageConfig, merged


class TrotSimulationConfig(StageConfig):
    """Configuration of a simulated trot: the trial, the room, the cameras."""

    trial: Annotated[TrotConfig, Field(description="robot, ground, gait, physics, sensors")] = TrotConfig()
    scene: Annotated[SceneConfig, Field(description="the room")] = SceneConfig()
    camera: Annotated[CameraConfig, Field(description="imagers, exposure, light, encoding")] = CameraConfig()


def trot_config(*changes: Mapping[str, Any]) -> TrotSimulationConfig:
    """The configuration of a trot with changes such as ``IDEAL_ROBOT``; later ones win.

    Where they name a robot or a ground, ``{"trial": {"robot": "a1", "ground": "ramp"}}``, the rest has the values of
    these unless a change has others.

    Raises:
        ConfigError: a key that does not exist, or a value out of bounds.
        RobotModelError: the robot's URDF is in an extra that is not installed.
    """
    wanted: dict[str, Any] = {}
    for change in changes:
        wanted = merged(wanted, change)
    kind = TrotSimulationConfig.parse(wanted, "trot").trial
    preset = trot_preset(load_robot(kind.robot), kind.robot, kind.ground)
    return TrotSimulationConfig.parse(merged({"trial": preset}, wanted), f"trot of {kind.robot} on {kind.ground}")


def simulate_trot(
    path: Path,
    config: TrotSimulationConfig,
    seed: int,
    *,
    recording_format: RecordingFormat | None = None,
    images: bool = True,
    until_s: float | None = None,
    execution: Execution | None = None,
) -> Trial:
    """Simulate a trot and write it to ``path``, and its truth beside it.

    Args:
        path: of the recording; must not exist, nor the folder of its truth.
        config: the simulation.
        seed: decides everything random; on one machine the same seed makes the same bytes.
        recording_format: by the suffix of ``path`` if None.
        images: whether the cameras record.
        until_s: end of the simulation if the trial is not over before, s.
        execution: number of processes and callbacks of progress.

    Raises:
        DatasetError: a path exists, cannot be written, or does not fit the format.
        SimulationError: the robot fell, or there is no OpenGL to render with.
    """
    trial, robot = config.trial, load_robot(config.trial.robot)
    plan = Plan(
        name=f"trot_{trial.ground}",
        robot=robot,
        config=config,
        scene=config.scene,
        camera=config.camera,
        seed=seed,
        planned_s=min(_planned_duration_s(trial), until_s or np.inf),
        make=lambda progress, motions: recorded(TrotWalk.draw(robot, trial, seed, until_s), progress, motions),
        joints=RecordedJoints(trial.joints.has_velocity, trial.joints.has_effort, with_feet=trial.feet.is_present),
    )
    return record(path, plan, recording_format=recording_format, images=images, execution=execution)


def _planned_duration_s(trial: TrotConfig) -> float:
    """Duration of the trial if nothing delays the robot, s."""
    return trial.stand_s + trial.gait.distance_m / trial.gait.speed_mps + trial.end_s
