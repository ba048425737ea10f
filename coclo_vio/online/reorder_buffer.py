# SPDX-License-Identifier: BSD-3-Clause
"""Samples of several streams in order of their stamps: waits for a sample only where one is missing.

Streams have periods. A sample goes on as soon as no earlier one is expected: the one before it in its own stream has
come, and so have those of the other streams that are due by then. Where one is missing it is waited for, at most for
the latency of its stream. So regular samples in order are never held, and late ones are put in their place. Where the
period of a stream is not known yet, its latency is waited for. Nothing waits for images.
"""

import heapq
from bisect import insort
from collections.abc import Iterator, Mapping

from coclo_vio.datasets.sequencer import order_key
from coclo_vio.online.clock_follower import Accepted
from coclo_vio.online.config import LatencyConfig
from coclo_vio.online.stream_state import StreamState
from coclo_vio.values.measurements import (
    BodyTwistSample,
    CameraImuSample,
    FootForceSample,
    ImuSample,
    JointSample,
)
from coclo_vio.values.units import NS_PER_S

_HOLE = 1.6  # periods after the last sample: a later one has no neighbour, another is missing before it
_EXPECTED = 0.6  # periods after the last sample the next one may come
_MOST_HELD = 8192  # samples


class ReorderBuffer:
    """Holds samples until no earlier one is expected.

    Invariant: samples leave in the order of stamps, then of ``order_key``, except those that came too late for it.
    """

    def __init__(self, latency: LatencyConfig, streams: Mapping[type, StreamState]) -> None:
        """Take latencies.

        Args:
            latency: of the streams.
            streams: that samples come from; more may be added.
        """
        self._streams = streams
        self._latency_ns = {
            kind: round(latency_s * NS_PER_S)
            for kind, latency_s in (
                (JointSample, latency.joints_s),
                (ImuSample, latency.imu_s),
                (FootForceSample, latency.foot_force_s),
                (CameraImuSample, latency.camera_imu_s),
                (BodyTwistSample, latency.body_twist_s),
            )
        }
        self._held: list[tuple[int, int, int, int, Accepted]] = []  # stamp, rank, number, time of entry
        self._used_ns: int | None = None  # newest that has left

    def push(self, sample: Accepted, time_ns: int) -> None:
        """Take a sample; ``time_ns`` is now, by any clock that never steps."""
        arrival, stream = sample.arrival, sample.arrival.stream
        rank = order_key(arrival.measurement)[1]
        heapq.heappush(self._held, (sample.stamp_ns, rank, arrival.number, time_ns, sample))
        insort(stream.waiting_ns, sample.stamp_ns)
        if self._used_ns is None or sample.stamp_ns >= self._used_ns:
            stream.is_awaited = True
        else:
            stream.late += 1

    def due(self, time_ns: int) -> Iterator[Accepted]:
        """The samples that go on now, in order."""
        while self._held and (len(self._held) > _MOST_HELD or not self._waits(time_ns)):
            yield self._pop()

    def flush(self) -> Iterator[Accepted]:
        """All samples, in order."""
        while self._held:
            yield self._pop()

    def _pop(self) -> Accepted:
        sample = heapq.heappop(self._held)[-1]
        stream = sample.arrival.stream
        stream.waiting_ns.remove(sample.stamp_ns)
        stream.use(sample.stamp_ns)
        self._used_ns = sample.stamp_ns if self._used_ns is None else max(self._used_ns, sample.stamp_ns)
        return sample

    def _waits(self, time_ns: int) -> bool:
        """Whether the first sample has to wait for another one."""
        stamp_ns, _, _, entry_ns, sample = self._held[0]
        own = sample.arrival.stream
        is_waiting = False
        for kind, latency_ns in self._latency_ns.items():
            stream = self._streams.get(kind)
            if stream is None or not latency_ns or stream.is_apart:
                continue
            if (stream is not own and not stream.is_awaited) or not _is_missing(stream, own, stamp_ns):
                continue
            if time_ns - entry_ns <= latency_ns:
                is_waiting = True
            elif stream is not own and not stream.waiting_ns and _is_overdue(stream, stamp_ns):
                stream.is_awaited = False  # until it comes in time again
        return is_waiting


def _is_missing(stream: StreamState, own: StreamState, stamp_ns: int) -> bool:
    """Whether a sample of a stream is expected before one of this stamp, and of the stream ``own``, can go on."""
    used_ns, period_ns = stream.used_ns, stream.period_ns
    if used_ns is None or period_ns is None:
        return True
    if stream is own:
        return stamp_ns > used_ns + _HOLE * period_ns
    if stream.waiting_ns and stream.waiting_ns[0] <= used_ns + _HOLE * period_ns:
        return False
    return stamp_ns >= used_ns + _EXPECTED * period_ns


def _is_overdue(stream: StreamState, stamp_ns: int) -> bool:
    """Whether a sample of a stream is not only expected before one of this stamp, but cannot come any more."""
    used_ns, period_ns = stream.used_ns, stream.period_ns
    return used_ns is None or period_ns is None or stamp_ns > used_ns + _HOLE * period_ns
