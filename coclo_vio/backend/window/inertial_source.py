# SPDX-License-Identifier: BSD-3-Clause
"""The IMU as a source: preintegrated readings predict a frame and tie two keyframes, with velocity and biases."""

from collections.abc import Mapping, Sequence
from typing import Any

import gtsam
import numpy as np

from coclo_vio.backend.window import factors
from coclo_vio.backend.window.config import SmootherConfig
from coclo_vio.backend.window.factors import Term
from coclo_vio.backend.window.inertial import Preintegration
from coclo_vio.backend.window.keyframe_source import FirstKeyframe, KeyframeSource, KeyframeState, Ties
from coclo_vio.backend.window.motion_model import PredictedMotion
from coclo_vio.backend.window.start import FIXED_SIGMA
from coclo_vio.backend.window.variables import BIASES, POSE, VELOCITY, Variable
from coclo_vio.geometry import so3
from coclo_vio.robot.standstill import ImuMeans
from coclo_vio.values.arrays import Array
from coclo_vio.values.calibration import ImuCalibration
from coclo_vio.values.measurements import InertialReading
from coclo_vio.values.units import GRAVITY_MPS2

_GAP_BIAS_SIGMAS = (0.05, 0.005)  # m/s^2 and rad/s: of the biases after a gap in the IMU's readings
_DROPPED_BIAS_SIGMAS = (0.05, 0.002)  # the same after the past was dropped
_REST_OVERLAP_NS = 500_000_000  # of a rest that is integrated with the motion after it: both show tilt and bias


class InertialSource(KeyframeSource):
    """Preintegrated IMU readings.

    Attributes:
        preintegration: of the readings since the newest keyframe.
        bias: at the newest keyframe.
    """

    def __init__(self, imu: ImuCalibration, config: SmootherConfig) -> None:
        self._config, own = config, config.inertial
        self._bias_sigmas = (
            imu.accelerometer_bias if own.accelerometer_bias is None else own.accelerometer_bias,
            imu.gyroscope_bias if own.gyroscope_bias is None else own.gyroscope_bias,
        )
        self.preintegration = Preintegration(imu, config.inertial)
        self.bias = gtsam.imuBias.ConstantBias()
        self._bias_covariance = np.eye(BIASES.dimensions)

    @property
    def variables(self) -> Sequence[Variable]:
        """Velocity and biases."""
        return (VELOCITY, BIASES)

    @property
    def measures_gravity(self) -> bool:
        """The accelerometer does."""
        return True

    @property
    def rate_body(self) -> Array:
        """Newest angular velocity without its bias, rad/s, body frame, (3,)."""
        return np.asarray(self.preintegration.rate_body - self.biases_body[0])

    @property
    def biases_body(self) -> tuple[Array, Array]:
        """Of gyroscope and accelerometer, rad/s and m/s^2, body frame, (3,) each."""
        to_body = self.preintegration.T_body_imu[:3, :3]
        return to_body @ self.bias.gyroscope(), to_body @ self.bias.accelerometer()

    def push(self, sample: InertialReading) -> None:
        """Take a reading."""
        self.preintegration.push(sample)

    def forget(self) -> None:
        """The biases are not known; ``level`` comes next."""
        self.bias = gtsam.imuBias.ConstantBias()

    def level(self, rest: ImuMeans | None, gyroscope_sigma_radps: float | None) -> None:
        """The biases before the start: the gyroscope's from a rest, where there is one, with its sigma."""
        if rest is not None:
            self.bias = gtsam.imuBias.ConstantBias(np.zeros(3), rest.angular_velocity)
        accelerometer_sigma, gyroscope_sigma = self._bias_sigmas
        rate_sigma = gyroscope_sigma if gyroscope_sigma_radps is None else gyroscope_sigma_radps
        sigmas = np.repeat([accelerometer_sigma, rate_sigma], 3)
        self._bias_covariance = np.diag(sigmas**2)

    def begin(self, number: int, stamp_ns: int, velocity_world: Array, velocity_sigma_mps: float) -> FirstKeyframe:
        """Velocity as given, and the biases as they are known."""
        self.preintegration.restart(stamp_ns, self.bias)
        sigmas, bias = np.sqrt(np.diag(self._bias_covariance)), self.bias.vector()
        return FirstKeyframe(
            values={VELOCITY: velocity_world, BIASES: self.bias},
            covariances={BIASES: self._bias_covariance},
            terms=[
                factors.velocity_prior(number, velocity_world, velocity_sigma_mps),
                factors.bias_prior(number, bias[:3], bias[3:], sigmas),
            ],
        )

    def expect(self, newest: KeyframeState, stamp_ns: int, steady: PredictedMotion) -> PredictedMotion | None:
        """By the preintegrated readings; None without any, or with a gap in them."""
        return self._predicted(newest) if self.preintegration.advance(stamp_ns) else None

    def _predicted(self, newest: KeyframeState) -> PredictedMotion:
        """The preintegrated motion, relative to the keyframe and so to the landmarks around it.

        Errors of position and velocity at the end are correlated: both come from velocity, tilt and accelerometer bias
        of the keyframe and from the readings' noise (Forster et al. 2017, equations 37 and 63, biases to first order
        over a short time).
        """
        measured, velocity = self.preintegration.measured, newest.value(VELOCITY)
        keyframe_covariance = newest.covariance_of(POSE, VELOCITY, BIASES)
        dt_s = measured.deltaTij()
        before = gtsam.NavState(newest.value(POSE), velocity)
        end = measured.predict(before, self.bias)
        to_body = np.asarray(before.pose().rotation().matrix()).T
        gravity, speed = to_body @ np.array([0.0, 0.0, -GRAVITY_MPS2]), to_body @ velocity
        mounted = self.preintegration.T_body_imu[:3, :3]
        J_position, J_velocity = np.zeros((3, 15)), np.zeros((3, 15))  # in axes of the keyframe's body
        J_position[:, :3] = so3.hat(speed * dt_s + 0.5 * gravity * dt_s**2)
        J_velocity[:, :3] = so3.hat(speed + gravity * dt_s)
        J_position[:, 6:9], J_velocity[:, 6:9] = to_body * dt_s, to_body
        J_position[:, 9:12], J_velocity[:, 9:12] = -0.5 * mounted * dt_s**2, -mounted * dt_s
        noise = np.array(measured.preintMeasCov())
        position = J_position @ keyframe_covariance @ J_position.T + noise[3:6, 3:6] + np.eye(3) * FIXED_SIGMA**2
        cross = J_velocity @ keyframe_covariance @ J_position.T + noise[6:9, 3:6]
        turned = np.asarray(end.pose().rotation().matrix()).T @ to_body.T  # axes of the keyframe's body to the frame's
        covariance = np.zeros((6, 6))
        drift = mounted @ keyframe_covariance[12:, 12:] @ mounted.T * dt_s**2
        covariance[:3, :3] = turned @ (noise[:3, :3] + drift) @ turned.T + np.eye(3) * FIXED_SIGMA**2
        covariance[3:, 3:] = turned @ position @ turned.T
        gain = to_body.T @ cross @ np.linalg.inv(position) @ to_body
        T_world_body, velocity = np.asarray(end.pose().matrix()), np.asarray(end.velocity())
        return PredictedMotion(T_world_body, velocity, covariance, gain, is_measured=True)

    def ties(self, newest: KeyframeState, stamp_ns: int, motion: PredictedMotion) -> Ties:
        """The preintegrated readings; after a gap in them, priors on velocity and biases."""
        imu, end = self.preintegration, newest.number + 1
        if imu.start_ns is not None and not imu.has_gap and imu.measured.deltaTij() > 0.0:
            return Ties([factors.inertial(newest.number, end, imu.measured)], has_motion=True)
        known, sigmas = self.bias.vector(), np.repeat(_GAP_BIAS_SIGMAS, 3)
        moving = self._config.start.moving_velocity_mps
        terms = [
            factors.velocity_prior(end, motion.velocity_world, moving),
            factors.bias_prior(end, known[:3], known[3:], sigmas),
        ]
        gap = (
            f"IMU readings since the last keyframe are missing, or pause for more than "
            f"{self._config.inertial.max_gap_s} s; this keyframe gets no IMU factor"
        )
        return Ties(terms, gap=gap)

    def initial(self, motion: PredictedMotion) -> Mapping[Variable, Any]:
        """The expected velocity and the known biases."""
        return {VELOCITY: motion.velocity_world, BIASES: self.bias}

    def update(self, newest: KeyframeState) -> None:
        """Take over the biases."""
        self.bias, self._bias_covariance = newest.value(BIASES), newest.covariance_of(BIASES)

    def restart(self, newest: KeyframeState) -> None:
        """Integrate from this keyframe on."""
        self.preintegration.restart(newest.stamp_ns, self.bias)

    def priors(self, keyframe: KeyframeState) -> Sequence[Term]:
        """On velocity, with the covariance's size in every direction, and biases."""
        sigma = float(np.sqrt(np.trace(keyframe.covariance_of(VELOCITY))))
        bias, sigmas = keyframe.value(BIASES).vector(), np.repeat(_DROPPED_BIAS_SIGMAS, 3)
        return (
            factors.velocity_prior(keyframe.number, keyframe.value(VELOCITY), sigma),
            factors.bias_prior(keyframe.number, bias[:3], bias[3:], sigmas),
        )

    def rest(self, number: int, rate: Array, rate_sigma_radps: float, speed_sigma_mps: float) -> Sequence[Term]:
        """No velocity, and the gyroscope's bias."""
        return factors.rest(number, speed_sigma_mps, rate, rate_sigma_radps)

    def stay(self, stamp_ns: int) -> None:
        """Integrate from the end of the rest on, not all of it."""
        start_ns = self.preintegration.start_ns
        if start_ns is None or stamp_ns - start_ns > 2 * _REST_OVERLAP_NS:
            self.preintegration.restart(stamp_ns - _REST_OVERLAP_NS, self.bias)
