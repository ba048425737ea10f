# SPDX-License-Identifier: BSD-3-Clause
"""How hard the feet of a recording land, by what its accelerometer reads."""

from collections.abc import Iterable

import numpy as np

from coclo_vio.experiments.legged.legged_record import ImpactStrength
from coclo_vio.values.measurements import ImuSample, Measurement
from coclo_vio.values.units import GRAVITY_MPS2

_PEAK_PERCENTILE = 99.0
_FEWEST_SAMPLES = 10


def impact_strength(measurements: Iterable[Measurement]) -> ImpactStrength | None:
    """Standard deviation and 99th percentile of how far the specific force's size is from gravity, m/s^2.

    Rest before and after the motion is a part of it. None with fewer than ten samples of the body's IMU.

    Args:
        measurements: of the recording.
    """
    sizes = [float(np.linalg.norm(sample.specific_force)) for sample in measurements if isinstance(sample, ImuSample)]
    if len(sizes) < _FEWEST_SAMPLES:
        return None
    beyond = np.array(sizes) - GRAVITY_MPS2
    return ImpactStrength(
        std_mps2=float(beyond.std()), peak_mps2=float(np.percentile(np.abs(beyond), _PEAK_PERCENTILE))
    )
