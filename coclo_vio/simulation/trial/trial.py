# SPDX-License-Identifier: BSD-3-Clause
"""A trial from a name, a configuration and a seed: measurements, motion capture, and the truth."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Annotated, Any

import mujoco
import numpy as np
from pydantic import Field

from coclo_vio.robot.description import RobotDescription
from coclo_vio.robot.model import RobotModel
from coclo_vio.simulation.trial.gait_controller import GaitController, WaveGaitConfig, planned_path
from coclo_vio.simulation.trial.imperfection import Imperfection, ImperfectionConfig, draw_imperfection
from coclo_vio.simulation.trial.mounting import MountingConfig, perturbed
from coclo_vio.simulation.trial.physics import Motion, PushConfig, Simulator
from coclo_vio.simulation.trial.robot_spec import BodyConfig, add_imu, make_spec
from coclo_vio.simulation.trial.sensors import (
    EPOCH_NS,
    CameraImuConfig,
    ImuConfig,
    ImuTruth,
    JointSensorConfig,
    imu_readings,
    interpolated_at,
    joint_samples,
    nominal_calibration,
    sample_times,
)
from coclo_vio.simulation.trial.slippery_tile import SlipperyTile
from coclo_vio.simulation.trial.terrain import Terrain, TerrainName, make_terrain
from coclo_vio.simulation.trial.vicon import ViconConfig, vicon_poses
from coclo_vio.values.arrays import Array, BoolArray, IntArray
from coclo_vio.values.calibration import ImuCalibration, StereoCalibration
from coclo_vio.values.config import StageConfig
from coclo_vio.values.measurements import CameraImuSample, ImuSample, JointSample, Measurement
from coclo_vio.values.trajectory import GroundTruth, Trajectory
from coclo_vio.values.units import NS_PER_S

BODY_IMU, CAMERA_IMU = "imu", "camera_imu"
_CONTACT_FORCE_N = 1.0  # a foot with a larger normal force is in contact
_STREAMS = ("imperfection", "gait", "push", "imu", "camera_imu", "joints", "vicon")


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
    """The truth of a trial, which no estimator may read.

    Attributes:
        trajectory: the body at the joints' stamps, world of the terrain, with velocity.
        contact: which feet touch the ground, at the physics' steps, (N, legs).
        contact_ns: the stamps of those steps, (N,).
        imu: the true biases of the body's IMU.
        camera_imu: those of the camera's IMU.
        stereo: the true calibration of the cameras.
        imperfection: how this robot differs from its description.
        vicon_offset_s: time by which Vicon's clock is ahead of the robot's, s.
        self_contacts: control periods in which a leg touched another.
        ground_contacts: control periods in which a leg, not its foot, touched the ground.
        max_penetration_m: largest penetration of two bodies in contact, m.
        tile: the slippery tile, if there is one.
        on_tile_s: first and last time of a foot on it, s after the beginning.
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
    max_penetration_m: float
    tile: SlipperyTile | None = None
    on_tile_s: tuple[float, float] | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Trial:
    """A simulated trial without its images, which are rendered from ``spec`` at ``frame_qpos``.

    Attributes:
        terrain: the ground.
        robot: the description that estimators use.
        measurements: both IMUs and the joints, in time order.
        vicon: the body as the motion capture measures it.
        imu: nominal calibration of the body's IMU.
        camera_imu: nominal calibration of the camera's IMU.
        stereo: nominal calibration of the cameras.
        frame_ns: stamps of the stereo frames, (F,).
        frame_qpos: the model's coordinates at the frames, (F, nq).
        frame_qvel: its velocities, (F, nv).
        spec: the robot on its terrain, without textures and cameras.
        truth: the truth.
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
    """How a trial's configuration differs from the defaults."""
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
    generators = _generators(seed)
    model = RobotModel(robot, is_compiled=False)  # contacts make much of rounding: the same bytes without numba
    terrain = make_terrain(name)
    imperfection = draw_imperfection(
        config.imperfection, len(robot.legs), len(robot.joint_names), generators["imperfection"]
    )
    stereo = perturbed(config.mounting.stereo(), imperfection)
    spec = make_spec(robot, config.body, imperfection, terrain)
    add_imu(spec, BODY_IMU, config.mounting.T_body_imu)
    add_imu(spec, CAMERA_IMU, stereo.T_body_left_camera @ config.mounting.T_left_camera_imu)
    tile = _slippery_tile(terrain, config)
    simulator = Simulator(spec.compile(), model, (BODY_IMU, CAMERA_IMU), tile)
    controller = GaitController(model, terrain, config.gait, simulator.spring, generators["gait"], config.stand_s)
    motion = simulator.walk(
        controller, config.end_s, config.push, generators["push"], until_s=until_s, progress=progress
    )
    readings = _read_sensors(motion, config, imperfection, generators)
    truth = _truth(motion, readings, stereo, imperfection, tile)
    return _trial(terrain, robot, config, motion, readings, spec, truth)


def _trial(
    terrain: Terrain,
    robot: RobotDescription,
    config: TrialConfig,
    motion: Motion,
    readings: "_Readings",
    spec: mujoco.MjSpec,
    truth: Truth,
) -> Trial:
    """The readings with nominal calibrations and the states at the frames."""
    mounting = config.mounting
    nominal = mounting.stereo()
    frame_ns, offsets_ns = sample_times(float(motion.time_s[-1]), config.frame_rate_hz)
    return Trial(
        terrain=terrain,
        robot=robot,
        measurements=readings.in_time_order(),
        vicon=readings.vicon,
        imu=nominal_calibration(config.imu, mounting.T_body_imu),
        camera_imu=nominal_calibration(config.camera_imu, nominal.T_body_left_camera @ mounting.T_left_camera_imu),
        stereo=nominal,
        frame_ns=frame_ns,
        frame_qpos=interpolated_at(motion.time_s, motion.qpos, offsets_ns),
        frame_qvel=interpolated_at(motion.time_s, motion.qvel, offsets_ns),
        spec=spec,
        truth=truth,
    )


def _generators(seed: int) -> dict[str, np.random.Generator]:
    """An independent random generator for each part of a trial."""
    sequences = np.random.SeedSequence(seed).spawn(len(_STREAMS))
    return {stream: np.random.default_rng(sequence) for stream, sequence in zip(_STREAMS, sequences, strict=True)}


@dataclass(frozen=True, slots=True, eq=False)
class _Readings:
    """The readings of all sensors, and the truth behind them."""

    imu: list[ImuSample]
    imu_truth: ImuTruth
    camera_imu: list[CameraImuSample]
    camera_imu_truth: ImuTruth
    joints: list[JointSample]
    vicon: GroundTruth
    vicon_offset_s: float

    def in_time_order(self) -> tuple[Measurement, ...]:
        """Merged by stamp; at one stamp IMU, joints, camera IMU."""
        return tuple(sorted([*self.imu, *self.joints, *self.camera_imu], key=lambda sample: sample.stamp_ns))


def _read_sensors(
    motion: Motion, config: TrialConfig, imperfection: Imperfection, generators: Mapping[str, np.random.Generator]
) -> _Readings:
    imu, imu_truth = imu_readings(ImuSample, motion, BODY_IMU, config.imu, generators["imu"])
    camera_imu, camera_imu_truth = imu_readings(
        CameraImuSample, motion, CAMERA_IMU, config.camera_imu, generators["camera_imu"]
    )
    joints = list(joint_samples(motion, config.joints, imperfection, generators["joints"]))
    vicon, vicon_offset_s = vicon_poses(motion, config.vicon, generators["vicon"])
    return _Readings(imu, imu_truth, camera_imu, camera_imu_truth, joints, vicon, vicon_offset_s)


def _truth(
    motion: Motion,
    readings: _Readings,
    stereo: StereoCalibration,
    imperfection: Imperfection,
    tile: SlipperyTile | None,
) -> Truth:
    return Truth(
        trajectory=_trajectory(motion, np.array([sample.stamp_ns for sample in readings.joints])),
        contact=motion.foot_force > _CONTACT_FORCE_N,
        contact_ns=EPOCH_NS + np.round(motion.time_s * NS_PER_S).astype(np.int64),
        imu=readings.imu_truth,
        camera_imu=readings.camera_imu_truth,
        stereo=stereo,
        imperfection=imperfection,
        vicon_offset_s=readings.vicon_offset_s,
        self_contacts=motion.self_contacts,
        ground_contacts=motion.ground_contacts,
        max_penetration_m=motion.max_penetration_m,
        tile=tile,
        on_tile_s=motion.on_tile_s,
    )


def _slippery_tile(terrain: Terrain, config: TrialConfig) -> SlipperyTile | None:
    if config.slippery_tile is None:
        return None
    return SlipperyTile.on_path(planned_path(terrain, config.gait), config.slippery_tile)


def _trajectory(motion: Motion, stamps_ns: IntArray) -> Trajectory:
    """The body at stamps that are steps of the physics."""
    step_s = motion.time_s[1] - motion.time_s[0]
    steps = np.round((stamps_ns - EPOCH_NS) / NS_PER_S / step_s).astype(np.int64)
    return Trajectory(stamps_ns, motion.T_world_body[steps], motion.velocity_world[steps])
