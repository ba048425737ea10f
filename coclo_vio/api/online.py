# SPDX-License-Identifier: BSD-3-Clause
"""Estimators for use online: no file, no pipeline."""

from pathlib import Path

from coclo_vio.online.guarded_estimator import GuardedEstimator
from coclo_vio.robot.description import RobotDescription, load_robot
from coclo_vio.robot.model import RobotModel
from coclo_vio.runs.equipment import Equipment, check_pictures
from coclo_vio.runs.guarding import guarded
from coclo_vio.runs.modes.registry import mode_of
from coclo_vio.runs.plugins import load_plugins
from coclo_vio.runs.run_config import RunConfig, resolve
from coclo_vio.values.calibration import SensorCalibrations, StereoCalibration
from coclo_vio.values.measurements import ALL_SENSORS


def make_estimator(
    mode: str,
    *,
    robot: str | Path | RobotDescription | None = None,
    calibration: SensorCalibrations | StereoCalibration | None = None,
    config: RunConfig | None = None,
    sensors: frozenset[type] = ALL_SENSORS,
    pictures_every: int | None = None,
) -> GuardedEstimator:
    """A fresh estimator: ``push`` takes one measurement and gives outputs, ``finish`` gives those held back.

    It survives what drivers do to stamps, and can be reset: docs/online.md.

    Args:
        mode: name.
        robot: name of a known robot, path of a YAML file, or a description; that of the configuration if None; none
            for the visual modes.
        calibration: of cameras and IMUs, or of the cameras alone; none for leg odometry. The body's IMU is mounted as
            the robot's description has it where this does not contain it.
        config: of all stages; the robot's own and the defaults if None.
        sensors: kinds of measurements that will come; without ``StereoFrame`` the cameras' tracks are expected.
        pictures_every: give a ``Picture`` of every n-th frame, and with them a ``WindowSnapshot`` at every keyframe
            and each ``Innovation``; none if None.

    Raises:
        ConfigError: no such mode or robot, or legs without a robot.
        CalibrationMissing: cameras or an IMU without a calibration.
        RobotModelError: the robot's description does not fit its URDF.
    """
    load_plugins()  # a robot's file may name a contact estimator of theirs
    check_pictures(pictures_every)
    described = load_robot(robot) if isinstance(robot, str | Path) else robot
    if described is None and config is not None:
        described = config.robot
    known = SensorCalibrations(stereo=calibration) if isinstance(calibration, StereoCalibration) else calibration
    known = known or SensorCalibrations()
    if described is not None and known.imu is not None:
        described = described.model_copy(update={"imu": known.imu})
    resolved = resolve(described) if config is None else config
    imu = known.imu if described is None else described.imu
    equipment = Equipment(
        None if described is None else RobotModel(described),
        imu,
        known.camera_imu,
        known.stereo,
        sensors,
        "the calibration given",
        pictures_every,
    )
    return guarded(mode_of(mode), equipment, resolved)
