# SPDX-License-Identifier: BSD-3-Clause
"""Order, signs and units of joints and foot forces in a recording, as corrections set them."""

import numpy as np

from coclo_vio.datasets.corrections import ANGLE_UNITS, ForceCorrections, JointCorrections
from coclo_vio.values.arrays import Array, IntArray
from coclo_vio.values.errors import DatasetError, listing
from coclo_vio.values.measurements import FootForceSample, JointSample


class JointArrangement:
    """Changes joint samples as configured: first the order, then signs and units; joints left out become NaN."""

    def __init__(self, how: JointCorrections, joint_names: tuple[str, ...]) -> None:
        """Take the names of all joints, in the order of every sample.

        Raises:
            DatasetError: a name that is no joint of the robot.
        """
        named = {*how.order, *how.order.values(), *how.signs, *how.left_out}
        unknown = named - set(joint_names)
        if unknown and joint_names:
            raise DatasetError(
                f"dataset.corrections.joints names {listing(unknown)}, no joint of the robot; "
                f"its joints are {listing(joint_names)}"
            )
        self._how = how
        self._source: IntArray = np.array([joint_names.index(how.order.get(name, name)) for name in joint_names], int)
        self._sign: Array = np.array([float(how.signs.get(name, 1)) for name in joint_names])
        self._sign[[joint_names.index(name) for name in how.left_out if name in joint_names]] = np.nan
        self._is_as_recorded = not named

    def __call__(self, sample: JointSample) -> JointSample:
        """The sample as it should have been recorded."""
        how = self._how
        position, velocity, effort = sample.position, sample.velocity, sample.effort
        if not self._is_as_recorded:
            position, velocity, effort = (self._sign * each[self._source] for each in (position, velocity, effort))
        return JointSample(
            sample.stamp_ns,
            position * ANGLE_UNITS[how.position_unit],
            velocity * how.velocity_factor,
            effort * how.effort_factor,
        )


class ForceArrangement:
    """Changes samples of foot forces as configured: their order, then their sign or unit."""

    def __init__(self, how: ForceCorrections, leg_names: tuple[str, ...]) -> None:
        """Take the names of all legs, in the order of every sample.

        Raises:
            DatasetError: a name that is no leg of the robot.
        """
        unknown = {*how.order, *how.order.values()} - set(leg_names)
        if unknown and leg_names:
            raise DatasetError(
                f"dataset.corrections.foot_force.order names {listing(unknown)}, no leg of the robot; "
                f"its legs are {listing(leg_names)}"
            )
        self._source: IntArray = np.array([leg_names.index(how.order.get(name, name)) for name in leg_names], int)
        self._factor = how.factor
        self._is_ordered = bool(how.order) and bool(leg_names)

    def __call__(self, sample: FootForceSample) -> FootForceSample:
        """The sample as it should have been recorded."""
        force = sample.force[self._source] if self._is_ordered else sample.force
        return FootForceSample(sample.stamp_ns, self._factor * force)
