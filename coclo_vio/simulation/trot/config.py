# SPDX-License-Identifier: BSD-3-Clause
"""The parameters of a trot, how robots and grounds differ from the defaults, and which of them decide the motion."""

from typing import Annotated, Any

from pydantic import Field

from coclo_vio.robot.description import RobotDescription
from coclo_vio.simulation.trial.mounting import MountingConfig
from coclo_vio.simulation.trial.physics import PushConfig
from coclo_vio.simulation.trial.sensors import CameraImuConfig, ImuConfig, JointSensorConfig
from coclo_vio.simulation.trial.slippery_ground import SlipConfig
from coclo_vio.simulation.trial.vicon import ViconConfig
from coclo_vio.simulation.trot.foot_sensor import FootSensorConfig
from coclo_vio.simulation.trot.ground import GroundName
from coclo_vio.simulation.trot.quadruped import QUADRUPED_PARTS, QuadrupedName
from coclo_vio.simulation.trot.quadruped_spec import TrotBodyConfig
from coclo_vio.simulation.trot.trot_gait import TrotGaitConfig
from coclo_vio.simulation.trot.trot_imperfection import TrotImperfectionConfig
from coclo_vio.values.config import StageConfig

_TILT_RAD = 0.12  # of the camera, downwards


class TrotImuConfig(ImuConfig):
    """The IMU in the trunk, read as often as the joints; impacts of trotting feet need a range of 8 g."""

    rate_hz: Annotated[float, Field(gt=1, le=1000, description="samples a second, Hz")] = 500.0
    low_pass_hz: Annotated[float, Field(gt=1, lt=500, description="-3 dB bandwidth before sampling, Hz")] = 150.0
    accelerometer_range_mps2: Annotated[float, Field(gt=0, description="beyond it readings saturate (8 g)")] = 78.5


class TrotCameraImuConfig(CameraImuConfig):
    """The IMU in the camera."""

    accelerometer_range_mps2: Annotated[float, Field(gt=0, description="beyond it readings saturate (8 g)")] = 78.5


class TrotJointsConfig(JointSensorConfig):
    """Encoders and torques of motors with a small gear ratio: torque from the current."""

    rate_hz: Annotated[float, Field(gt=1, le=1000, description="samples a second, Hz")] = 500.0
    velocity_noise_radps: Annotated[float, Field(ge=0, description="white, a sample")] = 0.05
    effort_noise_nm: Annotated[float, Field(ge=0, description="white, a sample")] = 0.1
    effort_offset_nm: Annotated[float, Field(ge=0, description="standard deviation, each joint, constant")] = 0.2
    effort_low_pass_hz: Annotated[float, Field(gt=1, lt=500, description="first order, Hz")] = 100.0
    has_velocity: Annotated[bool, Field(description="whether the recording holds joint velocities")] = True
    has_effort: Annotated[bool, Field(description="whether the recording holds joint torques")] = True


class TrotConfig(StageConfig):
    """Configuration of a trot, without its images."""

    robot: Annotated[QuadrupedName, Field(description="which quadruped")] = "go1"
    ground: Annotated[GroundName, Field(description="what it trots on")] = "flat"
    stand_s: Annotated[float, Field(ge=1, le=60, description="standing at the beginning, s")] = 2.0
    end_s: Annotated[float, Field(ge=0, le=60, description="standing at the end, s")] = 1.0
    gait: Annotated[TrotGaitConfig, Field(description="how the robot trots")] = TrotGaitConfig()
    body: Annotated[TrotBodyConfig, Field(description="joints, feet, friction")] = TrotBodyConfig()
    slip: Annotated[SlipConfig, Field(description="areas and moments of low friction")] = SlipConfig()
    push: Annotated[PushConfig, Field(description="pushes on the trunk")] = PushConfig()
    imperfection: Annotated[TrotImperfectionConfig, Field(description="how the robot differs from its description")] = (
        TrotImperfectionConfig()
    )
    imu: Annotated[TrotImuConfig, Field(description="the body's IMU")] = TrotImuConfig()
    camera_imu: Annotated[TrotCameraImuConfig, Field(description="the IMU inside the camera")] = TrotCameraImuConfig()
    joints: Annotated[TrotJointsConfig, Field(description="encoders and torque")] = TrotJointsConfig()
    feet: Annotated[FootSensorConfig, Field(description="sensors of foot force")] = FootSensorConfig()
    vicon: Annotated[ViconConfig, Field(description="the motion capture")] = ViconConfig()
    mounting: Annotated[MountingConfig, Field(description="extrinsics of camera and IMUs")] = MountingConfig()
    frame_rate_hz: Annotated[float, Field(gt=0.1, le=120, description="stereo frames a second, Hz")] = 15.0
    frame_delay_s: Annotated[
        float, Field(ge=0, le=0.5, description="by which the stamps of the images are late, s; nobody knows of it")
    ] = 0.0


OF_SENSORS = ("imu", "camera_imu", "joints", "feet", "vicon", "mounting", "frame_rate_hz", "frame_delay_s")
"""The parts of ``TrotConfig`` that do not change the motion."""


def trot_preset(robot: RobotDescription, name: QuadrupedName, ground: GroundName) -> dict[str, Any]:
    """How a trot's configuration differs from the defaults."""
    parts = QUADRUPED_PARTS[name]
    values: dict[str, Any] = {
        "robot": name,
        "ground": ground,
        "body": {
            "armature_kgm2": parts.armature_kgm2,
            "joint_damping": parts.damping,
            "dry_friction_nm": parts.dry_friction_nm,
        },
        "feet": {"is_present": parts.has_foot_sensors},
        "mounting": {
            "camera_position_m": parts.camera_position_m,
            "camera_pitch_rad": _TILT_RAD,
            "imu_position_m": robot.imu.position_body_m,
            "imu_rotation_rpy_rad": robot.imu.rotation_body_imu_rpy_rad,
        },
    }
    if ground == "rough":
        values["gait"] = {"clearance_m": 0.09}
    if ground == "stairs":
        values["gait"] = {"speed_mps": 0.4}
    if ground == "slippery":
        values["slip"] = {"patches_per_m2": 0.8, "patch_radius_m": 0.3, "patch_friction": 0.18}
    return values
