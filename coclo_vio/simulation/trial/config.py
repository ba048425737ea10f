# SPDX-License-Identifier: BSD-3-Clause
"""The parameters of a trial, how the paper's trials differ from the defaults, and which of them decide the motion."""

import hashlib
import json
from collections.abc import Collection, Mapping
from typing import Annotated, Any

import mujoco
from pydantic import Field

from coclo_vio.simulation.trial.gait_controller import WaveGaitConfig
from coclo_vio.simulation.trial.imperfection import ImperfectionConfig
from coclo_vio.simulation.trial.mounting import MountingConfig
from coclo_vio.simulation.trial.physics import PushConfig
from coclo_vio.simulation.trial.robot_spec import BodyConfig
from coclo_vio.simulation.trial.sensors import CameraImuConfig, ImuConfig, JointSensorConfig
from coclo_vio.simulation.trial.slippery_ground import SlipConfig
from coclo_vio.simulation.trial.terrain import TerrainName
from coclo_vio.simulation.trial.vicon import ViconConfig
from coclo_vio.values.config import StageConfig

_MOTION_FORMAT = 1  # raised when the physics or the content of its file changes
_OF_SENSORS = ("imu", "camera_imu", "joints", "vicon", "mounting", "frame_rate_hz", "frame_delay_s")
_OF_SENSORS_IN_IMPERFECTION = (
    "joint_zero_rad",
    "camera_position_m",
    "camera_rotation_rad",
    "baseline_m",
    "baseline_rotation_rad",
    "camera_turn_rad",
    "wrong_zero_rad",
)


class TrialConfig(StageConfig):
    """Configuration of a trial, without its images."""

    stand_s: Annotated[float, Field(ge=1, le=60, description="standing at the beginning, s")] = 2.0
    end_s: Annotated[float, Field(ge=0, le=60, description="standing at the end, s")] = 1.0
    gait: Annotated[WaveGaitConfig, Field(description="how the robot walks")] = WaveGaitConfig()
    body: Annotated[BodyConfig, Field(description="joints, feet, friction")] = BodyConfig()
    slippery_tile: Annotated[
        float | None,
        Field(gt=0, le=2, description="Coulomb coefficient of a tile of 1 m beside the path; null: no tile"),
    ] = None
    slip: Annotated[SlipConfig, Field(description="areas and moments of low friction")] = SlipConfig()
    push: Annotated[PushConfig, Field(description="pushes on the trunk")] = PushConfig()
    imperfection: Annotated[ImperfectionConfig, Field(description="how the robot differs from its description")] = (
        ImperfectionConfig()
    )
    imu: Annotated[ImuConfig, Field(description="the body's IMU")] = ImuConfig()
    camera_imu: Annotated[CameraImuConfig, Field(description="the IMU inside the camera")] = CameraImuConfig()
    joints: Annotated[JointSensorConfig, Field(description="encoders and torque")] = JointSensorConfig()
    vicon: Annotated[ViconConfig, Field(description="the motion capture")] = ViconConfig()
    mounting: Annotated[MountingConfig, Field(description="extrinsics of camera and IMUs")] = MountingConfig()
    frame_rate_hz: Annotated[float, Field(gt=0.1, le=120, description="stereo frames a second, Hz")] = 15.0
    frame_delay_s: Annotated[
        float, Field(ge=0, le=0.5, description="by which the stamps of the images are late, s; nobody knows of it")
    ] = 0.0


_PRESETS: Mapping[TerrainName, Mapping[str, Mapping[str, float]]] = {
    "flat": {},
    "ramp": {"gait": {"period_s": 3.6, "speed_mps": 0.08}, "push": {"force_n": 40.0, "torque_nm": 5.0}},
    "stairs": {
        "gait": {
            "period_s": 6.0,
            "speed_mps": 0.045,
            "swing_share": 0.8,
            "vertical_speed_mps": 0.45,
            "rear_reach_m": 0.31,
            "wall_distance_m": 0.12,
        }
    },
}


def preset(name: TerrainName) -> dict[str, Any]:
    """How a trial's configuration differs from the defaults."""
    return dict(_PRESETS[name])


def motion_key(name: TerrainName, config: TrialConfig, seed: int, until_s: float | None) -> str:
    """A name for the motion of a trial: equal for trials that differ in their sensors only.

    Args:
        name: the terrain.
        config: the trial.
        seed: decides everything random.
        until_s: end of the simulation, s; None for the whole trial.
    """
    return hashed_key(name, config, _OF_SENSORS, seed, until_s)


def hashed_key(name: str, config: StageConfig, of_sensors: Collection[str], seed: int, until_s: float | None) -> str:
    """The name of a motion by the parts of a configuration that are not ``of_sensors``."""
    values = config.model_dump(mode="json", exclude=set(of_sensors))
    for field in _OF_SENSORS_IN_IMPERFECTION:
        del values["imperfection"][field]
    text = json.dumps([_MOTION_FORMAT, mujoco.__version__, name, values, seed, until_s], sort_keys=True)
    return f"{name}_{seed}_{hashlib.sha256(text.encode()).hexdigest()[:16]}"
