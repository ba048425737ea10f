# SPDX-License-Identifier: BSD-3-Clause
"""The streams of the sensors merged lazily into the stream that the estimators process."""

import heapq
from collections.abc import Iterable, Iterator, Mapping

from coclo_vio.values.measurements import (
    BodyTwistSample,
    CameraImuSample,
    FootForceSample,
    ImuSample,
    JointSample,
    Measurement,
    StereoFrame,
    StereoTracks,
)

_RANK: Mapping[type, int] = {
    FootForceSample: 0,
    ImuSample: 1,
    JointSample: 2,
    CameraImuSample: 3,
    BodyTwistSample: 4,
    StereoFrame: 5,
    StereoTracks: 6,
}


def order_key(sample: Measurement) -> tuple[int, int]:
    """Sort key of the merged stream: stamp, then foot force, IMU, joints, camera IMU, twist, stereo frame.

    The joint sample completes a step of the filter, so the other measurements of the same time come before it; a
    stereo frame needs the filter's pose at its own stamp, so it comes after.
    """
    return sample.stamp_ns, _RANK[type(sample)]


def merge_streams(streams: Iterable[Iterable[Measurement]]) -> Iterator[Measurement]:
    """One stream in time order from several that are each in time order; holds one sample of each stream.

    A sample that is older than the one before it in its own stream is passed on in its place; the filter rejects and
    counts it. ``sort_measurements`` sorts such a stream.
    """
    return heapq.merge(*streams, key=order_key)


def sort_measurements(measurements: Iterable[Measurement]) -> Iterator[Measurement]:
    """All measurements in time order; equal keys keep their order. Holds the whole recording in memory."""
    return iter(sorted(measurements, key=order_key))
