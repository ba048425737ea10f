# SPDX-License-Identifier: BSD-3-Clause
"""The shocks of walking in an accelerometer: deviations from the running mean, touch-downs, kurtosis, peaks."""

import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.stats import kurtosis

from coclo_vio.simulation.trial.trial import Trial
from coclo_vio.values.arrays import Array, IntArray
from coclo_vio.values.measurements import CameraImuSample, ImuSample
from coclo_vio.values.units import NS_PER_S

_SLOW_S = 1.0  # averaging time; changes by tilt are slower
_SHORTEST_SWING = 100  # steps of 1 ms; a shorter loss of contact is no swing
_AROUND_S = 0.05  # half width of the interval around a touch-down that holds its shock


def deviations(trial: Trial, kind: type[ImuSample] | type[CameraImuSample]) -> tuple[IntArray, Array]:
    """Stamps (N,) and specific force less its running mean over a second, m/s^2, imu axes, (N, 3), while it walks."""
    samples = [sample for sample in trial.measurements if type(sample) is kind]
    stamps = np.array([sample.stamp_ns for sample in samples])
    force = np.array([sample.specific_force for sample in samples])
    window = round(_SLOW_S * NS_PER_S / float(np.median(np.diff(stamps))))
    walks = (stamps >= touch_downs(trial)[0]) & (stamps <= touch_downs(trial)[-1])
    return stamps[walks], (force - uniform_filter1d(force, window, axis=0))[walks]


def touch_downs(trial: Trial) -> IntArray:
    """Stamps of the ends of all swings, ns, ascending."""
    contact, stamps = trial.truth.contact, trial.truth.contact_ns
    found: list[int] = []
    for foot in contact.T:
        landed = np.flatnonzero(foot[1:] & ~foot[:-1]) + 1
        found += [int(stamps[step]) for step in landed if not foot[max(step - _SHORTEST_SWING, 0) : step].any()]
    return np.sort(np.array(found, dtype=np.int64))


def excess_kurtosis(values: Array) -> list[float]:
    """Excess kurtosis of each axis; 0 for a Gaussian."""
    return [float(value) for value in kurtosis(values, axis=0)]


def touch_down_peaks(stamps: IntArray, values: Array, landed: IntArray) -> Array:
    """The largest deviation of any axis around each touch-down, m/s^2."""
    half = round(_AROUND_S * NS_PER_S)
    spans = zip(np.searchsorted(stamps, landed - half), np.searchsorted(stamps, landed + half), strict=True)
    return np.array([np.abs(values[first:last]).max() for first, last in spans if last > first])
