# SPDX-License-Identifier: BSD-3-Clause
"""A recording with the configuration that it is read and run with."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from coclo_vio.datasets.dataset import Dataset, open_dataset, robot_fit
from coclo_vio.robot.description import RobotDescription
from coclo_vio.runs.examination import Examination, examine
from coclo_vio.runs.inspection import Inspection, inspect_recording, resolve_if_known
from coclo_vio.runs.mode_choice import compared_modes, default_mode
from coclo_vio.runs.preflight import preflight
from coclo_vio.runs.run_config import RunConfig
from coclo_vio.values.calibration import SensorCalibrations
from coclo_vio.values.measurements import ALL_SENSORS, Measurement
from coclo_vio.values.trajectory import GroundTruth


@dataclass(frozen=True, slots=True, eq=False)
class Recording:
    """A file or folder of measurements, and how it is read and run.

    Attributes:
        path: of the recording.
        config: the whole configuration, resolved.
    """

    path: Path
    config: RunConfig

    @property
    def name(self) -> str:
        """The last component of the path."""
        return self.path.resolve().name

    @property
    def robot(self) -> RobotDescription | None:
        """The robot: as given, otherwise a known one whose joints the recording has; None where there is none."""
        return self.config.robot

    @property
    def calibration(self) -> SensorCalibrations:
        """What the recording holds of its cameras' and IMUs' calibration; the robot's IMU where it holds none.

        Raises:
            DatasetError: a calibration is malformed.
        """
        dataset = self.dataset()
        imu = dataset.imu_calibration()
        if self.robot is not None and (imu is None or self.config.imu_calibration == "robot"):
            imu = self.robot.imu
        return SensorCalibrations(dataset.stereo_calibration(), imu, dataset.camera_imu_calibration())

    @property
    def modes(self) -> tuple[str, ...]:
        """The modes that ``compare`` runs on it.

        Raises:
            DatasetError: the recording cannot be read.
        """
        return compared_modes(self.path, self.config)

    @property
    def default_mode(self) -> str:
        """The mode that ``run`` takes.

        Raises:
            DatasetError: the recording cannot be read.
        """
        return default_mode(self.path, self.config)

    def dataset(self) -> Dataset:
        """The reader.

        Raises:
            DatasetError: the recording is malformed, or lacks joints of the robot.
        """
        return open_dataset(self.path, self.config.robot, self.config.dataset)

    def measurements(self, sensors: frozenset[type] = ALL_SENSORS) -> Iterator[Measurement]:
        """All samples of these sensors in time order, from the beginning; images are decoded as they are taken.

        Raises:
            DatasetError: the recording is malformed.
        """
        return self.dataset().measurements(sensors)

    def ground_truth(self) -> GroundTruth | None:
        """The reference trajectory of the recording, None where it has none.

        Raises:
            DatasetError: it is malformed.
        """
        return self.dataset().ground_truth()

    def inspect(self) -> Inspection:
        """What it holds, what contradicts physics in it, and which modes that is enough for.

        Raises:
            DatasetError: it cannot be read at all.
        """
        return inspect_recording(
            self.path, self.robot, self.config.dataset, lambda dataset: preflight(dataset, self.config)
        )

    def diagnose(self) -> Examination:
        """Everything that physics, the recording itself or the robot's description contradict, and what corrects it.

        Raises:
            DatasetError: it cannot be read at all.
        """
        return examine(self.path, self.config)


def open_recording(
    path: str | Path,
    robot: str | Path | RobotDescription | None = None,
    *,
    config: str | Path | None = None,
    settings: Sequence[str] = (),
) -> Recording:
    """A recording: a rosbag, an EuRoC folder, a KITTI sequence, stereo tracks or a leg log.

    Args:
        path: file or folder.
        robot: name of a known robot, path of a YAML file, or a description; a known robot whose joints the recording
            has if None.
        config: YAML file of a configuration.
        settings: single values such as ``"filter.profile=paper"``; the later wins, and all win over the file.

    Raises:
        DatasetError: no such path, or no known format; lists what was looked for.
        ConfigError: an unknown robot or key, or a value out of bounds.
    """
    path = Path(path)
    named = robot if robot is None or isinstance(robot, RobotDescription) else str(robot)
    resolved, _ = resolve_if_known(path, named, None if config is None else Path(config), settings)
    robot_fit(path, resolved.dataset)  # the path exists, and its format is known
    return Recording(path, resolved)
