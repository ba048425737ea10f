# SPDX-License-Identifier: BSD-3-Clause
"""The analytic test case: a leg log with known truth, for any robot whose legs have three joints or more.

The body moves along closed forms (``body_motion``), feet step by a schedule (``gait``) and roll (``rolling``); sensors
are read at a fixed rate, with noise and biases drawn from a seed. No physics engine, no slip: an estimator's error
here is its own. Stance feet end where exact rolling puts them to 1e-9 m; more ``substeps`` bring 1e-12.
"""

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from pydantic import Field

from coclo_vio.geometry import se3
from coclo_vio.robot.model import RobotModel
from coclo_vio.simulation.body_motion import BodyMotion, BodyMotionConfig, BodyStates
from coclo_vio.simulation.gait import GaitConfig, plan_swings, share_load, stance_of
from coclo_vio.simulation.rolling import FootPlan, LegPath, RollingLegs
from coclo_vio.values.arrays import Array, BoolArray, IntArray
from coclo_vio.values.config import StageConfig
from coclo_vio.values.errors import ConfigError, listing
from coclo_vio.values.measurements import FootForceSample, ImuSample, JointSample, Measurement
from coclo_vio.values.trajectory import Trajectory
from coclo_vio.values.units import GRAVITY_MPS2, NS_PER_S

_BENT_RAD = (0.0, 0.8, -1.6)  # of a Unitree leg
STANDING_RAD: dict[str, tuple[tuple[float, ...], ...]] = {
    "a1": (_BENT_RAD,) * 4,
    "anymal_b": ((0.0, 0.4, -0.8), (0.0, 0.4, -0.8), (0.0, -0.4, 0.8), (0.0, -0.4, 0.8)),
    "anymal_c": ((-0.1, 0.7, -1.0), (0.1, 0.7, -1.0), (-0.1, -0.7, 1.0), (0.1, -0.7, 1.0)),
    "b1": (_BENT_RAD,) * 4,
    "bolt": ((0.3, 0.8, -1.6), (-0.3, 0.8, -1.6)),
    "daisy": ((0.0, 0.1, -1.3), (0.0, -0.1, 1.3)) * 3,
    "g1": ((-0.3, 0.0, 0.0, 0.6, -0.3, 0.0),) * 2,
    "go1": (_BENT_RAD,) * 4,
    "go2": (_BENT_RAD,) * 4,
    "hyq": ((-0.2, 0.75, -1.5), (-0.2, 0.75, -1.5), (-0.2, -0.75, 1.5), (-0.2, -0.75, 1.5)),
    "laikago": (_BENT_RAD,) * 4,
    "solo12": ((0.1, 0.8, -1.6), (-0.1, 0.8, -1.6), (0.1, -0.8, 1.6), (-0.1, -0.8, 1.6)),
}
"""Joint angles of a stand of the known robots, leg by leg, rad."""


class SensorNoiseConfig(StageConfig):
    """Noise and biases of the simulated sensors; the IMU's densities are those of the robot's description."""

    noise_scale: Annotated[
        float, Field(ge=0, le=100, description="factor on every noise and bias; 0 makes perfect sensors")
    ] = 1.0
    encoder_noise_rad: Annotated[
        float | None, Field(ge=0, description="one sigma of a joint position, rad; null: the robot's description")
    ] = None
    joint_velocity_noise_radps: Annotated[
        float | None, Field(ge=0, description="one sigma of a joint velocity, rad/s; null: the robot's description")
    ] = None
    effort_noise_nm: Annotated[float, Field(ge=0, description="one sigma of a joint torque, Nm")] = 0.1
    force_noise_n: Annotated[float, Field(ge=0, description="one sigma of a foot sensor, N")] = 1.0
    gyroscope_bias_radps: Annotated[float, Field(ge=0, description="one sigma of the first bias, rad/s")] = 5e-3
    accelerometer_bias_mps2: Annotated[float, Field(ge=0, description="one sigma of the first bias, m/s^2")] = 0.05
    force_per_newton: Annotated[
        float | None,
        Field(
            gt=0,
            description="reading of a foot sensor per newton; null: 1, or for a robot with raw counts the factor with "
            "which an equal share of the weight reads 1.5 times contact.on_force",
        ),
    ] = None


class AnalyticTrialConfig(StageConfig):
    """Configuration of an analytic trial: motion, gait, sensors."""

    rate_hz: Annotated[float, Field(ge=10, le=2000, description="rate of all sensors, Hz")] = 100.0
    substeps: Annotated[int, Field(ge=1, le=20, description="Runge-Kutta steps between samples")] = 2
    body: Annotated[BodyMotionConfig, Field(description="the motion of the body")] = BodyMotionConfig()
    gait: Annotated[GaitConfig, Field(description="the steps")] = GaitConfig()
    sensors: Annotated[SensorNoiseConfig, Field(description="noise and biases")] = SensorNoiseConfig()
    foothold_jitter_m: Annotated[
        float, Field(ge=0, le=0.1, description="half width of the uniform scatter of footholds, m")
    ] = 0.01
    standing_rad: Annotated[
        tuple[float, ...] | None,
        Field(description="joint angles of a stand, all joints in the robot's order, rad; null: a known robot's"),
    ] = None


@dataclass(frozen=True, slots=True, eq=False)
class AnalyticTrial:
    """A leg log and the truth behind it, N samples.

    Attributes:
        measurements: in time order; at one stamp foot force, IMU, joints.
        truth: the body, with velocity.
        stance: whether a foot touches the ground, lift-off and touchdown included, (N, legs).
        feet_world: foot centres, m, world, (N, legs, 3).
        joint_position: without noise, rad, (N, J).
        joint_velocity: without noise, rad/s, (N, J).
        joint_acceleration: central differences of the velocity, rad/s^2, (N, J).
        load_n: vertical ground force on each foot, N, (N, legs).
        body: exact motion of the body.
        gyroscope_bias: rad/s, imu frame, (N, 3).
        accelerometer_bias: m/s^2, imu frame, (N, 3).
    """

    measurements: tuple[Measurement, ...]
    truth: Trajectory
    stance: BoolArray
    feet_world: Array
    joint_position: Array
    joint_velocity: Array
    joint_acceleration: Array
    load_n: Array
    body: BodyStates
    gyroscope_bias: Array
    accelerometer_bias: Array


def generate(config: AnalyticTrialConfig, robot: RobotModel, seed: int) -> AnalyticTrial:
    """Make a trial; the same arguments make the same bytes.

    Raises:
        ConfigError: no stand is known for the robot, or the gait leaves no foot on the ground.
        RobotModelError: a leg cannot follow.
    """
    steps_seed, sensor_seed = np.random.SeedSequence(seed).spawn(2)
    samples = round(config.body.duration_s * config.rate_hz) + 1
    stamps_ns = np.round(np.arange(samples) * (NS_PER_S / config.rate_hz)).astype(np.int64)
    posture = _standing(config, robot)
    nominal = robot.feet(posture, np.zeros_like(posture)).position_body
    motion = BodyMotion(config.body, float(np.mean(robot.foot_radii_m - nominal[:, 2])))
    legs = RollingLegs(robot, motion)
    body = motion.at(stamps_ns / NS_PER_S)
    walk_end_s = config.body.rest_s + config.body.walk_s
    swings = plan_swings(config.gait, nominal[:, :2], config.rate_hz, config.body.rest_s, walk_end_s)
    scatter = np.random.default_rng(steps_seed).uniform(-1.0, 1.0, (len(swings), 2)) * config.foothold_jitter_m
    plan = FootPlan(nominal[:, :2], config.gait.duty * config.gait.cycle_s, config.gait.lift_m, scatter)
    ground = np.column_stack((nominal[:, :2], robot.foot_radii_m))
    path = legs.walk(
        stamps_ns / NS_PER_S, legs.stand(posture, ground, motion.at(np.zeros(1))), swings, plan, config.substeps
    )
    share = share_load(config.gait, swings, samples, len(nominal), config.rate_hz)
    acceleration = np.gradient(path.velocity, stamps_ns / NS_PER_S, axis=0)
    sensors = _Sensors(config, robot, sensor_seed, samples)
    load_n = robot.mass_kg * GRAVITY_MPS2 * share
    return AnalyticTrial(
        sensors.read(stamps_ns, body, path, acceleration, load_n),
        Trajectory(stamps_ns, se3.transform(body.rotation, body.position), body.velocity),
        stance_of(swings, samples, len(nominal)),
        path.feet_world,
        path.position,
        path.velocity,
        acceleration,
        load_n,
        body,
        sensors.gyroscope_bias,
        sensors.accelerometer_bias,
    )


def _standing(config: AnalyticTrialConfig, robot: RobotModel) -> Array:
    name, joints = robot.description.name, len(robot.joint_names)
    angles = config.standing_rad
    if angles is None:
        if name not in STANDING_RAD:
            raise ConfigError(
                f"no stand is known for the robot {name!r}, only for: {listing(STANDING_RAD)}; set standing_rad, "
                f"{joints} joint angles"
            )
        angles = tuple(angle for leg in STANDING_RAD[name] for angle in leg)
    if len(angles) != joints:
        raise ConfigError(f"standing_rad has {len(angles)} angles, but {name!r} has {joints} joints; set all of them")
    return np.array(angles)


class _Sensors:
    """Sensor models with noise and biases from one seed."""

    def __init__(
        self, config: AnalyticTrialConfig, robot: RobotModel, seed: np.random.SeedSequence, samples: int
    ) -> None:
        self._config, self._robot, self._scale = config.sensors, robot, config.sensors.noise_scale
        self._random = np.random.default_rng(seed)
        imu, self._rate_hz = robot.description.imu, config.rate_hz
        self.gyroscope_bias = self._bias(samples, config.sensors.gyroscope_bias_radps, imu.gyroscope_bias_walk)
        self.accelerometer_bias = self._bias(
            samples, config.sensors.accelerometer_bias_mps2, imu.accelerometer_bias_walk
        )

    def read(
        self, stamps_ns: IntArray, body: BodyStates, path: LegPath, acceleration: Array, load_n: Array
    ) -> tuple[Measurement, ...]:
        """All samples in time order."""
        force = self._foot_forces(load_n)
        rate, specific_force = self._imu(body)
        effort = self._efforts(body, path, acceleration, load_n)
        description = self._robot.description
        encoder_noise = _default(self._config.encoder_noise_rad, description.encoder_noise_rad)
        velocity_noise = _default(self._config.joint_velocity_noise_radps, description.joint_velocity_noise_radps)
        position = path.position + self._white(path.position, encoder_noise)
        velocity = path.velocity + self._white(path.velocity, velocity_noise)
        measurements: list[Measurement] = []
        for k, stamp in enumerate(stamps_ns):
            stamp_ns = int(stamp)
            measurements.append(FootForceSample(stamp_ns, force[k]))
            measurements.append(ImuSample(stamp_ns, rate[k], specific_force[k]))
            measurements.append(JointSample(stamp_ns, position[k], velocity[k], effort[k]))
        return tuple(measurements)

    def _white(self, like: Array, sigma: float) -> Array:
        return self._random.normal(size=like.shape) * (self._scale * sigma)

    def _bias(self, samples: int, first: float, walk: float) -> Array:
        """A random walk from a random start, (samples, 3)."""
        steps = self._random.normal(size=(samples, 3)) * (walk / np.sqrt(self._rate_hz))
        steps[0] = self._random.normal(size=3) * first
        return np.cumsum(steps, axis=0) * self._scale

    def _foot_forces(self, load_n: Array) -> Array:
        noisy = load_n + self._white(load_n, self._config.force_noise_n)
        contact = self._robot.description.contact
        per_newton = self._config.force_per_newton
        if per_newton is None:
            equal_share = self._robot.mass_kg * GRAVITY_MPS2 / load_n.shape[1]
            per_newton = 1.5 * contact.on_force / equal_share if contact.source == "force_sensor" else 1.0
        return noisy * per_newton

    def _imu(self, body: BodyStates) -> tuple[Array, Array]:
        """Gyroscope rad/s and accelerometer m/s^2, imu frame, (N, 3) each."""
        imu = self._robot.description.imu
        T_body_imu = imu.T_body_imu
        rate = body.angular_velocity @ T_body_imu[:3, :3]
        specific_force = body.specific_force_at(T_body_imu[:3, 3]) @ T_body_imu[:3, :3]
        sampled = np.sqrt(self._rate_hz)
        rate = rate + self.gyroscope_bias + self._white(rate, imu.gyroscope_noise_density * sampled)
        noise = self._white(specific_force, imu.accelerometer_noise_density * sampled)
        return rate, specific_force + self.accelerometer_bias + noise

    def _efforts(self, body: BodyStates, path: LegPath, acceleration: Array, load_n: Array) -> Array:
        """Torques that carry the legs' weight and motion and the loads: ``tau = h - J^T F``, Nm, (N, J).

        ``RobotModel.foot_forces`` solves ``J^T F = h - tau``: with tau = 0 its solution gives h.
        """
        robot, efforts = self._robot, np.empty_like(path.position)
        specific_force = body.specific_force_at(np.zeros(3))
        no_torque = np.zeros(path.position.shape[1])
        for k, (position, velocity) in enumerate(zip(path.position, path.velocity, strict=True)):
            inertial = robot.foot_forces(
                position,
                velocity,
                no_torque,
                specific_force_body=specific_force[k],
                angular_velocity_body=body.angular_velocity[k],
                acceleration=acceleration[k],
            )
            ground = load_n[k][:, None] * body.rotation[k, 2]
            jacobian = robot.feet(position, velocity).jacobian[:, 3:]
            efforts[k] = np.einsum("lij,li->j", jacobian, inertial - ground)
        return efforts + self._white(efforts, self._config.effort_noise_nm)


def _default(value: float | None, default: float) -> float:
    return default if value is None else value
