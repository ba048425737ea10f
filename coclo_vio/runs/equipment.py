# SPDX-License-Identifier: BSD-3-Clause
"""What a recording is equipped with: a robot, IMUs, cameras; and which modes that is enough for by default."""

from dataclasses import dataclass
from pathlib import Path
from typing import Self

from coclo_vio.datasets.dataset import Dataset, open_dataset, robot_fit
from coclo_vio.datasets.read_report import STREAM_NAMES
from coclo_vio.robot.description import robot_names
from coclo_vio.robot.model import RobotModel
from coclo_vio.runs.run_config import RunConfig
from coclo_vio.values.calibration import ImuCalibration, StereoCalibration
from coclo_vio.values.errors import CalibrationMissing, ConfigError, DatasetError, TopicNotFound, listing
from coclo_vio.values.measurements import (
    ALL_SENSORS,
    VISION_SENSORS,
    BodyTwistSample,
    CameraImuSample,
    ImuSample,
    InertialReading,
    JointSample,
    StereoFrame,
    StereoTracks,
)

LEG_MODES = ("coclo", "coclo_paper", "inekf", "naive")
_EYES: frozenset[type] = frozenset({StereoFrame, StereoTracks})


@dataclass(frozen=True, slots=True, eq=False)
class Equipment:
    """What there is for an estimator to work with; None where a recording says nothing of it.

    Attributes:
        robot: whose legs they are.
        imu: mounting and noise of the body's IMU.
        camera_imu: the same of the IMU inside the camera.
        stereo: the two cameras.
        sensors: those that have samples; all where that is not known.
        name: of the recording.
    """

    robot: RobotModel | None = None
    imu: ImuCalibration | None = None
    camera_imu: ImuCalibration | None = None
    stereo: StereoCalibration | None = None
    sensors: frozenset[type] = ALL_SENSORS
    name: str = "the recording"

    @classmethod
    def of(cls, dataset: Dataset, config: RunConfig, wanted: frozenset[type] = ALL_SENSORS) -> Self:
        """What a recording and a configuration have for a mode that wants these sensors; of others nothing is read.

        Raises:
            DatasetError: a calibration is malformed.
            RobotModelError: the robot's description does not fit its URDF.
        """
        robot = None
        if config.robot is not None and JointSample in wanted:
            robot = RobotModel(config.robot)
        if not wanted & VISION_SENSORS:
            return cls(robot)
        return cls(
            robot,
            dataset.imu_calibration() if config.robot is None else config.robot.imu,
            dataset.camera_imu_calibration(),
            dataset.stereo_calibration(),
            _sensors_of(dataset) or ALL_SENSORS,
            dataset.name,
        )

    def legs(self) -> RobotModel:
        """The robot.

        Raises:
            ConfigError: there is none.
        """
        if self.robot is None:
            raise ConfigError(
                f"which robot is it? Give --robot NAME or a YAML file; known robots are: {listing(robot_names())}; "
                "the modes vins and stereo need none"
            )
        return self.robot

    def cameras(self) -> StereoCalibration:
        """The two cameras.

        Raises:
            TopicNotFound: there are neither images nor tracks.
            CalibrationMissing: nothing is known of the cameras.
        """
        if not self.sensors & _EYES:
            raise TopicNotFound(f"{self.name} has no stereo images to see with; coclo-vio inspect says what it has")
        if self.stereo is None:
            raise CalibrationMissing(
                f"{self.name} does not say how its cameras are made and mounted: that stands in cam0/sensor.yaml and "
                "cam1/sensor.yaml of an EuRoC folder, in CameraInfo and /tf_static of a bag or a camchain of Kalibr "
                "(dataset.rosbag.kalibr.camchain), in calib.txt of a KITTI sequence"
            )
        return self.stereo

    def inertial(self) -> tuple[type[InertialReading], ImuCalibration]:
        """The IMU that goes with the cameras, and what is known of it.

        Raises:
            TopicNotFound: no IMU was recorded.
            CalibrationMissing: nothing is known of its mounting.
        """
        kind, calibration = self.eye_imu, self.eye_imu_calibration
        if not self.sensors & {ImuSample, CameraImuSample}:
            raise TopicNotFound(f"{self.name} has no IMU; the mode stereo does without")
        if kind is None or calibration is None:
            raise CalibrationMissing(
                f"{self.name} does not say how its IMU is mounted: that stands in imu0/sensor.yaml (the camera's own: "
                "imu1/sensor.yaml) of an EuRoC folder, in /tf_static of a bag or a camchain of Kalibr "
                "(dataset.rosbag.kalibr), under imu: of a robot's YAML; the mode stereo does without"
            )
        return kind, calibration

    def check_twist(self) -> None:
        """Make sure that there are body twists.

        Raises:
            TopicNotFound: there are none.
        """
        if BodyTwistSample not in self.sensors:
            raise TopicNotFound(f"{self.name} has no body twist; the mode stereo does without")

    @property
    def eye_imu(self) -> type[InertialReading] | None:
        """Which IMU goes with the cameras: their own where it is there and its mounting known, otherwise the body's."""
        if CameraImuSample in self.sensors and self.camera_imu is not None:
            return CameraImuSample
        return ImuSample if ImuSample in self.sensors and self.imu is not None else None

    @property
    def eye_imu_calibration(self) -> ImuCalibration | None:
        """What is known of ``eye_imu``."""
        if self.eye_imu is None:
            return None
        return self.camera_imu if self.eye_imu is CameraImuSample else self.imu


def default_mode(path: Path, config: RunConfig) -> str:
    """The mode that suits a recording best: legs and eyes together, or whichever it has.

    Raises:
        DatasetError: no such path, or no known format.
    """
    has_named_joints = config.robot is not None and bool(robot_fit(path, config.dataset).joints)
    if not has_named_joints:
        return compared_modes(path, config)[0]
    return "combined" if "combined" in compared_modes(path, config) else "coclo"


def compared_modes(path: Path, config: RunConfig) -> tuple[str, ...]:
    """The modes that suit a recording: those of its legs, of eyes whose calibration is known, and of both.

    Raises:
        DatasetError: no such path, or no known format.
    """
    dataset = open_dataset(path, config.robot, config.dataset)
    sensors = _sensors_of(dataset)
    has_legs = config.robot is not None and JointSample in sensors
    if not sensors & _EYES:
        return LEG_MODES
    inertial = ("vins",) if sensors & {ImuSample, CameraImuSample} else ()
    if has_legs:
        stereo, imu = _calibrated(dataset, config)
        return (*LEG_MODES, *(inertial if stereo and imu else ()), *(("combined",) if stereo else ()))
    return (*inertial, "stereo", *(("stereo_twist",) if BodyTwistSample in sensors else ()))


def _calibrated(dataset: Dataset, config: RunConfig) -> tuple[bool, bool]:
    """Whether a visual mode would know its cameras, and its IMU."""
    try:
        equipment = Equipment.of(dataset, config, VISION_SENSORS)
    except DatasetError:
        return False, False
    return equipment.stereo is not None, equipment.eye_imu is not None


def _sensors_of(dataset: Dataset) -> frozenset[type]:
    """The sensors that have samples in a recording; none where it cannot be read through."""
    try:
        streams = {stream.name for stream in dataset.report().streams}
    except DatasetError:  # whoever reads it tells of it, and keeps what comes before
        return frozenset()
    return frozenset(kind for kind, name in STREAM_NAMES.items() if name in streams)
