# SPDX-License-Identifier: BSD-3-Clause
"""Several sensors' streams merged lazily into the one stream that the estimators take."""

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
    """What the merged stream is ordered by: stamp, then foot force, IMU, joints, camera IMU, twist, stereo frame.

    The joint sample completes a step of the filter, so what was measured at the same time has to come before it; a
    stereo frame asks for the filter's pose at its own stamp, so it comes after.
    """
    return sample.stamp_ns, _RANK[type(sample)]


def merge_streams(streams: Iterable[Iterable[Measurement]]) -> Iterator[Measurement]:
    """One stream in time order from several that are each in time order; nothing is held but one sample a stream.

    A sample that is older than the one before it in its own stream is passed on where it stands: it is the filter
    that refuses and counts it. ``sort_measurements`` mends such a stream.
    """
    return heapq.merge(*streams, key=order_key)


def sort_measurements(measurements: Iterable[Measurement]) -> Iterator[Measurement]:
    """All measurements in time order; equal ones keep their order. Holds the whole recording in memory."""
    return iter(sorted(measurements, key=order_key))
