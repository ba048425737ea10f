# SPDX-License-Identifier: BSD-3-Clause
"""What a recording has for estimators to work with: a robot, IMUs, cameras; and which modes that is enough for."""

from dataclasses import dataclass, replace
from typing import Self

from coclo_vio.datasets.dataset import Dataset
from coclo_vio.datasets.read_report import STREAM_NAMES
from coclo_vio.robot.description import robot_names
from coclo_vio.robot.model import RobotModel
from coclo_vio.runs.fault_kinds.image_faults import halved_cameras
from coclo_vio.runs.run_config import RunConfig
from coclo_vio.runs.sensor_faults import turned_cameras, turned_imu
from coclo_vio.values.calibration import ImuCalibration, StereoCalibration
from coclo_vio.values.errors import CalibrationMissing, ConfigError, DatasetError, TopicNotFound, listing
from coclo_vio.values.measurements import (
    ALL_SENSORS,
    IMAGE_SENSORS,
    IMU_SENSORS,
    VISION_SENSORS,
    BodyTwistSample,
    CameraImuSample,
    ImuSample,
    InertialReading,
    JointSample,
    StereoFrame,
)


@dataclass(frozen=True, slots=True, eq=False)
class Equipment:
    """What there is for an estimator to work with; None where a recording holds nothing of it.

    Attributes:
        robot: whose legs they are.
        imu: mounting and noise of the body's IMU.
        camera_imu: the same of the IMU inside the camera.
        stereo: the two cameras.
        sensors: those that have samples; all where that is not known.
        name: of the recording.
        pictures_every: a mode with images draws its tracks on every n-th frame; on none if None. Where it is given,
            snapshots of the window and innovations are among the outputs too.
        notes: sentences of the reader, among them why a sensor is not read.
    """

    robot: RobotModel | None = None
    imu: ImuCalibration | None = None
    camera_imu: ImuCalibration | None = None
    stereo: StereoCalibration | None = None
    sensors: frozenset[type] = ALL_SENSORS
    name: str = "the recording"
    pictures_every: int | None = None
    notes: tuple[str, ...] = ()

    @classmethod
    def of(cls, dataset: Dataset, config: RunConfig, sensors: frozenset[type] = ALL_SENSORS) -> Self:
        """What a recording and a configuration have for a mode that reads these sensors; nothing else is read.

        Raises:
            DatasetError: a calibration is malformed.
            RobotModelError: the robot's description does not fit its URDF.
        """
        robot = None
        if config.robot is not None and JointSample in sensors:
            robot = RobotModel(config.robot)
        if not sensors & VISION_SENSORS:
            return cls(robot)
        if not sensors & (VISION_SENSORS - {CameraImuSample}):  # legs that use the camera's IMU
            camera_imu = dataset.camera_imu_calibration()
            if camera_imu is None:
                return cls(robot, sensors=ALL_SENSORS - {CameraImuSample})
            return cls(robot, camera_imu=camera_imu, sensors=sensors_of(dataset) or ALL_SENSORS)
        stereo, camera_imu = dataset.stereo_calibration(), dataset.camera_imu_calibration()
        if config.faults.turns_cameras and stereo is not None:
            turn_deg, shift_m = config.faults.camera_turn_deg, config.faults.camera_shift_m
            camera_imu = None if camera_imu is None else turned_imu(camera_imu, stereo, turn_deg, shift_m)
            stereo = turned_cameras(stereo, turn_deg, shift_m)
        if config.faults.halved_cameras and stereo is not None:
            stereo = halved_cameras(stereo)
        return cls(
            robot,
            dataset.imu_calibration() if config.robot is None else config.robot.imu,
            camera_imu,
            stereo,
            sensors_of(dataset) or ALL_SENSORS,
            dataset.name,
            notes=_notes_of(dataset),
        )

    def with_pictures(self, every: int | None) -> Self:
        """The same, with a picture of every n-th frame."""
        return replace(self, pictures_every=every)

    @property
    def has_frames(self) -> bool:
        """Whether there are images; otherwise there may be tracks."""
        return StereoFrame in self.sensors

    def require_robot(self) -> RobotModel:
        """The robot.

        Raises:
            ConfigError: there is none.
        """
        if self.robot is None:
            raise ConfigError(
                f"no robot is given: name one (robot=..., --robot) by its name or a YAML file; known robots are: "
                f"{listing(robot_names())}; visual modes need none"
            )
        return self.robot

    def require_cameras(self) -> StereoCalibration:
        """The two cameras.

        Raises:
            TopicNotFound: there are neither images nor tracks.
            CalibrationMissing: the cameras are not calibrated.
        """
        if not self.sensors & IMAGE_SENSORS:
            why = self._noted("left and right images")
            raise TopicNotFound(f"{self.name} has no stereo images{why}; coclo-vio inspect lists what it has")
        if self.stereo is None:
            raise CalibrationMissing(
                f"{self.name} has no calibration of its cameras: give it in cam0/sensor.yaml and cam1/sensor.yaml of "
                "an EuRoC folder, in CameraInfo and /tf_static of a bag or a camchain of Kalibr "
                "(dataset.rosbag.kalibr.camchain), or in calib.txt of a KITTI sequence"
            )
        return self.stereo

    def require_vision_imu(self) -> tuple[type[InertialReading], ImuCalibration]:
        """The IMU that goes with the cameras, and its calibration.

        Raises:
            TopicNotFound: no IMU was recorded.
            CalibrationMissing: its mounting is not known.
        """
        if not self.sensors & IMU_SENSORS:
            why = self._noted("only half of one")
            what = "half an IMU" if why else "no IMU"
            raise TopicNotFound(f"{self.name} has {what}{why}; a mode of stereo alone needs none")
        known = self.known_vision_imu
        if known is None:
            raise CalibrationMissing(
                f"{self.name} has no mounting of its IMU: give it in imu0/sensor.yaml (the camera's own: "
                "imu1/sensor.yaml) of an EuRoC folder, in /tf_static of a bag or a camchain of Kalibr "
                "(dataset.rosbag.kalibr), or under imu: of a robot's YAML; a mode of stereo alone needs none"
            )
        return known

    def _noted(self, words: str) -> str:
        """The reader's sentence with these words, to follow what is missing; empty where there is none."""
        return next((f" ({note})" for note in self.notes if words in note), "")

    def require_body_twist(self) -> None:
        """Make sure that there are body twists.

        Raises:
            TopicNotFound: there are none.
        """
        if BodyTwistSample not in self.sensors:
            raise TopicNotFound(f"{self.name} has no body twist; a mode of stereo alone needs none")

    @property
    def second_imu(self) -> ImuCalibration | None:
        """The calibration of the camera's IMU where it is there, for use beside the body's."""
        return self.camera_imu if CameraImuSample in self.sensors else None

    @property
    def vision_imu(self) -> type[InertialReading] | None:
        """Which IMU goes with the cameras: their own where it is there and its mounting known, otherwise the body's."""
        if CameraImuSample in self.sensors and self.camera_imu is not None:
            return CameraImuSample
        return ImuSample if ImuSample in self.sensors and self.imu is not None else None

    @property
    def known_vision_imu(self) -> tuple[type[InertialReading], ImuCalibration] | None:
        """``vision_imu`` with its calibration; None where there is none."""
        kind = self.vision_imu
        calibration = self.camera_imu if kind is CameraImuSample else self.imu
        return None if kind is None or calibration is None else (kind, calibration)


def check_pictures(every: int | None) -> None:
    """See that there can be a picture of every n-th frame.

    Raises:
        ConfigError: n is below 1.
    """
    if every is not None and every < 1:
        raise ConfigError(f"pictures_every = {every}: give 1 for a picture of every frame, or a larger number")


def sensors_of(dataset: Dataset) -> frozenset[type]:
    """The sensors that have samples in a recording; none where it cannot be read through."""
    try:
        streams = {stream.name for stream in dataset.report().streams}
    except DatasetError:  # whoever reads it reports the error, and keeps what comes before
        return frozenset()
    return frozenset(kind for kind, name in STREAM_NAMES.items() if name in streams)


def _notes_of(dataset: Dataset) -> tuple[str, ...]:
    try:
        return dataset.report().notes
    except DatasetError:  # as in ``sensors_of``
        return ()
