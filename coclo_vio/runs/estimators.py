# SPDX-License-Identifier: BSD-3-Clause
"""The estimators that can be run, by name. A further one is one row here, one class, one test."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from coclo_vio.filter.naive import NaiveLegOdometry
from coclo_vio.filter.odometry import LegOdometryFilter
from coclo_vio.runs.equipment import Equipment
from coclo_vio.runs.run_config import RunConfig
from coclo_vio.values.errors import ConfigError, listing
from coclo_vio.values.measurements import (
    LEG_SENSORS,
    BodyTwistSample,
    CameraImuSample,
    ImuSample,
    JointSample,
    StereoFrame,
    StereoTracks,
)
from coclo_vio.values.outputs import Estimator

_EYES: frozenset[type] = frozenset({StereoFrame, StereoTracks})
_IMUS: frozenset[type] = frozenset({ImuSample, CameraImuSample})


@dataclass(frozen=True, slots=True)
class EstimatorKind:
    """One row of the registry.

    Attributes:
        summary: what it is, in a line.
        sensors: what it takes of a recording; of two IMUs a visual mode takes the one that goes with the cameras.
        make: from what a recording has and a configuration to a fresh estimator.
    """

    summary: str
    sensors: frozenset[type]
    make: Callable[[Equipment, RunConfig], Estimator]

    @property
    def has_legs(self) -> bool:
        """Whether it follows legs, so that it asks for a robot."""
        return JointSample in self.sensors

    @property
    def has_eyes(self) -> bool:
        """Whether it sees."""
        return bool(self.sensors & _EYES)

    def taken(self, equipment: Equipment) -> frozenset[type]:
        """The sensors that it takes of this equipment."""
        if self.has_legs:
            return self.sensors & (LEG_SENSORS | equipment.sensors)
        return self.sensors & equipment.sensors - (_IMUS - {equipment.eye_imu})


def _coclo(equipment: Equipment, config: RunConfig) -> Estimator:
    return LegOdometryFilter(equipment.legs(), config.filter)


def _coclo_leg_scale(equipment: Equipment, config: RunConfig) -> Estimator:
    robust = config.filter.robust.model_copy(update={"estimates_leg_scale": True})
    changed = config.filter.model_copy(update={"profile": "robust", "robust": robust})
    return LegOdometryFilter(equipment.legs(), changed)


def _coclo_paper(equipment: Equipment, config: RunConfig) -> Estimator:
    return LegOdometryFilter(equipment.legs(), config.filter.model_copy(update={"profile": "paper"}))


def _inekf(equipment: Equipment, config: RunConfig) -> Estimator:
    from coclo_vio.backend.inekf import InvariantLegOdometry  # noqa: PLC0415 -- loads GTSAM only where it is asked for

    return InvariantLegOdometry(equipment.legs(), config.inekf)


def _naive(*, rolls_feet: bool, weighs_load: bool) -> Callable[[Equipment, RunConfig], Estimator]:
    def make(equipment: Equipment, config: RunConfig) -> Estimator:
        return NaiveLegOdometry(equipment.legs(), config.filter, rolls_feet=rolls_feet, weighs_load=weighs_load)

    return make


def _visual(*, uses_imu: bool = False, uses_twist: bool = False) -> Callable[[Equipment, RunConfig], Estimator]:
    def make(equipment: Equipment, config: RunConfig) -> Estimator:
        from coclo_vio.fusion.visual_odometry import visual_odometry  # noqa: PLC0415 -- loads GTSAM and OpenCV, as _inekf

        stereo = equipment.cameras()
        kind, imu = equipment.inertial() if uses_imu else (equipment.eye_imu, equipment.eye_imu_calibration)
        if uses_twist:
            equipment.check_twist()
        return visual_odometry(
            stereo,
            config.frontend,
            config.smoother,
            imu,
            kind,
            uses_imu=uses_imu,
            uses_twist=uses_twist,
            has_frames=StereoFrame in equipment.sensors,
        )

    return make


def _combined(equipment: Equipment, config: RunConfig) -> Estimator:
    from coclo_vio.fusion.combined import combined_odometry  # noqa: PLC0415 -- loads GTSAM and OpenCV, as _inekf

    return combined_odometry(
        LegOdometryFilter(equipment.legs(), config.filter, remembers_frames=True),
        equipment.cameras(),
        config.frontend,
        config.smoother,
        config.bridge,
        has_frames=StereoFrame in equipment.sensors,
    )


ESTIMATORS: Mapping[str, EstimatorKind] = {
    "coclo": EstimatorKind(
        "contact-centric leg odometry, the configured profile (default: robust)", LEG_SENSORS, _coclo
    ),
    "coclo_leg_scale": EstimatorKind(
        "the robust profile, estimating the effective leg length", LEG_SENSORS, _coclo_leg_scale
    ),
    "coclo_paper": EstimatorKind("the paper's profile, section III as printed", LEG_SENSORS, _coclo_paper),
    "inekf": EstimatorKind("IMU-centric contact-aided filter of GTSAM, a baseline", LEG_SENSORS, _inekf),
    "naive": EstimatorKind(
        "stance feet averaged, foot centres at rest, gyroscope attitude",
        LEG_SENSORS,
        _naive(rolls_feet=False, weighs_load=False),
    ),
    "naive_rolling": EstimatorKind("naive with rolling feet", LEG_SENSORS, _naive(rolls_feet=True, weighs_load=False)),
    "naive_weighted": EstimatorKind(
        "naive with rolling feet weighed by load", LEG_SENSORS, _naive(rolls_feet=True, weighs_load=True)
    ),
    "combined": EstimatorKind(
        "legs and stereo together, each teaching the other: combined_coclo and combined_vins",
        LEG_SENSORS | _EYES,
        _combined,
    ),
    "vins": EstimatorKind("stereo and a preintegrated IMU in a sliding window", _EYES | _IMUS, _visual(uses_imu=True)),
    "stereo": EstimatorKind("stereo alone in the same window; an IMU only levels the start", _EYES | _IMUS, _visual()),
    "stereo_twist": EstimatorKind(
        "stereo, and a recorded body twist as weak odometry",
        _EYES | _IMUS | {BodyTwistSample},
        _visual(uses_twist=True),
    ),
}


def estimator_kind(name: str) -> EstimatorKind:
    """The row of an estimator.

    Raises:
        ConfigError: no such name; lists those there are.
    """
    kind = ESTIMATORS.get(name)
    if kind is None:
        raise ConfigError(f"there is no mode {name!r}; the modes are: {listing(ESTIMATORS)}")
    return kind


def make_estimator(name: str, equipment: Equipment, config: RunConfig) -> Estimator:
    """A fresh estimator.

    Raises:
        ConfigError: no such name, or legs without a robot.
        TopicNotFound: eyes without images or tracks, without the IMU or the twist that the mode is about.
        CalibrationMissing: cameras or an IMU of which nothing is known.
    """
    return estimator_kind(name).make(equipment, config)
