# SPDX-License-Identifier: BSD-3-Clause
"""Sensor models: readings from the true motion by low-pass, sampling, bias, noise, range and resolution."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated, TypeVar

import numpy as np
from pydantic import Field
from scipy import signal

from coclo_vio.simulation.trial.imperfection import Imperfection
from coclo_vio.simulation.trial.motion import Motion
from coclo_vio.values.arrays import Array, IntArray
from coclo_vio.values.calibration import ImuCalibration, Triple
from coclo_vio.values.config import StageConfig
from coclo_vio.values.measurements import InertialReading, JointSample
from coclo_vio.values.units import NS_PER_S

Reading = TypeVar("Reading", bound=InertialReading)

_SHOCK_HZ = 20.0  # above the robot's sway and its oscillation on its springs (2 to 10 Hz): excited by impacts
EPOCH_NS = 1_700_000_000 * NS_PER_S  # the first stamp of every trial; tools for bags do not accept times near zero


class ImuConfig(StageConfig):
    """An IMU. Defaults: Bosch BMI055, as in the RealSense D435i (data sheet BST-BMI055-DS000, typical values).

    Instantaneous samples of a shock alias, means over the sampling interval hide it; a real part low-passes before it
    samples. The filter here is a second-order Butterworth.
    """

    rate_hz: Annotated[float, Field(gt=1, le=1000, description="samples a second, Hz")] = 100.0
    low_pass_hz: Annotated[float, Field(gt=1, lt=500, description="-3 dB bandwidth before sampling, Hz")] = 62.5
    gyroscope_noise_density: Annotated[
        float, Field(ge=0, description="rad/s/sqrt(Hz) (data sheet: 0.014 deg/s/sqrt(Hz))")
    ] = 2.44e-4
    gyroscope_bias: Annotated[
        float,
        Field(ge=0, description="standard deviation at switch-on, each axis, rad/s (data sheet: 1 deg/s, factory)"),
    ] = 0.005
    gyroscope_bias_walk: Annotated[float, Field(ge=0, description="rad/s^2/sqrt(Hz)")] = 2e-5
    gyroscope_scale: Annotated[
        float, Field(ge=0, lt=0.2, description="standard deviation of the relative error of its scale, each axis")
    ] = 0.0
    accelerometer_noise_density: Annotated[
        float, Field(ge=0, description="m/s^2/sqrt(Hz) (data sheet: 150 ug/sqrt(Hz))")
    ] = 1.47e-3
    accelerometer_bias: Annotated[
        float, Field(ge=0, description="standard deviation at switch-on, each axis, m/s^2, after calibration")
    ] = 0.03
    accelerometer_bias_walk: Annotated[float, Field(ge=0, description="m/s^3/sqrt(Hz)")] = 3e-4
    accelerometer_range_mps2: Annotated[float, Field(gt=0, description="beyond it readings saturate (4 g)")] = 39.2
    gyroscope_range_radps: Annotated[
        float | None, Field(gt=0, description="beyond it readings saturate, rad/s; null: they never do")
    ] = None
    accelerometer_step_mps2: Annotated[float, Field(ge=0, description="resolution (4 g over 12 bits)")] = 0.0192
    gyroscope_step_radps: Annotated[float, Field(ge=0, description="resolution (1000 deg/s over 16 bits)")] = 5.33e-4
    shock_scale: Annotated[
        float,
        Field(ge=0, le=100, description="factor on the shocks of the accelerometer: its part above 20 Hz"),
    ] = 1.0


class CameraImuConfig(ImuConfig):
    """The IMU inside the camera: the same part, read twice as often."""

    rate_hz: Annotated[float, Field(gt=1, le=1000, description="samples a second, Hz")] = 200.0


class JointSensorConfig(StageConfig):
    """Encoders and springs of a series-elastic joint, HEBI X class; noise is chosen, the maker publishes none."""

    rate_hz: Annotated[float, Field(gt=1, le=1000, description="samples a second, Hz (paper, section V)")] = 100.0
    position_noise_rad: Annotated[float, Field(ge=0, description="white, a sample")] = 5e-4
    velocity_noise_radps: Annotated[float, Field(ge=0, description="white, a sample")] = 0.01
    velocity_low_pass_hz: Annotated[float, Field(gt=1, lt=500, description="first order, Hz")] = 50.0
    effort_noise_nm: Annotated[float, Field(ge=0, description="white, a sample")] = 0.05
    effort_offset_nm: Annotated[float, Field(ge=0, description="standard deviation, each joint, constant")] = 0.15
    effort_low_pass_hz: Annotated[float, Field(gt=1, lt=500, description="first order, Hz")] = 50.0


@dataclass(frozen=True, slots=True, eq=False)
class ImuTruth:
    """The true biases of an IMU.

    Attributes:
        stamps_ns: (N,).
        gyroscope_bias: rad/s, imu frame, (N, 3).
        accelerometer_bias: m/s^2, imu frame, (N, 3).
    """

    stamps_ns: IntArray
    gyroscope_bias: Array
    accelerometer_bias: Array


def sample_times(duration_s: float, rate_hz: float) -> tuple[IntArray, IntArray]:
    """Stamps of a sensor over a trial, ns, and their offsets from its beginning, ns."""
    count = int(duration_s * rate_hz) + 1
    offsets_ns = np.round(np.arange(count) * (NS_PER_S / rate_hz)).astype(np.int64)
    return EPOCH_NS + offsets_ns, offsets_ns


def interpolated_at(time_s: Array, values: Array, offsets_ns: IntArray) -> Array:
    """``values`` (N, ...) interpolated linearly between the physics' steps, at offsets (M,) ns: (M, ...)."""
    step = offsets_ns / NS_PER_S / (time_s[1] - time_s[0])
    before = np.minimum(step.astype(np.int64), len(values) - 2)
    share = (step - before).reshape(-1, *[1] * (values.ndim - 1))
    return np.asarray((1.0 - share) * values[before] + share * values[before + 1])


def imu_readings(
    kind: type[Reading], motion: Motion, T_body_imu: Array, config: ImuConfig, generator: np.random.Generator
) -> tuple[list[Reading], ImuTruth]:
    """The readings of an IMU at ``T_body_imu`` (4, 4), and its true biases."""
    step_s = float(motion.time_s[1] - motion.time_s[0])
    truth = _with_scaled_shocks(motion.inertial(T_body_imu), config.shock_scale, step_s)
    cutoff = config.low_pass_hz / (0.5 / step_s)
    numerator, denominator = signal.butter(2, cutoff)
    settled = signal.lfilter_zi(numerator, denominator)[:, None] * truth[0]
    smooth, _ = signal.lfilter(numerator, denominator, truth, axis=0, zi=settled)
    stamps, offsets = sample_times(float(motion.time_s[-1]), config.rate_hz)
    sampled = interpolated_at(motion.time_s, smooth, offsets)
    if config.gyroscope_scale > 0.0:  # drawn only where there is one: other draws stay as they are
        sampled[:, :3] *= 1.0 + config.gyroscope_scale * generator.standard_normal(3)
    root = np.sqrt(config.rate_hz)
    densities = (config.gyroscope_noise_density, config.accelerometer_noise_density)
    first = (config.gyroscope_bias, config.accelerometer_bias)
    walks = (config.gyroscope_bias_walk, config.accelerometer_bias_walk)
    steps = (config.gyroscope_step_radps, config.accelerometer_step_mps2)
    columns, biases = [], []
    for index in range(2):
        bias = first[index] * generator.standard_normal(3) + np.cumsum(
            walks[index] / root * generator.standard_normal((len(stamps), 3)), axis=0
        )
        noisy = sampled[:, 3 * index : 3 * index + 3] + bias
        noisy += densities[index] * root * generator.standard_normal(noisy.shape)
        columns.append(_quantised(noisy, steps[index]))
        biases.append(bias)
    for index, limit in enumerate((config.gyroscope_range_radps, config.accelerometer_range_mps2)):
        if limit is not None:
            columns[index] = np.clip(columns[index], -limit, limit)
    readings = [kind(int(stamp), rate, force) for stamp, rate, force in zip(stamps, *columns, strict=True)]
    return readings, ImuTruth(stamps, biases[0], biases[1])


def joint_samples(
    motion: Motion, config: JointSensorConfig, imperfection: Imperfection, generator: np.random.Generator
) -> Iterator[JointSample]:
    """Readings of the joints: encoder angles with their zeros, filtered velocities, spring torques."""
    stamps, offsets = sample_times(float(motion.time_s[-1]), config.rate_hz)
    step_s = float(motion.time_s[1] - motion.time_s[0])
    position = interpolated_at(motion.time_s, motion.joint_position, offsets) + imperfection.joint_zero_rad
    velocity = interpolated_at(
        motion.time_s, _low_passed(motion.joint_velocity, config.velocity_low_pass_hz, step_s), offsets
    )
    effort = interpolated_at(
        motion.time_s, _low_passed(motion.spring_torque, config.effort_low_pass_hz, step_s), offsets
    )
    effort = effort + config.effort_offset_nm * generator.standard_normal(effort.shape[1])
    position += config.position_noise_rad * generator.standard_normal(position.shape)
    velocity += config.velocity_noise_radps * generator.standard_normal(velocity.shape)
    effort += config.effort_noise_nm * generator.standard_normal(effort.shape)
    for stamp, *readings in zip(stamps, position, velocity, effort, strict=True):
        yield JointSample(int(stamp), *readings)


def nominal_calibration(config: ImuConfig, T_body_imu: Array) -> ImuCalibration:
    """The calibration that a user would have: the IMU's mounting, and its noise by the data sheet."""
    position_m, rotation_rpy_rad = _mounting_fields(T_body_imu)
    return ImuCalibration(
        position_body_m=position_m,
        rotation_body_imu_rpy_rad=rotation_rpy_rad,
        gyroscope_noise_density=max(config.gyroscope_noise_density, 1e-9),
        gyroscope_bias_walk=config.gyroscope_bias_walk,
        accelerometer_noise_density=max(config.accelerometer_noise_density, 1e-9),
        accelerometer_bias_walk=config.accelerometer_bias_walk,
    )


def _mounting_fields(T_body_imu: Array) -> tuple[Triple, Triple]:
    """Position and roll, pitch, yaw of a mounting, as in ``ImuCalibration``."""
    R = T_body_imu[:3, :3]
    pitch = -float(np.arcsin(np.clip(R[2, 0], -1.0, 1.0)))
    roll, yaw = float(np.arctan2(R[2, 1], R[2, 2])), float(np.arctan2(R[1, 0], R[0, 0]))
    x, y, z = T_body_imu[:3, 3].tolist()
    return (x, y, z), (roll, pitch, yaw)


def _with_scaled_shocks(truth: Array, scale: float, step_s: float) -> Array:
    """Rates and specific forces (N, 6) with scaled shocks.

    The high-pass s^2 a / (s^2 + 2 d w s + w^2) of an acceleration a is how a mass m on a spring of w = 20 Hz, with d =
    0.71 of critical damping, accelerates under a force m a. So what is added is a motion that ends where it began, as
    that of a camera on a compliant bracket.
    """
    if scale == 1.0:
        return truth
    sections = signal.butter(2, _SHOCK_HZ, "highpass", fs=1.0 / step_s, output="sos")
    force = truth[:, 3:]
    settled = signal.sosfilt_zi(sections)[:, :, None] * force[0]
    shocks, _ = signal.sosfilt(sections, force, axis=0, zi=settled)
    return np.hstack((truth[:, :3], force + (scale - 1.0) * shocks))


def _low_passed(values: Array, cutoff_hz: float, step_s: float) -> Array:
    """First-order low-pass, started where the signal starts."""
    keep = float(np.exp(-2.0 * np.pi * cutoff_hz * step_s))
    filtered, _ = signal.lfilter([1.0 - keep], [1.0, -keep], values, axis=0, zi=keep * values[:1])
    return np.asarray(filtered)


def _quantised(values: Array, step: float) -> Array:
    return np.round(values / step) * step if step > 0.0 else values
