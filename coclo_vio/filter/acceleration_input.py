# SPDX-License-Identifier: BSD-3-Clause
"""The accelerometer as what drives the velocity between joint samples, as far as legs agree with it.

Feet that touch down and lift off mislead for some 50 ms: they deflect, rebound and slide while they count as standing.
A velocity that is predicted to be constant follows them; one that is predicted by the accelerometer does not, over so
short a time. Impacts and vibration spoil an accelerometer by a factor of ten between robots, and a wrong mounting by
more, so what it predicts over a window is compared with how the velocity changed by all that the filter measured: from
that follows the noise of the prediction, and whether it is used at all.

The specific force moves the mean alone. Errors of tilt and bias are part of that noise, not of correlations: gravity is
measured by ``GravityWindow``, and no reading counts twice.
"""

from dataclasses import replace

import numpy as np

from coclo_vio.filter.config import RobustConfig
from coclo_vio.filter.square_root_filter import SquareRootFilter
from coclo_vio.filter.stance import Reading
from coclo_vio.filter.state import ACCELEROMETER_BIAS, POSITION, VELOCITY
from coclo_vio.values.arrays import Array
from coclo_vio.values.units import GRAVITY_MPS2

_WINDOW_S = 0.25  # about half a period of a gait: what feet do at a step cancels in part
_MEMORY = 8.0  # windows
_MOST_SHARE = 0.5  # of the density without an accelerometer: with more noise it is not used
_HOLD_S = 0.02  # a reading holds for so long where the IMU is slower than the joints
_MOST_MEAN_MPS2, _MEAN_S = 15.0, 0.03  # no body accelerates like this for so long: axes or signs are wrong


class AccelerationInput:
    """Velocity by the accelerometer, and the noise of it.

    Attributes:
        density: of the white acceleration that the last step is uncertain by, m/s^2/sqrt(Hz).
    """

    def __init__(self, config: RobustConfig, lever_cross: Array) -> None:
        """Take the densities, and the place of the accelerometer: ``w @ lever_cross`` is ``w x place``, (3, 3)."""
        self.density = self._without = config.acceleration_density
        self._least = config.acceleration_input_density
        self._lever_cross = lever_cross
        self._held: tuple[Array, Array] | None = None  # the last specific force and rate
        self._held_s = 0.0
        self._mean = np.zeros(3)  # acceleration over the last _MEAN_S, world
        self._impulse = np.zeros(3)  # since the window began, world, m/s
        self._velocity_then: Array | None = None
        self._window_s = self._weight = self._sum = 0.0

    @property
    def is_used(self) -> bool:
        """Whether the last step's velocity is by the accelerometer."""
        return self.density < self._without

    @property
    def noise_density(self) -> float | None:
        """Of what the accelerometer predicts, by the windows so far, m/s^2/sqrt(Hz); None before the first."""
        if self._weight == 0.0:
            return None
        return max(self._least, float(np.sqrt(self._sum / self._weight * _WINDOW_S)))

    def predict(self, core: SquareRootFilter, reading: Reading, dt_s: float, *, is_gap: bool) -> None:
        """Move the velocity of the mean over the step to a reading; the prediction of the filter comes after it."""
        self.density = self._without
        if is_gap:
            self._held = None
        sensed = None if is_gap else self._sensed(reading, dt_s)
        if sensed is None:
            self._close()
            return
        mean = core.mean
        vector = mean.vector
        force, turned = sensed
        change = mean.rotation @ ((force - vector[ACCELEROMETER_BIAS]) * dt_s - turned @ self._lever_cross)
        change[2] -= GRAVITY_MPS2 * dt_s
        self._mean = self._mean + (change - self._mean * dt_s) / max(_MEAN_S, dt_s)
        if self._velocity_then is None:
            self._velocity_then = vector[VELOCITY].copy()
        self._impulse = self._impulse + change
        self._window_s += dt_s
        noise = self.noise_density
        if noise is None or noise > _MOST_SHARE * self._without or float(self._mean @ self._mean) > _MOST_MEAN_MPS2**2:
            return
        self.density = noise
        moved = vector.copy()
        moved[VELOCITY] += change
        moved[POSITION] -= 0.5 * dt_s * change  # the prediction moves it by the velocity at the end
        core.mean = replace(mean, vector=moved)

    def learn(self, core: SquareRootFilter) -> None:
        """Compare a window that is complete with how the velocity changed; call it after the update of a step."""
        if self._velocity_then is None or self._window_s < _WINDOW_S:
            return
        off = (core.mean.vector[VELOCITY] - self._velocity_then - self._impulse) / self._window_s
        kept = 1.0 - 1.0 / _MEMORY
        self._weight, self._sum = kept * self._weight + 1.0, kept * self._sum + float(off @ off) / 3.0
        self._close()

    def _sensed(self, reading: Reading, dt_s: float) -> tuple[Array, Array] | None:
        """Specific force, m/s^2, and change of the rate since the last sample, rad/s, body; None where unknown."""
        before, force, rate = self._held, reading.specific_force, reading.angular_velocity
        if force is None or rate is None:
            self._held_s += dt_s
            is_old = before is None or self._held_s > _HOLD_S
            self._held = None if is_old else before
            return None if before is None or is_old else (before[0], np.zeros(3))
        self._held, self._held_s = (force, rate), 0.0
        return force, np.zeros(3) if before is None else rate - before[1]

    def _close(self) -> None:
        self._impulse, self._window_s, self._velocity_then = np.zeros(3), 0.0, None
