# SPDX-License-Identifier: BSD-3-Clause
"""Relative motion from the measured twist of the body, of wheels or a controller, as weak odometry."""

import numpy as np

from coclo_vio.backend.window.config import TwistConfig
from coclo_vio.geometry import se3
from coclo_vio.values.arrays import Array
from coclo_vio.values.keyframes import OdometryDelta
from coclo_vio.values.measurements import BodyTwistSample
from coclo_vio.values.units import NS_PER_S

_FLOOR = 1e-5  # rad and m: a delta over a very short time still has an invertible covariance


class TwistOdometry:
    """Integrates twists since a keyframe, interpolated linearly between samples."""

    def __init__(self, config: TwistConfig | None = None) -> None:
        config = config or TwistConfig()
        densities = np.repeat([config.rate_noise_density, config.velocity_noise_density], 3)
        self._density = np.diag(np.square(densities))
        self._sample: BodyTwistSample | None = None
        self._start_ns: int | None = None
        self._now_ns = 0
        self._T_start_now = np.eye(4)
        self._covariance = np.zeros((6, 6))

    def push(self, sample: BodyTwistSample) -> None:
        """Take a twist; one that is not newer than the last is left out."""
        before = self._sample
        if before is not None and sample.stamp_ns <= before.stamp_ns:
            return
        self._sample = sample
        if self._start_ns is not None:
            self._advance(
                sample.stamp_ns, _twist(sample) if before is None else 0.5 * (_twist(before) + _twist(sample))
            )

    def restart(self, stamp_ns: int) -> None:
        """Start a delta anew at ``stamp_ns``."""
        self._start_ns = self._now_ns = stamp_ns
        self._T_start_now, self._covariance = np.eye(4), np.zeros((6, 6))

    def delta_until(self, stamp_ns: int) -> OdometryDelta | None:
        """The motion from the last ``restart`` to ``stamp_ns``; None without a start or a twist.

        Between the last sample and ``stamp_ns`` the twist is constant.
        """
        if self._start_ns is None or self._sample is None or stamp_ns <= self._start_ns:
            return None
        self._advance(stamp_ns, _twist(self._sample))
        covariance = self._covariance + np.eye(6) * _FLOOR**2
        return OdometryDelta(self._start_ns, stamp_ns, self._T_start_now, covariance)

    def _advance(self, stamp_ns: int, twist: Array) -> None:
        dt_s = (stamp_ns - self._now_ns) / NS_PER_S
        if dt_s <= 0.0:
            return
        step = se3.exp(twist * dt_s)
        back = se3.adjoint(se3.inverse(step))
        self._covariance = back @ self._covariance @ back.T + self._density * dt_s
        self._T_start_now = self._T_start_now @ step
        self._now_ns = stamp_ns


def _twist(sample: BodyTwistSample) -> Array:
    return np.concatenate((sample.angular_velocity, sample.velocity))
