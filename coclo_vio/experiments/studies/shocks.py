# SPDX-License-Identifier: BSD-3-Clause
"""What walking does to an accelerometer: readings without gravity's slow part, touch-downs, kurtosis, peaks."""

import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.stats import kurtosis

from coclo_vio.simulation.trial.trial import Trial
from coclo_vio.values.arrays import Array, IntArray
from coclo_vio.values.measurements import CameraImuSample, ImuSample

NS_PER_S = 1_000_000_000
_SLOW_S = 1.0  # what an accelerometer shows of tilt is slower
_IN_THE_AIR = 100  # steps of 1 ms; a shorter loss of contact is no swing
_AROUND_S = 0.05  # of a touch-down, in which its shock falls


def deviations(trial: Trial, kind: type[ImuSample] | type[CameraImuSample]) -> tuple[IntArray, Array]:
    """Stamps (N,) and specific force less its running mean over a second, m/s^2, imu axes, (N, 3), while it walks."""
    samples = [sample for sample in trial.measurements if type(sample) is kind]
    stamps = np.array([sample.stamp_ns for sample in samples])
    force = np.array([sample.specific_force for sample in samples])
    window = round(_SLOW_S * NS_PER_S / float(np.median(np.diff(stamps))))
    walks = (stamps >= touch_downs(trial)[0]) & (stamps <= touch_downs(trial)[-1])
    return stamps[walks], (force - uniform_filter1d(force, window, axis=0))[walks]


def touch_downs(trial: Trial) -> IntArray:
    """When a foot that was in the air touched the ground, ns, ascending."""
    contact, stamps = trial.truth.contact, trial.truth.contact_ns
    found: list[int] = []
    for foot in contact.T:
        landed = np.flatnonzero(foot[1:] & ~foot[:-1]) + 1
        found += [int(stamps[step]) for step in landed if not foot[max(step - _IN_THE_AIR, 0) : step].any()]
    return np.sort(np.array(found, dtype=np.int64))


def excess_kurtosis(values: Array) -> list[float]:
    """Of each axis; 0 is Gaussian."""
    return [float(value) for value in kurtosis(values, axis=0)]


def touch_down_peaks(stamps: IntArray, values: Array, landed: IntArray) -> Array:
    """The largest deviation of any axis about each touch-down, m/s^2."""
    half = round(_AROUND_S * NS_PER_S)
    spans = zip(np.searchsorted(stamps, landed - half), np.searchsorted(stamps, landed + half), strict=True)
    return np.array([np.abs(values[first:last]).max() for first, last in spans if last > first])
