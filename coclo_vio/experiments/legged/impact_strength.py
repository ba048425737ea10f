# SPDX-License-Identifier: BSD-3-Clause
"""How hard the feet of a recording land, by what its accelerometer reads."""

from collections.abc import Iterable

import numpy as np

from coclo_vio.experiments.legged.legged_record import ImpactStrength
from coclo_vio.values.measurements import ImuSample, Measurement
from coclo_vio.values.units import GRAVITY_MPS2, NS_PER_S

_PEAK_PERCENTILE = 99.0
_WINDOW_S = 0.5  # about a stride
_REST_MPS2 = 0.2  # standard deviation within a window; a robot at rest stays below
_FEWEST_SAMPLES = 10  # of a window


def impact_strength(measurements: Iterable[Measurement]) -> ImpactStrength | None:
    """Standard deviation and 99th percentile of how far the specific force's size is from gravity, m/s^2, in motion.

    Args:
        measurements: of the recording.

    Returns:
        None where the robot never moves, or with too few samples of the body's IMU.
    """
    samples = [sample for sample in measurements if isinstance(sample, ImuSample)]
    if len(samples) < _FEWEST_SAMPLES:
        return None
    step_s = float(np.median(np.diff([sample.stamp_ns for sample in samples]))) / NS_PER_S
    window = max(_FEWEST_SAMPLES, round(_WINDOW_S / step_s))
    whole = len(samples) // window * window
    sizes = np.array([np.linalg.norm(sample.specific_force) for sample in samples[:whole]])
    windows = sizes.reshape(-1, window) - GRAVITY_MPS2
    moving = windows[windows.std(axis=1) > _REST_MPS2].ravel()
    if len(moving) == 0:
        return None
    return ImpactStrength(
        std_mps2=float(moving.std()), peak_mps2=float(np.percentile(np.abs(moving), _PEAK_PERCENTILE))
    )
