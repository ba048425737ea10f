# SPDX-License-Identifier: BSD-3-Clause
"""What is known of a frame besides what it sees: the IMU's word, an odometry's, or that motion goes on."""

from collections.abc import Iterator

import gtsam
import numpy as np

from coclo_vio.backend.window import factors
from coclo_vio.backend.window.config import SmootherConfig
from coclo_vio.backend.window.exchange import Told
from coclo_vio.backend.window.inertial import Preintegration
from coclo_vio.backend.window.motion import Motion, SteadyMotion
from coclo_vio.backend.window.start import HELD_SIGMA
from coclo_vio.backend.window.window import Window
from coclo_vio.geometry import so3
from coclo_vio.values.arrays import Array
from coclo_vio.values.keyframes import OdometryDelta
from coclo_vio.values.units import GRAVITY_MPS2, NS_PER_S

_CARRIED_BIAS = (0.05, 0.005)  # m/s^2 and rad/s: how well biases are known across a silence of the IMU


class Expectation:
    """Motion since the last keyframe; an odometry is believed before the IMU, the IMU before steadiness."""

    def __init__(self, config: SmootherConfig, imu: Preintegration | None, steady: SteadyMotion) -> None:
        self._config, self._imu, self._steady = config, imu, steady

    def of_frame(
        self,
        window: Window,
        stamp_ns: int,
        odometry: OdometryDelta | None,
        bias: gtsam.imuBias.ConstantBias,
        keyframe_covariance: Array,
    ) -> Motion:
        """Where the body should be at ``stamp_ns``.

        Args:
            window: whose newest keyframe the motion starts from.
            stamp_ns: not before what the IMU has been integrated to.
            odometry: the motion since that keyframe, if something measured it.
            bias: of the IMU.
            keyframe_covariance: of that keyframe's [pose, velocity, accelerometer and gyroscope bias], (15, 15).
        """
        steady = self._steady.at(stamp_ns)
        newest = window.newest.number
        is_felt = self._imu is not None and self._imu.advance(stamp_ns)
        if odometry is not None:
            covariance = odometry.covariance + np.eye(6) * HELD_SIGMA**2
            T = window.pose(newest) @ odometry.T_start_end
            return Motion(T, steady.velocity_world, covariance, np.zeros((3, 3)), is_measured=True)
        if self._imu is None or not is_felt:
            return steady
        return self._felt(self._imu, window, bias, keyframe_covariance)

    @staticmethod
    def _felt(
        imu: Preintegration, window: Window, bias: gtsam.imuBias.ConstantBias, keyframe_covariance: Array
    ) -> Motion:
        """The motion that the IMU felt, relative to the keyframe and so to the landmarks around it.

        Position and velocity at the end err together: by velocity, tilt and accelerometer bias of the keyframe and by
        the readings' noise (Forster et al. 2017, equations 37 and 63, biases to first order over a short time).
        """
        number, dt_s = window.newest.number, imu.measured.deltaTij()
        before = gtsam.NavState(gtsam.Pose3(window.pose(number)), window.velocity(number))
        felt = imu.measured.predict(before, bias)
        to_body = np.asarray(before.pose().rotation().matrix()).T
        gravity, speed = to_body @ np.array([0.0, 0.0, -GRAVITY_MPS2]), to_body @ window.velocity(number)
        mounted = imu.T_body_imu[:3, :3]
        shift, swing = np.zeros((3, 15)), np.zeros((3, 15))  # of position and velocity, axes of the keyframe's body
        shift[:, :3] = so3.hat(speed * dt_s + 0.5 * gravity * dt_s**2)
        swing[:, :3] = so3.hat(speed + gravity * dt_s)
        shift[:, 6:9], swing[:, 6:9] = to_body * dt_s, to_body
        shift[:, 9:12], swing[:, 9:12] = -0.5 * mounted * dt_s**2, -mounted * dt_s
        noise = np.array(imu.measured.preintMeasCov())
        position = shift @ keyframe_covariance @ shift.T + noise[3:6, 3:6] + np.eye(3) * HELD_SIGMA**2
        both = swing @ keyframe_covariance @ shift.T + noise[6:9, 3:6]
        turned = np.asarray(felt.pose().rotation().matrix()).T @ to_body.T  # axes of the keyframe's body to the frame's
        covariance = np.zeros((6, 6))
        drift = mounted @ keyframe_covariance[12:, 12:] @ mounted.T * dt_s**2
        covariance[:3, :3] = turned @ (noise[:3, :3] + drift) @ turned.T + np.eye(3) * HELD_SIGMA**2
        covariance[3:, 3:] = turned @ position @ turned.T
        gain = to_body.T @ both @ np.linalg.inv(position) @ to_body
        return Motion(np.asarray(felt.pose().matrix()), np.asarray(felt.velocity()), covariance, gain, is_measured=True)

    @property
    def has_inertial_tie(self) -> bool:
        """Whether the readings since the last keyframe can be integrated."""
        imu = self._imu
        return imu is not None and imu.start_ns is not None and not imu.has_gap and imu.measured.deltaTij() > 0.0

    def ties(
        self,
        window: Window,
        stamp_ns: int,
        motion: Motion,
        told: Told,
        bias: gtsam.imuBias.ConstantBias,
    ) -> Iterator[factors.Term]:
        """What ties the next keyframe, at ``stamp_ns``, to the newest one, besides landmarks."""
        start, end = window.newest.number, window.newest.number + 1
        evidence = None if told.evidence is None else factors.evidence(start, end, told.evidence)
        if evidence is not None:
            yield evidence
        elif told.odometry is not None:
            yield factors.relative_pose(start, end, told.odometry.T_start_end, told.odometry.covariance)
        if self._imu is not None and self.has_inertial_tie:
            yield factors.inertial(start, end, self._imu.measured)
            return
        if self._imu is not None:
            known = bias.vector()
            yield factors.velocity_prior(end, motion.velocity_world, self._config.start.moving_velocity_mps)
            yield factors.bias_prior(end, known[:3], known[3:], np.repeat(_CARRIED_BIAS, 3))
        if told.odometry is None:
            age_s = (stamp_ns - window.newest.stamp_ns) / NS_PER_S
            T_start_end, covariance = self._steady.since_keyframe(age_s)
            yield factors.relative_pose(start, end, T_start_end, covariance)
