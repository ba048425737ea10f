# SPDX-License-Identifier: BSD-3-Clause
"""The camera's IMU in the filter beside the body's: biases of its own, and its mounting against the body's.

While both measure, only their difference is used (``imu_comparison``): it contains neither the body's motion nor the
errors of the legs, so nothing of these is counted twice. It ties the biases of the two to each other, and with them
the tilt, which is the body's accelerometer less its bias. While the body's IMU is silent the camera's measures rate
and gravity itself. Nothing else touches its states, and without it they are not there.

With the mounting's error ``m``, a rotation vector in body axes, and the delay ``d`` of the camera's IMU behind the
body's, the camera's IMU measures ``w + m x w + b - d dw/dt`` and ``f + m x f + b``; the body's ``w + b`` and ``f + b``.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.stats import chi2

from coclo_vio.filter.config import CameraImuConfig, FilterConfig, InitialConfig
from coclo_vio.filter.gravity import GravityWindow
from coclo_vio.filter.square_root_filter import SquareRootFilter
from coclo_vio.filter.stance import Reading
from coclo_vio.filter.state import ACCELEROMETER_BIAS, GYROSCOPE_BIAS, GYROSCOPE_SCALE, RATE, ROTATION, StateLayout
from coclo_vio.filter.state_blocks import StateBlock, bias_sigmas
from coclo_vio.filter.unscented_transform import Correction, correct
from coclo_vio.geometry import so3
from coclo_vio.robot.gravity_check import GravityCheck
from coclo_vio.robot.imu_comparison import ImuComparison, ImuDifference
from coclo_vio.robot.standstill import ImuMeans, StandstillDetector
from coclo_vio.values.arrays import Array
from coclo_vio.values.calibration import ImuCalibration
from coclo_vio.values.measurements import CameraImuSample, ImuSample, JointSample, Measurement
from coclo_vio.values.outputs import Event
from coclo_vio.values.units import GRAVITY_MPS2

_SILENT_NS = 50_000_000  # without a sample for so long the body's IMU is silent
_GRAVITY = np.array([0.0, 0.0, GRAVITY_MPS2])
_ROTATION, _DELAY = "camera_imu_rotation", "camera_imu_delay"
_GYROSCOPE, _ACCELEROMETER = "camera_gyroscope_bias", "camera_accelerometer_bias"


def camera_imu_blocks(
    config: CameraImuConfig, initial: InitialConfig, imu: ImuCalibration, *, is_passive: bool = True
) -> tuple[StateBlock, ...]:
    """The states of the camera's IMU: its biases, error of its mounting and delay, body axes."""
    gyroscope_sigma, accelerometer_sigma = bias_sigmas(initial, imu)
    sigmas = {
        _GYROSCOPE: gyroscope_sigma,
        _ACCELEROMETER: accelerometer_sigma,
        _ROTATION: config.rotation_sigma_rad,
        _DELAY: config.delay_sigma_s,
    }
    return tuple(
        StateBlock(name, 1 if name == _DELAY else 3, sigma=sigma, is_reported=True, is_passive=is_passive)
        for name, sigma in sigmas.items()
    )


class CameraImu:
    """What the camera's IMU adds to the filter.

    Args:
        imu: mounting and errors of the camera's IMU.
        body_imu: of the body's.
        config: of the filter.
        is_passive: whether its states are passive; otherwise they are part of the state at keyframes.
    """

    def __init__(
        self, imu: ImuCalibration, body_imu: ImuCalibration, config: FilterConfig, *, is_passive: bool = True
    ) -> None:
        own, robust = config.camera_imu, config.robust
        self.blocks = camera_imu_blocks(own, config.initial, imu, is_passive=is_passive)
        self.counts: Counter[str] = Counter()
        self._imu, self._body_imu, self._config, self._initial = imu, body_imu, own, config.initial
        self.rotation_body_imu, self._lever_cross = imu.T_body_imu[:3, :3], so3.hat(imu.T_body_imu[:3, 3])
        self._comparison = ImuComparison(body_imu.T_body_imu, imu.T_body_imu, own.window_s)
        self._standstill = StandstillDetector(config.standstill.limits)
        self._gravity = GravityWindow(robust.gravity_dwell_s, robust.gravity_window_s)
        self._gravity_noise_mps2 = robust.gravity_noise_mps2
        self._limits = {rows: float(chi2.ppf(own.gate_probability, rows)) for rows in (3, 6)}
        self._rejected = 0  # differences in a row
        self._since_joints: list[Array] = []  # rate and force of each sample, (2, 3)
        self._body_ns: int | None = None
        self._camera_ns: int | None = None
        self._gravity_check = GravityCheck("camera's")

    def push(self, measurement: Measurement, up_body: Array | None) -> None:
        """Take a measurement, whatever it is of; a sample of an IMU out of order is refused.

        Args:
            measurement: the measurement.
            up_body: upward direction by the estimated attitude while a foot stands, body axes, (3,); otherwise None.
        """
        match measurement:
            case ImuSample():
                if self._body_ns is None or measurement.stamp_ns > self._body_ns:
                    self._body_ns = measurement.stamp_ns
                    self._comparison.push(measurement, is_second=False)
            case CameraImuSample():
                self._take(measurement, up_body)
            case JointSample():
                self._standstill.push(measurement)

    def take_events(self) -> Sequence[Event]:
        """Whether this IMU was set aside or used again since the last call."""
        return self._gravity_check.take_events()

    def _take(self, sample: CameraImuSample, up_body: Array | None) -> None:
        if self._camera_ns is not None and sample.stamp_ns <= self._camera_ns:
            self.counts["camera_imu_stamp_refused"] += 1
            return
        values = np.stack((sample.angular_velocity, sample.specific_force)) @ self.rotation_body_imu.T
        self._gravity_check.push(sample.stamp_ns, values[1], up_body)
        if self._gravity_check.is_aside:
            self.counts["camera_imu_contradicts_gravity"] += 1
            return
        self._camera_ns = sample.stamp_ns
        self._comparison.push(sample, is_second=True)
        self._standstill.push(sample)
        self._since_joints.append(values)

    def replaces_body_imu(self, stamp_ns: int) -> bool:
        """Whether the body's IMU is silent while the camera's is not."""
        times = (self._body_ns, self._camera_ns)
        is_body_silent, is_camera_silent = (at is None or stamp_ns - at > _SILENT_NS for at in times)
        return is_body_silent and not is_camera_silent

    def rest(self, stamp_ns: int) -> ImuMeans | None:
        """Mean readings at rest, body axes, while this IMU replaces the body's; otherwise None."""
        rest = self._standstill.rest if self.replaces_body_imu(stamp_ns) else None
        return None if rest is None else rest.rotated(self.rotation_body_imu)

    def completed(self, reading: Reading) -> Reading:
        """The reading with the standstill by this IMU, while it replaces the body's."""
        if not self.replaces_body_imu(reading.stamp_ns):
            return reading
        return replace(reading, is_stationary=self.rest(reading.stamp_ns) is not None)

    def level(self, core: SquareRootFilter, rest: ImuMeans) -> None:
        """Measure gravity and rate at rest, without the body's IMU; the gyroscope's bias starts from it."""
        vector = core.mean.vector.copy()
        vector[core.mean.layout.at(_GYROSCOPE)] = rest.angular_velocity
        core.mean = replace(core.mean, vector=vector)
        initial = self._initial
        force, force_rows = self._gravity_rows(core)
        rate, rate_rows = self._rate_rows(core, np.zeros(3))
        measured = np.concatenate((rest.specific_force - force, rest.angular_velocity - rate))
        sigmas = np.repeat((initial.rest_force_noise_mps2, initial.rest_rate_noise_radps), 3)
        core.apply(_correction(core, np.concatenate((force_rows, rate_rows)), sigmas, measured))

    def update(self, core: SquareRootFilter, reading: Reading, dt_s: float) -> None:
        """Update the filter at a joint sample, after prediction and update by the legs."""
        samples, self._since_joints = self._since_joints, []
        difference = self._comparison.next()
        if difference is not None:
            self._compare(core, difference)
        if not self.replaces_body_imu(reading.stamp_ns):
            self._gravity.close()
            return
        self.counts["camera_imu_alone"] += 1
        if samples:
            rate, force = np.mean(samples, axis=0)
            self._measure_rate(core, rate, dt_s)
            self._measure_gravity(core, reading, force)

    def _compare(self, core: SquareRootFilter, difference: ImuDifference) -> None:
        """The difference of the two IMUs: of their biases, and the mounting of one against the other."""
        layout, vector = core.mean.layout, core.mean.vector
        self._walk(core, difference.duration_s)
        rate = difference.rate - vector[GYROSCOPE_BIAS]
        force = difference.force - vector[ACCELEROMETER_BIAS]
        rows = np.zeros((6, layout.dimension))
        rows[:3, layout.at(_GYROSCOPE)] = rows[3:, layout.at(_ACCELEROMETER)] = np.eye(3)
        rows[:3, GYROSCOPE_BIAS] = rows[3:, ACCELEROMETER_BIAS] = -np.eye(3)
        rows[:3, GYROSCOPE_SCALE] = -np.diag(rate)
        rows[:3, layout.at(_ROTATION)], rows[3:, layout.at(_ROTATION)] = -so3.hat(rate), -so3.hat(force)
        rows[:3, layout.at(_DELAY)] = -difference.angular_acceleration[:, None]
        measured = np.concatenate((difference.angular_velocity, difference.specific_force))
        densities = (self._imu.gyroscope_noise_density, self._body_imu.gyroscope_noise_density)
        rate_noise = np.hypot(np.hypot(*densities) / np.sqrt(difference.duration_s), self._config.rate_noise_radps)
        sigmas = np.repeat((rate_noise, self._config.force_noise_mps2), 3)
        sigmas[:3] = np.hypot(sigmas[:3], self._imu.gyroscope_scale * rate)
        innovation = measured - rows @ vector
        correction = _correction(core, rows, sigmas, innovation)
        if correction.innovation_squared <= self._limits[6]:
            self._rejected = 0
            core.apply(correction)
            return
        self.counts["camera_imu_rejected"] += 1
        self._rejected += 1
        if self._rejected >= self._config.max_rejections:
            self._open(core, innovation)

    def _walk(self, core: SquareRootFilter, duration_s: float) -> None:
        """Random walks of the biases, which as passive states the prediction leaves out."""
        root = float(np.sqrt(duration_s))
        core.add_noise(_GYROSCOPE, self._imu.gyroscope_bias_walk * root)
        core.add_noise(_ACCELEROMETER, self._imu.accelerometer_bias_walk * root)

    def _open(self, core: SquareRootFilter, innovation: Array) -> None:
        """The IMUs have disagreed for long, so a bias has changed: those of both are as uncertain as at switch-on.

        A change beyond that sigma is its own sigma.
        """
        self._rejected = 0
        self.counts["camera_imu_disagrees"] += 1
        changes = float(np.linalg.norm(innovation[:3])), float(np.linalg.norm(innovation[3:]))
        for prefix, imu in (("", self._body_imu), ("camera_", self._imu)):
            sigmas = bias_sigmas(self._initial, imu)
            for sensor, sigma, change in zip(("gyroscope", "accelerometer"), sigmas, changes, strict=True):
                core.add_noise(f"{prefix}{sensor}_bias", max(sigma, change))

    def _measure_rate(self, core: SquareRootFilter, rate: Array, dt_s: float) -> None:
        self._walk(core, dt_s)
        expected, rows = self._rate_rows(core, rate - core.mean.vector[core.mean.layout.at(_GYROSCOPE)])
        sigmas = np.hypot(self._imu.gyroscope_noise_density / np.sqrt(dt_s), self._imu.gyroscope_scale * rate)
        core.apply(_correction(core, rows, sigmas, rate - expected))

    def _measure_gravity(self, core: SquareRootFilter, reading: Reading, force: Array) -> None:
        gravity = self._gravity.collect(core, reading, force, self._lever_cross)
        if gravity is None:
            return
        force_body = core.mean.rotation.T @ gravity.force_world
        expected, rows = self._gravity_rows(core)
        sigma = gravity.sigma(core, self._gravity_noise_mps2)
        correction = _correction(core, rows, np.full(3, sigma), force_body - expected)
        if correction.innovation_squared > self._limits[3]:
            self.counts["gravity_rejected"] += 1
            return
        core.apply(correction)

    def _rate_rows(self, core: SquareRootFilter, rate: Array) -> tuple[Array, Array]:
        """The expected angular velocity (3,) and its rows (3, L), at a body that turns with ``rate``."""
        rows = _rows_of(core.mean.layout, _GYROSCOPE, rate)
        rows[:, RATE] = np.eye(3)
        return rows @ core.mean.vector, rows

    def _gravity_rows(self, core: SquareRootFilter) -> tuple[Array, Array]:
        """The expected specific force at rest (3,), and its rows (3, L)."""
        to_body = core.mean.rotation.T
        up_body = to_body @ _GRAVITY
        rows = _rows_of(core.mean.layout, _ACCELEROMETER, up_body)
        expected = up_body + rows @ core.mean.vector
        rows[:, ROTATION] = to_body @ so3.hat(_GRAVITY)
        return expected, rows


def _rows_of(layout: StateLayout, bias: str, measured: Array) -> Array:
    """Rows (3, L) of a bias, and of the mounting where a vector (3,) is measured."""
    rows = np.zeros((3, layout.dimension))
    rows[:, layout.at(bias)] = np.eye(3)
    rows[:, layout.at(_ROTATION)] = -so3.hat(measured)
    return rows


def _correction(core: SquareRootFilter, rows: Array, sigmas: Array, innovation: Array) -> Correction:
    """The correction by rows (M, L) of all errors, with independent noise (M,)."""
    return correct(core.factor, core.factor.T @ rows.T, np.diag(sigmas), innovation)
