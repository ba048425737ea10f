# SPDX-License-Identifier: BSD-3-Clause
"""From the filter's state to a ``StateEstimate``, its covariance in the convention of that."""

import numpy as np

from coclo_vio.filter.square_root_filter import SquareRootFilter
from coclo_vio.filter.stance import Reading
from coclo_vio.filter.state import ACCELEROMETER_BIAS, GYROSCOPE_BIAS, POSITION, RATE, VELOCITY
from coclo_vio.filter.state_kernels import plain_covariance
from coclo_vio.geometry import se3
from coclo_vio.geometry.compiled import IS_COMPILED
from coclo_vio.values.arrays import Array, BoolArray, is_finite
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
    probability = reading.contact.probability
    layout = core.mean.layout
    if layout.has_contacts:
        probability = np.clip(core.mean.vector[layout.at("contacts")], 0.0, 1.0)
    return _estimate(core, reading.stamp_ns, probability, is_stance)


def coasting_estimate(core: SquareRootFilter, stamp_ns: int, legs: int) -> StateEstimate:
    """The estimate while there are no joint samples: the feet are carried with the body, and none is in contact.

    Raises:
        FilterError: the state is no longer finite.
    """
    return _estimate(core, stamp_ns, np.zeros(legs), np.zeros(legs, dtype=np.bool_))


def _estimate(core: SquareRootFilter, stamp_ns: int, contact: Array, is_stance: BoolArray) -> StateEstimate:
    mean = core.mean
    vector = mean.vector
    if IS_COMPILED:
        covariance = plain_covariance(mean.rotation, vector, core.active_factor)
    else:
        rows = mean.plain_jacobian()[:, : mean.layout.active] @ core.active_factor
        covariance = rows @ rows.T
    if not is_finite(vector) or not is_finite(covariance):
        raise FilterError(f"the state is no longer finite at {stamp_ns} ns: {ADVICE}")
    layout, vector = mean.layout, vector.copy()
    nav = NavState.of_own(
        T_world_body=se3.transform(mean.rotation, vector[POSITION]),
        velocity_world=vector[VELOCITY],
        angular_velocity_body=vector[RATE],
        gyroscope_bias=vector[GYROSCOPE_BIAS],
        accelerometer_bias=vector[ACCELEROMETER_BIAS],
    )
    feet = FootState.of_own(
        position_world=vector[layout.feet].reshape(layout.legs, 3),
        contact_probability=contact.copy(),
        is_stance=is_stance.copy(),
    )
    return StateEstimate.of_own(stamp_ns=stamp_ns, nav=nav, covariance=covariance, feet=feet)
