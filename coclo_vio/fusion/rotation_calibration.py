# SPDX-License-Identifier: BSD-3-Clause
"""Errors between cameras and gyroscope from the rotations that both measure: mounting, delay of images, bias.

Over an interval of length ``dt`` from a rate ``w_start`` to ``w_end`` the gyroscope measures the rotation vector ``g``
and the cameras, through their calibrated mounting, ``v``. With cameras whose calibrated mounting is turned by
``E = exp(e)`` against the true one (``R_body_camera(calibrated) = E R_body_camera(true)``), image stamps that are late
by ``d``, and a bias ``b`` that ``g`` still contains,

    v = g + e x g - d (w_end - w_start) - b dt + noise,

which is linear in the seven unknowns: recursive least squares, that is a Kalman filter of constants whose bias walks.
Intervals with a large innovation are not used. The noise of ``v`` is what its residuals claim times a factor, which
follows from the innovations: stereo residuals know nothing of what all points share.
Source: the rotational part of Kelly and Sukhatme, "Visual-inertial sensor fusion", 2011.
"""

from collections import deque
from dataclasses import dataclass

import numpy as np

from coclo_vio.geometry import so3
from coclo_vio.values.arrays import Array

MOUNTING, BIAS, DELAY = slice(0, 3), slice(3, 6), 6
_MOUNTING_SIGMA_RAD = 0.09  # 5 deg: what is sought
_BIAS_SIGMA_RADPS = 0.02
_DELAY_SIGMA_S = 0.03
_STEP_SHARE = 0.1  # of a step of the bias, as its sigma
_BIAS_WALK = 2e-4  # rad/s/sqrt(s)
_FLOOR_RAD = 2e-4  # least noise of a rotation, each axis
_START_FACTOR, _LEAST_FACTOR, _MOST_FACTOR = 3.0, 1.5, 10.0  # of what residuals claim
_MEDIAN_OF_CHI2 = 2.37  # three degrees of freedom
_REMEMBERED = 30  # intervals
_TURN_SIGMAS = 8.0
_GATE = 21.1  # chi-square, three degrees of freedom, one in 10,000


@dataclass(frozen=True, slots=True, eq=False)
class RotationPair:
    """The same rotation of the body by cameras and gyroscope.

    Attributes:
        T_start_end: motion of the body by the cameras through their calibrated mounting, (4, 4).
        by_vision: its rotation vector, body axes at the start, rad, (3,).
        covariance: of that, by the residuals, (3, 3).
        by_gyroscope: the same by the gyroscope, rad, (3,).
        rate_change: rate at the end less rate at the start, rad/s, (3,).
        dt_s: length of the interval, s.
    """

    T_start_end: Array
    by_vision: Array
    covariance: Array
    by_gyroscope: Array
    rate_change: Array
    dt_s: float


@dataclass(frozen=True, slots=True, eq=False)
class RotationInnovation:
    """How far a pair lies from what is known of the errors.

    Attributes:
        value: cameras less expected, rad, (3,).
        squared: normalised, chi-square with three degrees of freedom.
        turns_significantly: whether the cameras turn by many sigmas, without which agreement shows nothing.
    """

    value: Array
    squared: float
    turns_significantly: bool

    @property
    def is_accepted(self) -> bool:
        """Whether the pair was used."""
        return self.squared <= _GATE


class RotationCalibration:
    """The estimate of mounting (3, rad), bias (3, rad/s) and delay (s), with its covariance.

    Attributes:
        mean: in that order, (7,).
        covariance: (7, 7).
        pairs: number of intervals that were used.
    """

    def __init__(self) -> None:
        self.mean: Array = np.zeros(7)
        sigmas = [*[_MOUNTING_SIGMA_RAD] * 3, *[_BIAS_SIGMA_RADPS] * 3, _DELAY_SIGMA_S]
        self.covariance: Array = np.diag(np.square(sigmas))
        self.pairs = 0
        self._ratios: deque[float] = deque(maxlen=_REMEMBERED)
        self._factor = _START_FACTOR

    def innovation(self, pair: RotationPair) -> tuple[RotationInnovation, Array, Array]:
        """How far an interval is from what is known, derivatives by the errors (3, 7), and noise of it (3, 3)."""
        rows = np.zeros((3, 7))
        rows[:, MOUNTING] = -so3.hat(pair.by_gyroscope)
        rows[:, BIAS] = -pair.dt_s * np.eye(3)
        rows[:, DELAY] = -pair.rate_change
        value = pair.by_vision - pair.by_gyroscope - rows @ self.mean
        noise = self._factor**2 * pair.covariance + np.eye(3) * _FLOOR_RAD**2
        spread = rows @ self.covariance @ rows.T + noise
        turns = bool(pair.by_vision @ pair.by_vision > _TURN_SIGMAS**2 * noise.trace() / 3.0)
        return RotationInnovation(value, float(value @ np.linalg.solve(spread, value)), turns), rows, noise

    def add(self, pair: RotationPair) -> RotationInnovation:
        """Take an interval; its innovation before, by which it is used or left out."""
        self.covariance[BIAS, BIAS] += np.eye(3) * _BIAS_WALK**2 * pair.dt_s
        innovation, rows, noise = self.innovation(pair)
        value = innovation.value
        if innovation.is_accepted:
            gain = self.covariance @ rows.T @ np.linalg.inv(rows @ self.covariance @ rows.T + noise)
            self.mean = self.mean + gain @ value
            kept = np.eye(7) - gain @ rows
            self.covariance = kept @ self.covariance @ kept.T + gain @ noise @ gain.T
            self.pairs += 1
            self._follow_noise(pair, value - rows @ gain @ value)
        return innovation

    def step_bias(self, by: Array) -> None:
        """The gyroscope's bias has changed by about this much, rad/s, (3,); its sigma is large again."""
        self.mean = self.mean.copy()
        self.mean[BIAS] += by
        self.covariance[BIAS] = self.covariance[:, BIAS] = 0.0
        self.covariance[BIAS, BIAS] = np.eye(3) * (_STEP_SHARE * float(np.linalg.norm(by))) ** 2

    def remove_delay(self, delay_s: float) -> None:
        """Stamps of images are corrected by this from now on, s."""
        self.mean = self.mean.copy()
        self.mean[DELAY] -= delay_s

    def _follow_noise(self, pair: RotationPair, residual: Array) -> None:
        """Let the factor of the claimed noise follow the residuals."""
        claimed = pair.covariance + np.eye(3) * (_FLOOR_RAD / self._factor) ** 2
        self._ratios.append(float(residual @ np.linalg.solve(claimed, residual)))
        if len(self._ratios) >= _REMEMBERED // 3:
            factor = float(np.sqrt(np.median(self._ratios) / _MEDIAN_OF_CHI2))
            self._factor = min(max(factor, _LEAST_FACTOR), _MOST_FACTOR)
