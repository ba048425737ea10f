# SPDX-License-Identifier: BSD-3-Clause
"""The motion from the last keyframe to a frame, without its tracks: by odometry, by the IMU, or at constant velocity.

It predicts the frame, and it is the factor between two keyframes.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import gtsam
import numpy as np

from coclo_vio.backend.window import factors
from coclo_vio.backend.window.config import SmootherConfig
from coclo_vio.backend.window.inertial import Preintegration
from coclo_vio.backend.window.motion_model import ConstantVelocityModel, PredictedMotion
from coclo_vio.backend.window.start import FIXED_SIGMA
from coclo_vio.backend.window.window import Window
from coclo_vio.geometry import so3
from coclo_vio.values.arrays import Array
from coclo_vio.values.keyframes import OdometryDelta, PoseEvidence
from coclo_vio.values.units import GRAVITY_MPS2, NS_PER_S

_GAP_BIAS_SIGMAS = (0.05, 0.005)  # m/s^2 and rad/s: of the biases after a gap in the IMU's readings


@dataclass(frozen=True, slots=True, eq=False)
class ExternalOdometry:
    """What another sensor or estimator measured between the last keyframe and a frame.

    Attributes:
        delta: the motion from the last keyframe to the frame.
        evidence: of the poses at both times; where the frame becomes a keyframe, it replaces the motion, whose
            information it contains.
    """

    delta: OdometryDelta | None = None
    evidence: PoseEvidence | None = None


class MotionPredictor:
    """Motion since the last keyframe: by odometry where there is any, otherwise by the IMU, or at constant velocity."""

    def __init__(
        self, config: SmootherConfig, imu: Preintegration | None, velocity_model: ConstantVelocityModel
    ) -> None:
        self._config, self._imu, self._velocity_model = config, imu, velocity_model

    def predict(
        self,
        window: Window,
        stamp_ns: int,
        odometry: OdometryDelta | None,
        bias: gtsam.imuBias.ConstantBias,
        keyframe_covariance: Array,
    ) -> PredictedMotion:
        """Where the body should be at ``stamp_ns``.

        Args:
            window: the motion starts from its newest keyframe.
            stamp_ns: not before the time to which the IMU has been integrated.
            odometry: the motion since that keyframe, if it was measured.
            bias: of the IMU.
            keyframe_covariance: of that keyframe's [pose, velocity, accelerometer and gyroscope bias], (15, 15).
        """
        at_constant_velocity = self._velocity_model.at(stamp_ns)
        newest = window.newest.number
        has_readings = self._imu is not None and self._imu.advance(stamp_ns)
        if odometry is not None:
            velocity, covariance = at_constant_velocity.velocity_world, odometry.covariance + np.eye(6) * FIXED_SIGMA**2
            T = window.pose(newest) @ odometry.T_start_end
            return PredictedMotion(T, velocity, covariance, np.zeros((3, 3)), is_measured=True)
        if self._imu is None or not has_readings:
            return at_constant_velocity
        return self._inertial(self._imu, window, bias, keyframe_covariance)

    @staticmethod
    def _inertial(
        imu: Preintegration, window: Window, bias: gtsam.imuBias.ConstantBias, keyframe_covariance: Array
    ) -> PredictedMotion:
        """The preintegrated motion, relative to the keyframe and so to the landmarks around it.

        Errors of position and velocity at the end are correlated: both come from velocity, tilt and accelerometer bias
        of the keyframe and from the readings' noise (Forster et al. 2017, equations 37 and 63, biases to first order
        over a short time).
        """
        number, dt_s = window.newest.number, imu.measured.deltaTij()
        before = gtsam.NavState(gtsam.Pose3(window.pose(number)), window.velocity(number))
        end = imu.measured.predict(before, bias)
        to_body = np.asarray(before.pose().rotation().matrix()).T
        gravity, speed = to_body @ np.array([0.0, 0.0, -GRAVITY_MPS2]), to_body @ window.velocity(number)
        mounted = imu.T_body_imu[:3, :3]
        J_position, J_velocity = np.zeros((3, 15)), np.zeros((3, 15))  # in axes of the keyframe's body
        J_position[:, :3] = so3.hat(speed * dt_s + 0.5 * gravity * dt_s**2)
        J_velocity[:, :3] = so3.hat(speed + gravity * dt_s)
        J_position[:, 6:9], J_velocity[:, 6:9] = to_body * dt_s, to_body
        J_position[:, 9:12], J_velocity[:, 9:12] = -0.5 * mounted * dt_s**2, -mounted * dt_s
        noise = np.array(imu.measured.preintMeasCov())
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

    @property
    def has_inertial_term(self) -> bool:
        """Whether the readings since the last keyframe can be integrated."""
        imu = self._imu
        return imu is not None and imu.start_ns is not None and not imu.has_gap and imu.measured.deltaTij() > 0.0

    def motion_terms(
        self,
        window: Window,
        stamp_ns: int,
        motion: PredictedMotion,
        external: ExternalOdometry,
        bias: gtsam.imuBias.ConstantBias,
    ) -> Iterator[factors.Term]:
        """The terms between the newest keyframe and the next one, at ``stamp_ns``, besides landmarks."""
        start, end = window.newest.number, window.newest.number + 1
        evidence = None if external.evidence is None else factors.evidence(start, end, external.evidence)
        if evidence is not None:
            yield evidence
        elif external.delta is not None:
            yield factors.relative_pose(start, end, external.delta.T_start_end, external.delta.covariance)
        if self._imu is not None and self.has_inertial_term:
            yield factors.inertial(start, end, self._imu.measured)
            return
        if self._imu is not None:
            known = bias.vector()
            yield factors.velocity_prior(end, motion.velocity_world, self._config.start.moving_velocity_mps)
            yield factors.bias_prior(end, known[:3], known[3:], np.repeat(_GAP_BIAS_SIGMAS, 3))
        if external.delta is None:
            age_s = (stamp_ns - window.newest.stamp_ns) / NS_PER_S
            T_start_end, covariance = self._velocity_model.since_keyframe(age_s)
            yield factors.relative_pose(start, end, T_start_end, covariance)
