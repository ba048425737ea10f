# SPDX-License-Identifier: BSD-3-Clause
"""Measurements made by hand for tests of faults: all sensors at 10 Hz, readings numbered by step."""

from collections.abc import Iterator, Sequence

import numpy as np

from coclo_vio.robot.description import load_robot
from coclo_vio.runs.faults import Faults, FaultsConfig
from coclo_vio.values.measurements import (
    ALL_SENSORS,
    CameraImuSample,
    FootForceSample,
    ImuSample,
    JointSample,
    Measurement,
    StereoFrame,
    StereoTracks,
)

DAISY = load_robot("daisy")
JOINTS = len(DAISY.joint_names)
BEGIN_NS = 1_700_000_000_000_000_000
STEP_NS = 100_000_000
UP = np.array([0.0, 0.0, 9.81])
FORCE = np.array([1.0, 2.0, 9.81])


def recorded(steps: int = 40) -> list[Measurement]:
    rows: list[Measurement] = []
    for step in range(steps):
        stamp_ns, value = BEGIN_NS + step * STEP_NS, 1.0 + step
        rows += [
            FootForceSample(stamp_ns, np.full(6, value)),
            ImuSample(stamp_ns, np.array([0.1, 0.2, 0.01 * value]), FORCE),
            JointSample(stamp_ns, np.full(JOINTS, 0.01 * value), np.full(JOINTS, value), np.full(JOINTS, value)),
            CameraImuSample(stamp_ns, np.array([0.1, 0.2, 0.01 * value]), UP),
            StereoFrame(stamp_ns, image(step), image(step + 100)),
            StereoTracks(
                stamp_ns,
                np.array([3, 5]),
                np.array([[10.0, 1.0 + step], [20.0, 2.0]]),
                np.array([[8.0, 1.0], [np.nan] * 2]),
            ),
        ]
    return rows


def image(number: int) -> np.ndarray:
    """Another image for each number, of 5 rows and 8 columns."""
    return np.random.default_rng(number).integers(40, 120, (5, 8)).astype(np.uint8)


def with_faults(
    rows: Sequence[Measurement], sensors: frozenset[type] = ALL_SENSORS, **values: object
) -> list[Measurement]:
    def read(wanted: frozenset[type]) -> Iterator[Measurement]:
        return (row for row in rows if type(row) in wanted)

    return list(Faults(FaultsConfig.parse(values, "test"), DAISY).measurements(read, sensors))


def of_kind(rows: Sequence[Measurement], kind: type) -> list[Measurement]:
    return [row for row in rows if type(row) is kind]


def step_of(row: Measurement) -> int:
    return (row.stamp_ns - BEGIN_NS) // STEP_NS


def changed_steps(rows: Sequence[Measurement], faulty: Sequence[Measurement], kind: type) -> set[int]:
    """Steps of the samples of a kind that are other objects; all others, of every kind, are the recorded ones."""
    assert len(rows) == len(faulty)
    changed = set()
    for row, other in zip(rows, faulty, strict=True):
        assert row.stamp_ns == other.stamp_ns
        if row is not other:
            assert type(row) is kind
            changed.add(step_of(row))
    return changed
