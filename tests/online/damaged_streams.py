# SPDX-License-Identifier: BSD-3-Clause
"""Streams as drivers damage them, and a stand-in estimator that notes what it gets."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

import coclo_vio as cv
from coclo_vio.datasets.sequencer import sort_measurements
from coclo_vio.values.estimates import NavState, StateEstimate
from coclo_vio.values.measurements import CameraImuSample, ImuSample, JointSample, Measurement, StereoTracks
from coclo_vio.values.outputs import Estimate, Output

MS = 1_000_000
S = 1000 * MS


def imu(stamp_ns: int) -> ImuSample:
    return ImuSample(stamp_ns, np.zeros(3), np.array([0.0, 0.0, 9.81]))


def camera_imu(stamp_ns: int) -> CameraImuSample:
    return CameraImuSample(stamp_ns, np.zeros(3), np.array([0.0, 0.0, 9.81]))


def joints(stamp_ns: int) -> JointSample:
    return JointSample(stamp_ns, np.zeros(2), np.zeros(2), np.zeros(2))


def tracks(stamp_ns: int) -> StereoTracks:
    return StereoTracks(stamp_ns, np.arange(1), np.ones((1, 2)), np.ones((1, 2)))


def recorded(seconds: float = 6.0, start_ns: int = 1_700_000_000 * S) -> list[Measurement]:
    """Joints and IMU at 200 Hz, tracks at 10 Hz; no two readings of the IMU are equal."""
    stamps = [start_ns + number * 5 * MS for number in range(round(seconds * 200))]
    noise = np.random.default_rng(1)
    readings = [ImuSample(at, noise.normal(size=3), noise.normal(size=3)) for at in stamps]
    return list(sort_measurements([*readings, *map(joints, stamps), *map(tracks, stamps[::20])]))


@dataclass
class NotingEstimator:
    """Notes what it gets; each joint sample gives an estimate, one metre further along x for each second."""

    got: list[Measurement] = field(default_factory=list)

    def push(self, measurement: Measurement) -> Sequence[Output]:
        self.got.append(measurement)
        if not isinstance(measurement, JointSample):
            return ()
        pose = np.eye(4)
        pose[0, 3] = (measurement.stamp_ns % (1000 * S)) / S
        nav = NavState(pose, np.array([1.0, 0.0, 0.0]), *(np.zeros(3) for _ in range(3)))
        return (Estimate("noting", StateEstimate(measurement.stamp_ns, nav, np.eye(9) * 1e-4)),)

    def finish(self) -> Iterable[Output]:
        return ()

    @property
    def counts(self) -> Mapping[str, int]:
        return {}

    @property
    def order(self) -> list[tuple[type, int]]:
        return [(type(each), each.stamp_ns) for each in self.got]


def moved(measurement: Measurement, by_ns: int) -> Measurement:
    return replace(measurement, stamp_ns=measurement.stamp_ns + by_ns)


def moved_from(
    measurements: Iterable[Measurement], from_ns: int, by_ns: int, kinds: tuple[type, ...] = (object,)
) -> list[Measurement]:
    """The same with stamps that step from a time on, of some kinds."""
    return [
        moved(each, by_ns) if each.stamp_ns >= from_ns and isinstance(each, kinds) else each for each in measurements
    ]


def jittered(
    measurements: Sequence[Measurement], delay_ns: Callable[[Measurement], float]
) -> tuple[list[Measurement], list[int]]:
    """In the order in which they arrive when each is under way for so long, and the times of arrival."""
    arrivals = [each.stamp_ns + round(delay_ns(each)) for each in measurements]
    order = np.argsort(arrivals, kind="stable")
    return [measurements[index] for index in order], [arrivals[index] for index in order]


def beginning(recording: cv.Recording, sensors: frozenset[type], length_s: float) -> list[cv.Measurement]:
    kept: list[cv.Measurement] = []
    for measurement in recording.measurements(sensors):
        if kept and measurement.stamp_ns - kept[0].stamp_ns >= length_s * 1e9:
            break
        kept.append(measurement)
    return kept
