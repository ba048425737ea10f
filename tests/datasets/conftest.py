# SPDX-License-Identifier: BSD-3-Clause
"""A robot of two legs, a short random log of it, and equality of measurements."""

import dataclasses
from collections.abc import Callable, Iterable

import numpy as np
import pytest

from coclo_vio.measurements import FootForceSample, ImuSample, JointSample, Measurement
from coclo_vio.robot.description import LegDescription, RobotDescription


@pytest.fixture
def biped() -> RobotDescription:
    legs = tuple(
        LegDescription(name=leg, joints=(f"{leg}_hip_joint", f"{leg}_knee_joint"), foot_frame=f"{leg}_foot")
        for leg in ("left", "right")
    )
    aliases = {joint.removesuffix("_joint"): joint for leg in legs for joint in leg.joints}
    return RobotDescription(name="biped", urdf="biped.urdf", legs=legs, joint_aliases=aliases)


@pytest.fixture
def log() -> list[Measurement]:
    """Joints and forces at 100 Hz, IMU at 200 Hz, NaN in a joint and in a force; stamps that a float would round."""
    rng = np.random.default_rng(7)
    start_ns = 1_403_715_273_262_142_977
    samples: list[Measurement] = []
    for i in range(40):
        stamp_ns = start_ns + i * 5_000_001
        force, position = rng.normal(size=2), rng.normal(size=4)
        force[1 if i == 10 else []] = np.nan
        position[2 if i == 20 else []] = np.nan
        if i % 2 == 0:
            samples.append(FootForceSample(stamp_ns, force))
        samples.append(ImuSample(stamp_ns, rng.normal(size=3), rng.normal(size=3)))
        if i % 2 == 0:
            samples.append(JointSample(stamp_ns, position, rng.normal(size=4), rng.normal(size=4)))
    return samples


@pytest.fixture
def assert_same() -> Callable[[Iterable[Measurement], Iterable[Measurement]], None]:
    """Equality of two streams: the same types in the same order, every value equal to the last bit, NaN with NaN."""

    def compare(got: Iterable[Measurement], wanted: Iterable[Measurement]) -> None:
        got, wanted = list(got), list(wanted)
        assert [type(sample) for sample in got] == [type(sample) for sample in wanted]
        for mine, theirs in zip(got, wanted, strict=True):
            assert mine.stamp_ns == theirs.stamp_ns
            for field in dataclasses.fields(mine):
                np.testing.assert_array_equal(getattr(mine, field.name), getattr(theirs, field.name), field.name)

    return compare
