# SPDX-License-Identifier: BSD-3-Clause
"""A trial from a name, a configuration and a seed: what the sensors said, what Vicon saw, and what was true."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Annotated, Any

import mujoco
import numpy as np
from pydantic import Field

from coclo_vio.robot.description import RobotDescription
from coclo_vio.robot.model import RobotModel
from coclo_vio.simulation.trial.imperfection import Imperfection, ImperfectionConfig, draw_imperfection
from coclo_vio.simulation.trial.mounting import MountingConfig, disturbed
from coclo_vio.simulation.trial.physics import Laboratory, Motion, PushConfig
from coclo_vio.simulation.trial.robot_spec import BodyConfig, add_imu, make_spec
from coclo_vio.simulation.trial.sensors import (
    EPOCH_NS,
    CameraImuConfig,
    ImuConfig,
    ImuTruth,
    JointSensorConfig,
    at_times,
    calibration,
    imu_readings,
    joint_samples,
    sample_times,
)
from coclo_vio.simulation.trial.terrain import Terrain, TerrainName, make_terrain
from coclo_vio.simulation.trial.tile import Tile
from coclo_vio.simulation.trial.vicon import ViconConfig, watch
from coclo_vio.simulation.trial.walker import GaitConfig, Walker
from coclo_vio.simulation.trial.walkway import Walkway
from coclo_vio.values.arrays import Array, BoolArray, IntArray
from coclo_vio.values.calibration import ImuCalibration, StereoCalibration
from coclo_vio.values.config import StageConfig
from coclo_vio.values.measurements import CameraImuSample, ImuSample, JointSample, Measurement
from coclo_vio.values.trajectory import GroundTruth, Trajectory

BODY_IMU, CAMERA_IMU = "imu", "camera_imu"
_TOUCHES_N = 1.0  # a foot with more force on it is in contact
_STREAMS = ("imperfection", "gait", "push", "imu", "camera_imu", "joints", "vicon")


class TrialConfig(StageConfig):
    """Everything of a trial but its pictures."""

    stand_s: Annotated[float, Field(ge=1, le=60, description="standing at the beginning, s")] = 2.0
    end_s: Annotated[float, Field(ge=0, le=60, description="standing at the end, s")] = 1.0
    gait: Annotated[GaitConfig, Field(description="how the robot walks")] = GaitConfig()
    body: Annotated[BodyConfig, Field(description="joints, feet, friction")] = BodyConfig()
    slippery_tile: Annotated[
        float | None,
        Field(gt=0, le=2, description="Coulomb coefficient of a tile, 1 m long, amid the way; null: as everywhere"),
    ] = None
    push: Annotated[PushConfig, Field(description="pushes on the trunk")] = PushConfig()
    imperfection: Annotated[ImperfectionConfig, Field(description="how the robot differs from its description")] = (
        ImperfectionConfig()
    )
    imu: Annotated[ImuConfig, Field(description="the body's IMU")] = ImuConfig()
    camera_imu: Annotated[CameraImuConfig, Field(description="the IMU inside the camera")] = CameraImuConfig()
    joints: Annotated[JointSensorConfig, Field(description="encoders and torque")] = JointSensorConfig()
    vicon: Annotated[ViconConfig, Field(description="the motion capture")] = ViconConfig()
    mounting: Annotated[MountingConfig, Field(description="where camera and IMUs sit")] = MountingConfig()
    frame_rate_hz: Annotated[float, Field(gt=0.1, le=120, description="stereo frames a second, Hz")] = 15.0


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


@dataclass(frozen=True, slots=True, eq=False)
class Truth:
    """What no estimator may read.

    Attributes:
        trajectory: the body at the joints' stamps, world of the terrain, with velocity.
        contact: which feet touch the ground, at the physics' steps, (N, legs).
        contact_ns: the stamps of those steps, (N,).
        imu: the true biases of the body's IMU.
        camera_imu: those of the camera's IMU.
        stereo: the cameras where they truly are.
        imperfection: how this robot differs from its description.
        vicon_offset_s: how far Vicon's clock is ahead of the robot's.
        self_contacts: control periods in which a leg touched another.
        ground_contacts: control periods in which a leg, not its foot, touched the ground.
        deepest_m: the deepest that any body sank into another, m.
        tile: where the ground is slippery, if anywhere.
        on_tile_s: when a foot first and last stood there, s after the beginning.
    """

    trajectory: Trajectory
    contact: BoolArray
    contact_ns: IntArray
    imu: ImuTruth
    camera_imu: ImuTruth
    stereo: StereoCalibration
    imperfection: Imperfection
    vicon_offset_s: float
    self_contacts: int
    ground_contacts: int
    deepest_m: float
    tile: Tile | None = None
    on_tile_s: tuple[float, float] | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Trial:
    """A simulated trial but for its pictures, which are rendered from ``spec`` at ``frame_qpos``.

    Attributes:
        terrain: the ground.
        robot: the description that estimators get.
        measurements: both IMUs and the joints, in time order.
        vicon: the body as the motion capture reports it.
        imu: what is known of the body's IMU.
        camera_imu: what is known of the camera's IMU.
        stereo: what is known of the cameras.
        frame_ns: stamps of the stereo frames, (F,).
        frame_qpos: the model's coordinates then, (F, nq).
        frame_qvel: its velocities, (F, nv).
        spec: the robot on its terrain, without anything to see.
        truth: what was true.
    """

    terrain: Terrain
    robot: RobotDescription
    measurements: tuple[Measurement, ...]
    vicon: GroundTruth
    imu: ImuCalibration
    camera_imu: ImuCalibration
    stereo: StereoCalibration
    frame_ns: IntArray
    frame_qpos: Array
    frame_qvel: Array
    spec: mujoco.MjSpec
    truth: Truth


def preset(name: TerrainName) -> dict[str, Any]:
    """What a trial's configuration changes of the defaults."""
    return dict(_PRESETS[name])


def simulate(
    name: TerrainName,
    robot: RobotDescription,
    config: TrialConfig,
    seed: int,
    *,
    until_s: float | None = None,
    progress: Callable[[float], None] | None = None,
) -> Trial:
    """Walk a trial; the same arguments give the same values.

    Args:
        name: the terrain.
        robot: the described robot; the one that walks differs from it by ``config.imperfection``.
        config: the trial.
        seed: decides everything random.
        until_s: cut the trial short after so many seconds.
        progress: called with the simulated time (s) now and then.

    Raises:
        SimulationError: the robot fell or stuck.
    """
    streams = dict(zip(_STREAMS, np.random.SeedSequence(seed).spawn(len(_STREAMS)), strict=True))
    random = {stream: np.random.default_rng(sequence) for stream, sequence in streams.items()}
    model, terrain = RobotModel(robot), make_terrain(name)
    imperfection = draw_imperfection(
        config.imperfection, len(robot.legs), len(robot.joint_names), random["imperfection"]
    )
    spec = make_spec(robot, config.body, imperfection, terrain)
    nominal = config.mounting.stereo()
    true_stereo = disturbed(nominal, imperfection)
    T_body_imu, T_left_imu = config.mounting.T_body_imu, config.mounting.T_left_camera_imu
    add_imu(spec, BODY_IMU, T_body_imu)
    add_imu(spec, CAMERA_IMU, true_stereo.T_body_left_camera @ T_left_imu)
    tile = _slippery_tile(terrain, config)
    laboratory = Laboratory(spec.compile(), model, (BODY_IMU, CAMERA_IMU), tile)
    walker = Walker(model, terrain, config.gait, laboratory.spring, random["gait"], config.stand_s)
    motion = laboratory.walk(walker, config.end_s, config.push, random["push"], until_s=until_s, progress=progress)

    imu, imu_truth = imu_readings(ImuSample, motion, BODY_IMU, config.imu, random["imu"])
    camera_imu, camera_imu_truth = imu_readings(
        CameraImuSample, motion, CAMERA_IMU, config.camera_imu, random["camera_imu"]
    )
    joints = list(joint_samples(motion, config.joints, imperfection, random["joints"]))
    watched, offset_s = watch(motion, config.vicon, random["vicon"])
    frame_ns, offsets = sample_times(float(motion.time_s[-1]), config.frame_rate_hz)
    truth = Truth(
        trajectory=_trajectory(motion, np.array([sample.stamp_ns for sample in joints])),
        contact=motion.foot_force > _TOUCHES_N,
        contact_ns=EPOCH_NS + np.round(motion.time_s * 1e9).astype(np.int64),
        imu=imu_truth,
        camera_imu=camera_imu_truth,
        stereo=true_stereo,
        imperfection=imperfection,
        vicon_offset_s=offset_s,
        self_contacts=motion.self_contacts,
        ground_contacts=motion.ground_contacts,
        deepest_m=motion.deepest_m,
        tile=tile,
        on_tile_s=motion.on_tile_s,
    )
    return Trial(
        terrain=terrain,
        robot=robot,
        measurements=tuple(_in_time_order(imu, joints, camera_imu)),
        vicon=watched,
        imu=calibration(config.imu, T_body_imu),
        camera_imu=calibration(config.camera_imu, nominal.T_body_left_camera @ T_left_imu),
        stereo=nominal,
        frame_ns=frame_ns,
        frame_qpos=at_times(motion.time_s, motion.qpos, offsets),
        frame_qvel=at_times(motion.time_s, motion.qvel, offsets),
        spec=spec,
        truth=truth,
    )


def _slippery_tile(terrain: Terrain, config: TrialConfig) -> Tile | None:
    if config.slippery_tile is None:
        return None
    gait = config.gait
    return Tile.amid(Walkway(terrain, gait.speed_mps, gait.turn_rate_radps, gait.height_m), config.slippery_tile)


def _in_time_order(
    imu: list[ImuSample], joints: list[JointSample], camera_imu: list[CameraImuSample]
) -> list[Measurement]:
    """Merged by stamp; at one stamp IMU, joints, camera IMU."""
    return sorted([*imu, *joints, *camera_imu], key=lambda sample: sample.stamp_ns)


def _trajectory(motion: Motion, stamps_ns: IntArray) -> Trajectory:
    """The body at stamps that are steps of the physics."""
    step_s = motion.time_s[1] - motion.time_s[0]
    steps = np.round((stamps_ns - EPOCH_NS) / 1e9 / step_s).astype(np.int64)
    return Trajectory(stamps_ns, motion.T_world_body[steps], motion.velocity_world[steps])
