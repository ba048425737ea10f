# SPDX-License-Identifier: BSD-3-Clause
"""A trial from a name, a configuration and a seed: measurements, motion capture, and the truth."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import mujoco
import numpy as np

from coclo_vio.robot.description import RobotDescription
from coclo_vio.simulation.trial.config import TrialConfig
from coclo_vio.simulation.trial.imperfection import Imperfection
from coclo_vio.simulation.trial.motion import Motion
from coclo_vio.simulation.trial.mounting import MountingConfig, perturbed
from coclo_vio.simulation.trial.sensors import (
    EPOCH_NS,
    ImuConfig,
    ImuTruth,
    JointSensorConfig,
    imu_readings,
    interpolated_at,
    joint_samples,
    nominal_calibration,
    sample_times,
)
from coclo_vio.simulation.trial.slippery_ground import SlipperyGround
from coclo_vio.simulation.trial.slippery_tile import SlipperyTile
from coclo_vio.simulation.trial.terrain import TerrainName
from coclo_vio.simulation.trial.vicon import ViconConfig, vicon_poses
from coclo_vio.simulation.trial.walk import Walk
from coclo_vio.simulation.visuals.room import RoomBounds
from coclo_vio.simulation.visuals.scene import Surface
from coclo_vio.values.arrays import Array, BoolArray, IntArray
from coclo_vio.values.calibration import ImuCalibration, StereoCalibration
from coclo_vio.values.measurements import CameraImuSample, FootForceSample, ImuSample, JointSample, Measurement
from coclo_vio.values.trajectory import GroundTruth, Trajectory
from coclo_vio.values.units import NS_PER_S

_CONTACT_FORCE_N = 1.0  # a foot with a larger normal force is in contact


class SensorsConfig(Protocol):
    """The sensors of a trial, of whatever robot: the parts of its configuration that do not change the motion."""

    @property
    def imu(self) -> ImuConfig:
        """The body's IMU."""

    @property
    def camera_imu(self) -> ImuConfig:
        """The IMU inside the camera."""

    @property
    def joints(self) -> JointSensorConfig:
        """Encoders and torque."""

    @property
    def vicon(self) -> ViconConfig:
        """The motion capture."""

    @property
    def mounting(self) -> MountingConfig:
        """Extrinsics of camera and IMUs."""

    @property
    def frame_rate_hz(self) -> float:
        """Stereo frames a second, Hz."""

    @property
    def frame_delay_s(self) -> float:
        """By which the stamps of the images are late, s."""


class RenderedGround(Protocol):
    """The ground of a trial as its pictures and its record need it."""

    @property
    def surfaces(self) -> tuple[Surface, ...]:
        """Rendered faces besides the floor."""

    @property
    def bounds(self) -> RoomBounds:
        """The walked area."""

    @property
    def path_length_m(self) -> float:
        """Length of the path as specified, m."""


class DrawnWalk(Protocol):
    """A trial before it is walked, with all that is drawn; of a Daisy or of a quadruped."""

    @property
    def robot(self) -> RobotDescription:
        """The described robot."""

    @property
    def config(self) -> SensorsConfig:
        """The trial's sensors."""

    @property
    def terrain(self) -> RenderedGround:
        """The ground."""

    @property
    def imperfection(self) -> Imperfection:
        """How the robot that walks differs from its description."""

    @property
    def slippery(self) -> SlipperyGround | None:
        """Areas of low friction."""

    @property
    def generators(self) -> Mapping[str, np.random.Generator]:
        """Of the streams imu, camera_imu, joints and vicon."""

    def spec(self) -> mujoco.MjSpec:
        """The robot on its ground, without textures and cameras."""

    def motion(self, progress: Callable[[float], None] | None = None, motions: Path | None = None) -> Motion:
        """The true motion, simulated or from a file."""

    def foot_forces(self, motion: Motion) -> Iterable[FootForceSample]:
        """Readings of foot sensors; nothing where the robot has none."""


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
        measurements: both IMUs, the joints and the foot sensors, in time order.
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

    terrain: RenderedGround
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


def simulate(
    name: TerrainName,
    robot: RobotDescription,
    config: TrialConfig,
    seed: int,
    *,
    until_s: float | None = None,
    progress: Callable[[float], None] | None = None,
    motions: Path | None = None,
) -> Trial:
    """Walk a trial; the same arguments give the same values.

    Args:
        name: the terrain.
        robot: the described robot; the one that walks differs from it by ``config.imperfection``.
        config: the trial.
        seed: decides everything random.
        until_s: cut the trial short after so many seconds.
        progress: called with the simulated time (s) now and then.
        motions: folder of true motions, which trials that differ in their sensors only share; None: none is kept.

    Raises:
        SimulationError: the robot fell or stuck.
        DatasetError: the folder of motions cannot be written or read.
    """
    return recorded(Walk.draw(name, robot, config, seed, until_s), progress, motions)


def recorded(walk: DrawnWalk, progress: Callable[[float], None] | None = None, motions: Path | None = None) -> Trial:
    """Walk what has been drawn, and read its sensors; the arguments are those of ``simulate``.

    Raises:
        SimulationError: the robot fell or stuck.
        DatasetError: the folder of motions cannot be written or read.
    """
    stereo = perturbed(walk.config.mounting.stereo(), walk.imperfection)
    motion = walk.motion(progress, motions)
    readings = _read_sensors(motion, walk, stereo)
    return _trial(walk, motion, readings, _truth(motion, readings, stereo, walk))


def _trial(walk: DrawnWalk, motion: Motion, readings: "_Readings", truth: Truth) -> Trial:
    """The readings with nominal calibrations and the states at the frames."""
    config = walk.config
    mounting = config.mounting
    nominal = mounting.stereo()
    frame_ns, offsets_ns = sample_times(float(motion.time_s[-1]), config.frame_rate_hz)
    offsets_ns = np.maximum(offsets_ns - round(config.frame_delay_s * NS_PER_S), 0)
    return Trial(
        terrain=walk.terrain,
        robot=walk.robot,
        measurements=readings.in_time_order(),
        vicon=readings.vicon,
        imu=nominal_calibration(config.imu, mounting.T_body_imu),
        camera_imu=nominal_calibration(config.camera_imu, nominal.T_body_left_camera @ mounting.T_left_camera_imu),
        stereo=nominal,
        frame_ns=frame_ns,
        frame_qpos=interpolated_at(motion.time_s, motion.qpos, offsets_ns),
        frame_qvel=interpolated_at(motion.time_s, motion.qvel, offsets_ns),
        spec=walk.spec(),
        truth=truth,
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Readings:
    """The readings of all sensors, and the truth behind them."""

    imu: list[ImuSample]
    imu_truth: ImuTruth
    camera_imu: list[CameraImuSample]
    camera_imu_truth: ImuTruth
    joints: list[JointSample]
    feet: list[FootForceSample]
    vicon: GroundTruth
    vicon_offset_s: float

    def in_time_order(self) -> tuple[Measurement, ...]:
        """Merged by stamp; at one stamp feet, IMU, joints, camera IMU."""
        samples: list[Measurement] = [*self.feet, *self.imu, *self.joints, *self.camera_imu]
        return tuple(sorted(samples, key=lambda sample: sample.stamp_ns))


def _read_sensors(motion: Motion, walk: DrawnWalk, stereo: StereoCalibration) -> _Readings:
    config, generators, mounting = walk.config, walk.generators, walk.config.mounting
    imu, imu_truth = imu_readings(ImuSample, motion, mounting.T_body_imu, config.imu, generators["imu"])
    T_body_camera_imu = stereo.T_body_left_camera @ mounting.T_left_camera_imu
    camera_imu, camera_imu_truth = imu_readings(
        CameraImuSample, motion, T_body_camera_imu, config.camera_imu, generators["camera_imu"]
    )
    joints = list(joint_samples(motion, config.joints, walk.imperfection, generators["joints"]))
    vicon, vicon_offset_s = vicon_poses(motion, config.vicon, generators["vicon"])
    feet = list(walk.foot_forces(motion))
    return _Readings(imu, imu_truth, camera_imu, camera_imu_truth, joints, feet, vicon, vicon_offset_s)


def _truth(motion: Motion, readings: _Readings, stereo: StereoCalibration, walk: DrawnWalk) -> Truth:
    return Truth(
        trajectory=_trajectory(motion, np.array([sample.stamp_ns for sample in readings.joints])),
        contact=motion.foot_force > _CONTACT_FORCE_N,
        contact_ns=EPOCH_NS + np.round(motion.time_s * NS_PER_S).astype(np.int64),
        imu=readings.imu_truth,
        camera_imu=readings.camera_imu_truth,
        stereo=stereo,
        imperfection=walk.imperfection,
        vicon_offset_s=readings.vicon_offset_s,
        self_contacts=motion.self_contacts,
        ground_contacts=motion.ground_contacts,
        max_penetration_m=motion.max_penetration_m,
        tile=None if walk.slippery is None else walk.slippery.tile,
        on_tile_s=motion.on_tile_s,
    )


def _trajectory(motion: Motion, stamps_ns: IntArray) -> Trajectory:
    """The body at stamps that are steps of the physics."""
    step_s = motion.time_s[1] - motion.time_s[0]
    steps = np.round((stamps_ns - EPOCH_NS) / NS_PER_S / step_s).astype(np.int64)
    return Trajectory(stamps_ns, motion.T_world_body[steps], motion.velocity_world[steps])
