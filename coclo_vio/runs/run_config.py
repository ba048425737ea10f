# SPDX-License-Identifier: BSD-3-Clause
"""The whole configuration of a run: the robot, if there is one, and every stage; from preset, file, command line."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import Field

from coclo_vio.backend.config import InvariantConfig
from coclo_vio.backend.window.config import SmootherConfig
from coclo_vio.datasets.config import DatasetConfig
from coclo_vio.evaluation.evaluate import EvaluationConfig
from coclo_vio.filter.config import FilterConfig
from coclo_vio.frontend.config import FrontendConfig
from coclo_vio.fusion.config import BridgeConfig
from coclo_vio.online.config import OnlineConfig
from coclo_vio.robot.description import EXTRA_SCHEME, RobotDescription, load_robot, robot_names
from coclo_vio.runs.faults import FaultsConfig
from coclo_vio.runs.live_config import LiveConfig
from coclo_vio.runs.plugins import load_plugins
from coclo_vio.values.calibration import ImuCalibration
from coclo_vio.values.config import StageConfig, merged, parse_settings, read_yaml
from coclo_vio.values.errors import ConfigError, listing, shortened


class CheckpointConfig(StageConfig):
    """Checkpoints of a run, which ``--resume`` goes on from."""

    interval_s: Annotated[
        float, Field(ge=0.0, description="seconds of recording between two checkpoints; 0 writes none")
    ] = 60.0


class RunConfig(StageConfig):
    """Everything a run depends on; ``config.yaml`` of a run folder repeats the run."""

    robot: Annotated[
        RobotDescription | None,
        Field(description="the robot: legs, contact sensing, IMU; null for visual modes"),
    ] = None
    dataset: Annotated[DatasetConfig, Field(description="how recordings are read")] = DatasetConfig()
    filter: Annotated[FilterConfig, Field(description="COCLO")] = FilterConfig()
    inekf: Annotated[InvariantConfig, Field(description="the IMU-centric baseline")] = InvariantConfig()
    frontend: Annotated[FrontendConfig, Field(description="the front end of the visual modes")] = FrontendConfig()
    smoother: Annotated[SmootherConfig, Field(description="the sliding window of the visual modes")] = SmootherConfig()
    bridge: Annotated[BridgeConfig, Field(description="between leg odometry and vision in combined")] = BridgeConfig()
    online: Annotated[OnlineConfig, Field(description="order and clocks of what is pushed")] = OnlineConfig()
    faults: Annotated[FaultsConfig, Field(description="what goes wrong on purpose")] = FaultsConfig()
    evaluation: Annotated[EvaluationConfig, Field(description="comparison with ground truth")] = EvaluationConfig()
    live: Annotated[LiveConfig, Field(description="running on a wire")] = LiveConfig()
    checkpoints: Annotated[CheckpointConfig, Field(description="of a run, to resume from")] = CheckpointConfig()
    imu_calibration: Annotated[
        Literal["recording", "robot"],
        Field(description="which mounting and noise of the IMU counts where both recording and robot have one"),
    ] = "recording"

    def on_recording(self, imu: ImuCalibration | None) -> Self:
        """The same run with the IMU's mounting and noise of a recording, where that one counts.

        Grade and sigmas of the biases are the robot's where the recording does not give them.
        """
        if imu is None or self.robot is None or self.imu_calibration == "robot":
            return self
        measured = imu.with_grade_of(self.robot.imu)
        return self.model_copy(update={"robot": self.robot.model_copy(update={"imu": measured})})

    def with_settings(self, settings: Sequence[str]) -> Self:
        """The same run with ``a.b=value`` strings on top.

        Raises:
            ConfigError: an unknown key or a value out of bounds.
        """
        changes = parse_settings(settings)
        of_dataset = changes.pop("dataset", {})
        dataset = DatasetConfig.parse(merged(self.dataset.model_dump(), of_dataset), "settings")
        changed = self.model_copy(update={"dataset": dataset})
        return type(self).parse(merged(changed.model_dump(), changes), "settings") if changes else changed


def resolve(
    robot: str | RobotDescription | None = None,
    file: Path | None = None,
    settings: Sequence[str] = (),
    guess: str | None = None,
) -> RunConfig:
    """The configuration of a run: the robot's preset, then the file, then the settings; the later wins.

    Where no robot is named there is none: the visual modes need none, a mode of legs asks for it. A file may
    name its robot as ``robot: {preset: go1}`` with changes beside it, or describe it whole.

    Args:
        robot: name or YAML file of the robot, or its description; wins over the file's.
        file: YAML configuration.
        settings: ``a.b=value`` strings.
        guess: the robot to take where none is named.

    Raises:
        ConfigError: an unknown robot or key, a value out of bounds, changes to a robot that is not named, or a plugin
            that cannot be loaded.
    """
    load_plugins()  # they register what a configuration can name
    given = read_yaml(file) if file else {}
    if file is not None and given.get("robot") is not None:
        given["robot"] = _robot_of_file(given["robot"], file, is_replaced=robot is not None)
    values = merged(given, parse_settings(settings))
    robot_values = values.pop("robot", None)
    changes = {} if robot_values is None else dict(_mapping(robot_values))
    preset = robot or changes.pop("preset", None)
    changes.pop("preset", None)
    if preset is None and "legs" not in changes:
        preset = guess
    source = " with ".join([*([str(file)] if file else []), *(["--set"] if settings else [])]) or "configuration"
    if preset is None and "legs" not in changes:
        if changes:
            raise ConfigError(
                f"{source} changes robot.{min(changes)}, but no robot is named: give --robot NAME or a YAML file; "
                f"known robots are: {listing(robot_names())}"
            )
        return RunConfig.parse(values, source)
    if "imu" in changes:  # a mounting that is configured counts, whatever the recording has
        values = {"imu_calibration": "robot", **values}
    described = merged(_preset_values(preset), changes)
    of_robot, of_run = described.get("filter"), values.get("filter", {})
    if isinstance(of_robot, Mapping) and isinstance(of_run, Mapping):  # otherwise the check below raises the error
        values["filter"] = merged(of_robot, of_run)
    return RunConfig.parse({**values, "robot": described}, source)


def _preset_values(preset: str | RobotDescription | None) -> dict[str, Any]:
    if preset is None:
        return {}
    robot = preset if isinstance(preset, RobotDescription) else load_robot(preset)
    return robot.model_dump() | {"imu": robot.imu.model_dump(exclude_unset=True)}  # so that a grade can be changed


def _mapping(robot: Any) -> Mapping[str, Any]:
    if not isinstance(robot, Mapping):
        raise ConfigError(
            f"robot = {shortened(repr(robot))}: give keys below it, such as robot.contact.on_force, or use --robot"
        )
    return robot


def _robot_of_file(robot: Any, file: Path, *, is_replaced: bool) -> Mapping[str, Any]:
    """The robot of a file, its URDF found from the file's own folder.

    Where the command line names another robot, the file's changes of its own robot do not hold for it.
    """
    values = dict(_mapping(robot))
    if is_replaced and ("legs" in values or "preset" in values):
        return {}
    urdf = values.get("urdf")
    if isinstance(urdf, str) and not urdf.startswith(EXTRA_SCHEME):
        values["urdf"] = str(file.parent.resolve() / urdf)
    return values
