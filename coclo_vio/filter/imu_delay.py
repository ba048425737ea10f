# SPDX-License-Identifier: BSD-3-Clause
"""Delay of the gyroscope's readings behind those of the joints, from the rotation by standing feet.

An IMU low-passes before it samples: 3 to 5 ms with a bandwidth of 40 to 60 Hz, and its stamps are often those of
arrival. A reading that is late by ``d`` integrates over an interval to the rotation of the body less ``d`` times the
change of its rate. On a walking robot that is a few tenths of a milliradian at each keyframe, more than the noise of
a gyroscope over that time and more than the error of a stereo camera. Feet that stand throughout an interval measure
its rotation by encoders; with the rotation vector ``theta`` from the gyroscope's rotation to theirs,

    theta = d (w_end - w_start) + b dt + noise,

which is linear in the delay and in an error ``b`` of the bias: recursive least squares with a fading memory. Legs that
bend move their feet with the same accelerations that change the rate, so feet are off by a few milliseconds for long.
Cameras are not, but their stamps may be; where they measure the delay, both count.
Source: the rotational part of Kelly and Sukhatme, "Visual-inertial sensor fusion", 2011.
"""

import numpy as np

from coclo_vio.filter.leg_intervals import translations_between
from coclo_vio.geometry import so3
from coclo_vio.robot.leg_sensing import Reading
from coclo_vio.values.arrays import Array, BoolArray
from coclo_vio.values.units import NS_PER_S

_INTERVAL_NS = 99_000_000  # about half a period of what shakes a walking body; stamps jitter
_PAUSE_NS = 90_000_000  # until the next interval
_LONGEST_STEP_NS = 60_000_000
_FEWEST_FEET = 2
_BIAS_SIGMA_RADPS = 0.01  # of what the filter's bias leaves
_MEMORY_S = 60.0
_GATE = 18.5  # chi-square, four degrees of freedom, one in 1,000, of the change by one interval
_LONGEST_S = 0.03  # delays beyond this are faults, not low-passes
_BENDING_S, _IMAGES_S = 0.003, 0.001  # one sigma of what legs that bend, and stamps of images, are off for long
_WIDE_S = 0.02
_LEAST_NOISE_SCALE, _MOST_NOISE_SCALE = 0.5, 10.0
_NOISE_MEMORY = 50.0  # intervals


class ImuDelay:
    """The delay by what standing feet and gyroscope have measured.

    Args:
        radii_m: of the feet, (n,).
        foot_m: one sigma of a foot position by its encoders and by bending, m.
        expected_s: the delay before anything is measured, s; positive where the gyroscope is late.
        sigma_s: one sigma of that, s; 0: the delay is known.
    """

    def __init__(self, radii_m: Array, foot_m: float, expected_s: float, sigma_s: float) -> None:
        self._expected = expected_s, sigma_s
        self._by_legs: tuple[float, float] | None = None
        self._by_images: tuple[float, float] | None = None
        self._radii_m, self._variance = radii_m, 2.0 * foot_m**2
        self._prior = np.diag(1.0 / np.square([_WIDE_S, *[_BIAS_SIGMA_RADPS] * 3]))
        self._information, self._vector = np.zeros((4, 4)), np.zeros(4)
        self._covariance = np.linalg.inv(self._prior)
        self._noise_scale = 1.0  # of variances
        self._begin: tuple[Reading, Array] | None = None
        self._steps: list[tuple[float, Array]] = []  # length, s, and mean rate, rad/s
        self._rate: Array = np.zeros(3)
        self._stood: BoolArray = np.zeros(len(radii_m), dtype=np.bool_)
        self._last_ns = self._next_ns = 0

    def push(self, reading: Reading, up_body: Array, bias: Array) -> None:
        """Take a reading.

        Args:
            reading: of the legs and the gyroscope.
            up_body: upward direction, body axes, (3,).
            bias: of the gyroscope as the filter knows it, rad/s, (3,).
        """
        rate, step_ns = reading.angular_velocity, reading.stamp_ns - self._last_ns
        self._last_ns = reading.stamp_ns
        if self._begin is None and reading.stamp_ns < self._next_ns:
            return
        if rate is None:
            self._begin = None
            return
        if self._begin is None or step_ns > _LONGEST_STEP_NS:
            self._start(reading, rate, up_body)
            return
        self._steps.append((step_ns / NS_PER_S, 0.5 * (self._rate + rate) - bias))
        self._rate, self._stood = rate, self._stood & reading.is_stance
        begin, up = self._begin
        if reading.stamp_ns - begin.stamp_ns >= _INTERVAL_NS:
            if np.count_nonzero(self._stood) >= _FEWEST_FEET and begin.angular_velocity is not None:
                self._compare(begin, reading, up, rate - begin.angular_velocity)
            self._begin, self._next_ns = None, reading.stamp_ns + _PAUSE_NS

    def _start(self, reading: Reading, rate: Array, up_body: Array) -> None:
        self._begin, self._steps = (reading, up_body), []
        self._rate, self._stood = rate, reading.is_stance

    def _compare(self, begin: Reading, end: Reading, up: Array, rate_change: Array) -> None:
        durations, rates = zip(*self._steps, strict=True)
        turn = np.eye(3)
        for each in so3.exp(np.array(rates) * np.array(durations)[:, None]):
            turn = turn @ each
        moved, levers = translations_between(begin, end, turn, up, self._radii_m)
        moved, levers = moved[self._stood], levers[self._stood]
        moved, levers = moved - moved.mean(axis=0), levers - levers.mean(axis=0)  # what all feet share is the motion
        rows = so3.hat(levers).reshape(-1, 3)  # theta x lever = -hat(lever) theta
        derivatives = np.concatenate((rate_change[:, None], float(sum(durations)) * np.eye(3)), axis=1)
        self._add(rows @ derivatives, moved.ravel(), float(sum(durations)))

    def _add(self, rows: Array, measured: Array, dt_s: float) -> None:
        """Take ``measured = -rows @ [delay, bias] + noise`` of the feet, m, (3 k, 4) and (3 k,)."""
        off = measured + rows @ (self._covariance @ self._vector)
        freedom = len(measured) - 6
        if freedom > 0:
            self._follow_noise(float(off @ off) / (freedom * self._variance))
        weight = 1.0 / (self._variance * self._noise_scale)
        information = weight * rows.T @ rows
        along = weight * rows.T @ off
        excess = along @ np.linalg.solve(self._prior + self._information + information, along)
        if excess > _GATE:
            return
        kept = float(np.exp(-dt_s / _MEMORY_S))
        self._information = kept * self._information + information
        self._vector = kept * self._vector - weight * rows.T @ measured
        self._covariance = np.linalg.inv(self._prior + self._information)
        own_s, sigma_s = float(self._covariance[0] @ self._vector), float(np.sqrt(self._covariance[0, 0]))
        self._by_legs = own_s, float(np.hypot(sigma_s, _BENDING_S))

    def _follow_noise(self, ratio: float) -> None:
        """Let the noise of feet follow what is left of their positions, in which bending and slip are."""
        scale = self._noise_scale + (min(ratio, 4.0 * self._noise_scale) - self._noise_scale) / _NOISE_MEMORY
        self._noise_scale = min(max(scale, _LEAST_NOISE_SCALE), _MOST_NOISE_SCALE)

    def measure(self, delay_s: float, sigma_s: float) -> None:
        """Take the delay behind the images, with one sigma, s: all that cameras have measured until now."""
        self._by_images = delay_s, float(np.hypot(sigma_s, _IMAGES_S))

    @property
    def by_legs_s(self) -> float:
        """The delay by what is expected and by the legs, s."""
        return _fused(self._expected, self._by_legs)

    @property
    def value_s(self) -> float:
        """The delay by what is expected, by the legs and by the cameras, s."""
        return _fused(self._expected, self._by_legs, self._by_images)


def _fused(expected: tuple[float, float], *measured: tuple[float, float] | None) -> float:
    """The mean of values with one sigma each, bounded; the expected one where that is known."""
    if expected[1] == 0.0:
        return expected[0]
    known = [expected, *(each for each in measured if each is not None)]
    weights = [1.0 / sigma**2 for _, sigma in known]
    mean = sum(weight * value for weight, (value, _) in zip(weights, known, strict=True)) / sum(weights)
    return min(max(mean, -_LONGEST_S), _LONGEST_S)
