# SPDX-License-Identifier: BSD-3-Clause
"""The accelerometer as what drives the velocity between joint samples, as far as legs agree with it.

Feet that touch down and lift off mislead for some 50 ms: they deflect, rebound and slide while they count as standing.
A velocity that is predicted to be constant follows them; one that is predicted by the accelerometer does not, over so
short a time. Impacts and vibration spoil an accelerometer by a factor of ten between robots, and a wrong mounting by
more, so what it predicts over a window is compared with how the velocity changed by all that the filter measured: from
that follows the noise of the prediction, and whether it is used at all.

The specific force moves the mean alone. Errors of tilt and bias are part of that noise, not of correlations: gravity is
measured by ``GravityWindow``, and no reading counts twice.

Where joints are missing or no foot stands the accelerometer is all there is, for seconds: there the errors of tilt and
bias, which do not change meanwhile, make its velocity wrong by their size times the time, and the noise grows with it.
"""

import math

import numpy as np

from coclo_vio.filter.config import RobustConfig
from coclo_vio.filter.square_root_filter import SquareRootFilter
from coclo_vio.filter.stance import Reading
from coclo_vio.filter.state import ACCELEROMETER_BIAS, POSITION, VELOCITY, State
from coclo_vio.geometry.compiled import compiled
from coclo_vio.geometry.so3_kernels import rotated
from coclo_vio.robot.leg_sensing import InertialStep
from coclo_vio.values.arrays import Array
from coclo_vio.values.units import GRAVITY_MPS2

_WINDOW_S = 0.25  # about half a period of a gait: what feet do at a step cancels in part
_MEMORY = 8.0  # windows
_MOST_SHARE = 0.5  # of the density without an accelerometer: with more noise it is not used
_HOLD_S = 0.02  # a reading holds for so long where the IMU is slower than the joints
_LONGEST_STEP_S = 0.05  # a sample that comes later tells nothing of the time before
_TILT, _BIAS = slice(0, 2), ACCELEROMETER_BIAS.start
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
        self._alone_s, self._constant = 0.0, 0.0  # without a foot, and variance of a constant acceleration then
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
        return max(self._least, math.sqrt(self._sum / self._weight * _WINDOW_S))

    def predict(self, core: SquareRootFilter, reading: Reading, dt_s: float, *, is_gap: bool) -> None:
        """Move the velocity of the mean over the step to a reading; the prediction of the filter comes after it."""
        self.density = self._without
        self._count_alone(core, dt_s, is_alone=not reading.stands)
        if is_gap:
            self._held = None
        sensed = None if is_gap else self._sensed(reading, dt_s)
        if sensed is None:
            self._close()
            return
        velocity, change = core.mean.vector[VELOCITY], self._change(core, *sensed, dt_s)
        if self._velocity_then is None:
            self._velocity_then = velocity.copy()
        self._impulse = self._impulse + change
        self._window_s += dt_s
        self._drive(core, change, dt_s)

    def coast(self, core: SquareRootFilter, step: InertialStep, dt_s: float) -> None:
        """Move the velocity of the mean over a step to a sample of the IMU, while there are no joint samples."""
        self._close()
        self.density = self._without
        self._count_alone(core, dt_s, is_alone=True)
        before, self._held = self._held, (step.specific_force, step.angular_velocity)
        if dt_s > _LONGEST_STEP_S:
            return
        turned = np.zeros(3) if before is None else step.angular_velocity - before[1]
        self._drive(core, self._change(core, step.specific_force, turned, dt_s), dt_s)

    def _count_alone(self, core: SquareRootFilter, dt_s: float, *, is_alone: bool) -> None:
        """How long no foot has stood, and how uncertain tilt and bias were when that began."""
        if not is_alone:
            self._alone_s = 0.0
            return
        if self._alone_s == 0.0:
            tilt, bias = (float(core.variance(errors).mean()) for errors in (_TILT, ACCELEROMETER_BIAS))
            self._constant = GRAVITY_MPS2**2 * tilt + bias
        self._alone_s += dt_s

    def _change(self, core: SquareRootFilter, force: Array, turned: Array, dt_s: float) -> Array:
        """Of the velocity, world, m/s, (3,), by a specific force and a change of the rate, body axes."""
        mean = core.mean
        return _velocity_change(mean.rotation, mean.vector, force, turned, self._lever_cross, dt_s)

    def _drive(self, core: SquareRootFilter, change: Array, dt_s: float) -> None:
        """Move the velocity of the mean where the accelerometer is known to agree with the legs.

        Beside white noise a constant error of variance ``c`` has moved the velocity by ``c t^2`` after a time ``t``
        alone, which is a white noise of density ``2 c t``.
        """
        self._mean = self._mean + (change - self._mean * dt_s) / max(_MEAN_S, dt_s)
        noise = self.noise_density
        if noise is None or noise > _MOST_SHARE * self._without or float(self._mean @ self._mean) > _MOST_MEAN_MPS2**2:
            return
        self.density = math.sqrt(noise**2 + 2.0 * self._constant * self._alone_s)
        mean = core.mean
        moved = mean.vector.copy()
        moved[VELOCITY] += change
        moved[POSITION] -= 0.5 * dt_s * change  # the prediction moves it by the velocity at the end
        core.mean = State(mean.layout, mean.rotation, moved, mean.remembered)

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


@compiled
def _velocity_change(
    rotation: Array, vector: Array, force: Array, turned: Array, lever_cross: Array, dt_s: float
) -> Array:
    """Of the body, world, m/s, (3,): ``R ((f - b) dt - turned x lever) - g dt``."""
    own, change = np.empty(3), np.empty(3)
    for i in range(3):
        lever = turned[0] * lever_cross[0, i] + turned[1] * lever_cross[1, i] + turned[2] * lever_cross[2, i]
        own[i] = (force[i] - vector[_BIAS + i]) * dt_s - lever
    change[0], change[1], change[2] = rotated(rotation, own[0], own[1], own[2])
    change[2] -= GRAVITY_MPS2 * dt_s
    return change
