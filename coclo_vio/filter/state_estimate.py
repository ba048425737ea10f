# SPDX-License-Identifier: BSD-3-Clause
"""From the filter's state to a ``StateEstimate``, its covariance in the convention of that."""

import numpy as np

from coclo_vio.filter.square_root_filter import SquareRootFilter
from coclo_vio.filter.stance import Reading
from coclo_vio.filter.state import ACCELEROMETER_BIAS, GYROSCOPE_BIAS, POSITION, RATE, VELOCITY
from coclo_vio.filter.state_kernels import plain_covariance
from coclo_vio.geometry import se3
from coclo_vio.geometry.compiled import IS_COMPILED
from coclo_vio.values.arrays import BoolArray, is_finite
from coclo_vio.values.errors import FilterError
from coclo_vio.values.estimates import FootState, NavState, StateEstimate

ADVICE = (
    "earlier estimates stay valid; look at the samples before that time for outliers, or for stamps in another unit "
    "than given by the name of their column"
)


def estimate_of(core: SquareRootFilter, reading: Reading, is_stance: BoolArray) -> StateEstimate:
    """The estimate at a reading, with the legs (n,) that were used as stance.

    Raises:
        FilterError: the state is no longer finite.
    """
    mean = core.mean
    vector = mean.vector
    if IS_COMPILED:
        covariance = plain_covariance(mean.rotation, vector, core.active_factor)
    else:
        rows = mean.plain_jacobian()[:, : mean.layout.active] @ core.active_factor
        covariance = rows @ rows.T
    if not is_finite(vector) or not is_finite(covariance):
        raise FilterError(f"the state is no longer finite at {reading.stamp_ns} ns: {ADVICE}")
    nav = NavState(
        se3.transform(mean.rotation, vector[POSITION]),
        vector[VELOCITY],
        vector[RATE],
        vector[GYROSCOPE_BIAS],
        vector[ACCELEROMETER_BIAS],
    )
    layout = mean.layout
    probability = reading.contact.probability
    if layout.has_contacts:
        probability = np.clip(vector[layout.at("contacts")], 0.0, 1.0)
    return StateEstimate(reading.stamp_ns, nav, covariance, FootState(mean.feet, probability, is_stance))
