# SPDX-License-Identifier: BSD-3-Clause
"""Joints at a lower rate than they come: as many as wanted, IMUs untouched, and an estimate as good."""

import numpy as np
import pytest
from damaged_streams import MS, NotingEstimator, S, imu, joints

from coclo_vio.datasets.sequencer import sort_measurements
from coclo_vio.online.config import OnlineConfig
from coclo_vio.online.guarded_estimator import GuardedEstimator
from coclo_vio.values.measurements import FootForceSample, ImuSample, JointSample

T0 = 1_700_000_000 * S


@pytest.mark.parametrize(("interval_s", "one_of"), [(0.0, 1), (0.002, 1), (0.004, 2), (0.005, 3), (0.01, 5)])
def test_joints_and_foot_forces_are_thinned_to_the_interval_and_imus_are_not(interval_s: float, one_of: int) -> None:
    stamps = [T0 + number * 2 * MS for number in range(1000)]
    forces = [FootForceSample(at, np.ones(4)) for at in stamps]
    rows = list(sort_measurements([*map(imu, stamps), *map(joints, stamps), *forces]))
    guard = GuardedEstimator(NotingEstimator, OnlineConfig(joint_interval_s=interval_s))
    for row in rows:
        guard.push(row)
    guard.finish()
    estimator = guard.estimator
    assert isinstance(estimator, NotingEstimator)
    used = {
        kind: [each.stamp_ns for each in estimator.got if isinstance(each, kind)]
        for kind in (JointSample, FootForceSample, ImuSample)
    }
    assert used[JointSample] == used[FootForceSample] == stamps[::one_of]
    assert used[ImuSample] == stamps
    left_out = len(stamps) - len(stamps[::one_of])
    for name in ("joints", "foot_force"):
        assert guard.counts.get(f"{name}_thinned", 0) == left_out
    status = next(each for each in guard.status.streams if each.name == "joints")
    assert (status.arrived, status.used) == (len(stamps), len(stamps) - left_out)
