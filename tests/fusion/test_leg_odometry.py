# SPDX-License-Identifier: BSD-3-Clause
"""A filter as an estimator: its states become estimates of one trajectory."""

from collections.abc import Mapping, Sequence

import numpy as np
from stand_ins import MS, state_at

from coclo_vio.fusion.leg_odometry import LegOdometry
from coclo_vio.values.estimates import StateEstimate
from coclo_vio.values.measurements import ImuSample, JointSample, Measurement
from coclo_vio.values.outputs import Estimate, Event


class JointFilter:
    """Completes a step with each joint sample."""

    @property
    def counts(self) -> Mapping[str, int]:
        return {"standstill": 3}

    def push(self, measurement: Measurement) -> StateEstimate | None:
        return state_at(measurement.stamp_ns) if isinstance(measurement, JointSample) else None


def test_each_state_is_an_estimate_under_the_name_of_the_trajectory() -> None:
    odometry = LegOdometry("coclo", JointFilter())
    assert odometry.push(ImuSample(5 * MS, np.zeros(3), np.zeros(3))) == []
    [output] = odometry.push(JointSample(5 * MS, *np.zeros((3, 12))))
    assert isinstance(output, Estimate)
    assert (output.name, output.state.stamp_ns) == ("coclo", 5 * MS)
    assert list(odometry.finish()) == []
    assert odometry.counts == {"standstill": 3}


class ReportingFilter(JointFilter):
    """Reports a leg with each joint sample."""

    def take_events(self) -> Sequence[Event]:
        return [Event(5 * MS, "leg_inconsistent", "leg1")]


def test_what_a_filter_reports_follows_the_estimate() -> None:
    outputs = LegOdometry("coclo", ReportingFilter()).push(JointSample(5 * MS, *np.zeros((3, 12))))
    assert [type(one) for one in outputs] == [Estimate, Event]
