# SPDX-License-Identifier: BSD-3-Clause
"""Brightness of each frame: light in the room, exposure time and gain, for all frames in advance.

Computed at once because the controller has a state; the frames can then be rendered in any order, in any process.
"""

from dataclasses import dataclass

import numpy as np

from coclo_vio.simulation.visuals.config import CameraConfig, LightingConfig
from coclo_vio.values.arrays import Array, IntArray

_NO_LIGHT = 1e-5  # light of a blackout, share of normal light


@dataclass(frozen=True, slots=True)
class Exposure:
    """Exposure of one frame.

    Attributes:
        duration_s: exposure time, s.
        gain: analogue gain.
        brightness: grey level of a white surface in the middle of the image over 255, without saturation.
    """

    duration_s: float
    gain: float
    brightness: float


def exposures(stamps_ns: IntArray, config: CameraConfig, seed: int) -> list[Exposure]:
    """The exposure of each frame at ``stamps_ns`` (N,), ascending."""
    times_s = np.asarray((stamps_ns - stamps_ns[:1]) * 1e-9, dtype=np.float64)
    light = _light(times_s, config.lighting)
    control = _controlled(times_s, light, config)
    setting = config.exposure
    nominal = setting.nominal_s * setting.nominal_gain
    durations_s = np.minimum(setting.nominal_s * control, setting.longest_s)
    gains = np.clip(nominal * control / durations_s, 1.0, setting.largest_gain)
    drifted = gains * np.exp(_drift(times_s, config, np.random.default_rng([seed, 3])))
    if setting.jump > 0.0:
        drifted = drifted * np.exp(_jumps(times_s, config, np.random.default_rng([seed, 7])))
    brightness = setting.white_level * light * durations_s * drifted / nominal
    columns = (durations_s.tolist(), drifted.tolist(), brightness.tolist())
    return [Exposure(*row) for row in zip(*columns, strict=True)]


def _light(times_s: Array, lighting: LightingConfig) -> Array:
    """Light in the room (N,), share of normal light."""
    light = np.full(len(times_s), lighting.dark_share if lighting.level == "dark" else 1.0)
    for each in lighting.blackouts:
        light[(times_s >= each.start_s) & (times_s < each.start_s + each.duration_s)] = _NO_LIGHT
    return light


def _controlled(times_s: Array, light: Array, config: CameraConfig) -> Array:
    """Exposure time times gain (N,) over nominal: one over the light, within limits, with a lag in the logarithm."""
    setting = config.exposure
    most = setting.longest_s * setting.largest_gain / (setting.nominal_s * setting.nominal_gain)
    targets = np.log(np.clip(1.0 / light, 1.0 / setting.nominal_gain, most))
    control = np.empty(len(times_s))
    for frame, target in enumerate(targets):
        lag = 0.0 if frame == 0 else float(np.exp(-(times_s[frame] - times_s[frame - 1]) / setting.lag_s))
        control[frame] = targets[0] if frame == 0 else target + lag * (control[frame - 1] - target)
    return np.exp(control)


def _drift(times_s: Array, config: CameraConfig, rng: np.random.Generator) -> Array:
    """An Ornstein-Uhlenbeck process (N,), exact between frames."""
    normals = rng.standard_normal(len(times_s))
    drift = config.exposure.drift * normals
    for frame in range(1, len(times_s)):
        kept = float(np.exp(-(times_s[frame] - times_s[frame - 1]) / config.exposure.drift_time_s))
        drift[frame] = kept * drift[frame - 1] + np.sqrt(1.0 - kept**2) * drift[frame]
    return drift


def _jumps(times_s: Array, config: CameraConfig, rng: np.random.Generator) -> Array:
    """Logarithm of the gain's jumps (N,): another level from a random time to the next."""
    setting = config.exposure
    levels = np.empty(len(times_s))
    level, until_s = 0.0, float(rng.exponential(setting.jump_every_s))
    for frame, time_s in enumerate(times_s):
        if time_s >= until_s:
            level = setting.jump * float(rng.standard_normal())
            until_s = time_s + float(rng.exponential(setting.jump_every_s))
        levels[frame] = level
    return levels
