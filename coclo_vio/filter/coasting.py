# SPDX-License-Identifier: BSD-3-Clause
"""Across times without joint samples, by the body's IMU: rotation by the gyroscope, velocity by the accelerometer."""

from collections.abc import Callable, Sequence
from dataclasses import replace

from coclo_vio.filter.profile import Profile
from coclo_vio.filter.square_root_filter import SquareRootFilter
from coclo_vio.robot.leg_sensing import InertialStep, Reading
from coclo_vio.values.units import NS_PER_S

GyroscopeNoise = Callable[[float], float]
"""From the length of a step, s, to one sigma of the gyroscope averaged over it, rad/s."""


def coast(
    core: SquareRootFilter,
    profile: Profile,
    samples: Sequence[InertialStep],
    start_ns: int,
    end_ns: int,
    gyroscope_noise: GyroscopeNoise,
) -> int:
    """Predict by the samples of the IMU between two times.

    Args:
        core: the filter, whose state is that at ``start_ns``.
        profile: the steps of the filter, which can coast.
        samples: of the IMU, oldest first.
        start_ns: time of the state, in nanoseconds.
        end_ns: samples from then on are left out.
        gyroscope_noise: of a step.

    Returns:
        The time of the state now, in nanoseconds.
    """
    at_ns = start_ns
    for sample in samples:
        if at_ns < sample.stamp_ns < end_ns:
            dt_s = (sample.stamp_ns - at_ns) / NS_PER_S
            profile.coast(core, sample, dt_s, gyroscope_noise(dt_s))
            at_ns = sample.stamp_ns
    return at_ns


def predict_gap(
    core: SquareRootFilter, profile: Profile, reading: Reading, start_ns: int, gyroscope_noise: GyroscopeNoise
) -> tuple[Reading, int]:
    """Predict across a gap of the joints, up to the last sample of the IMU before a reading.

    The paper's profile takes the whole gap in one step, as printed.

    Returns:
        What is left of the reading for the last step, and the time of the state now, in nanoseconds.
    """
    if not profile.can_coast:
        return reading, start_ns
    samples = reading.inertial
    at_ns = coast(core, profile, samples, start_ns, reading.stamp_ns, gyroscope_noise)
    is_current = bool(samples) and samples[-1].stamp_ns >= reading.stamp_ns
    return replace(reading, angular_velocity=samples[-1].angular_velocity if is_current else None), at_ns
