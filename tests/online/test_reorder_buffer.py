# SPDX-License-Identifier: BSD-3-Clause
"""Samples in any order of arrival within the latencies come out as sorted ones; regular ones in order never wait."""

import numpy as np
import pytest
from damaged_streams import MS, NotingEstimator, camera_imu, imu, jittered, joints, tracks
from hypothesis import given, settings
from hypothesis import strategies as st

from coclo_vio.datasets.sequencer import sort_measurements
from coclo_vio.online.config import LatencyConfig, OnlineConfig
from coclo_vio.online.guarded_estimator import GuardedEstimator
from coclo_vio.values.measurements import ImuSample, JointSample, Measurement, StereoTracks

LATENCY_MS = 30


def two_streams(count: int, joint_period_ms: int, imu_period_ms: int, imu_phase_ns: int) -> list[Measurement]:
    """Joints and IMU from 0 on, until there are so many joint samples, in order."""
    end_ns = count * joint_period_ms * MS
    stamps = range(imu_phase_ns, end_ns, imu_period_ms * MS)
    every: list[Measurement] = [joints(number * joint_period_ms * MS) for number in range(count)]
    return list(sort_measurements([*every, *(imu(stamp_ns) for stamp_ns in stamps)]))


@settings(max_examples=40)
@given(
    joint_period_ms=st.sampled_from([2, 5, 10]),
    imu_period_ms=st.sampled_from([2, 5, 10]),
    imu_phase_ns=st.integers(0, 10 * MS),
    seed=st.integers(0, 2**32 - 1),
    knows_arrival=st.booleans(),
)
def test_any_order_of_arrival_within_the_latency_is_the_sorted_one(
    joint_period_ms: int, imu_period_ms: int, imu_phase_ns: int, seed: int, knows_arrival: bool
) -> None:
    ordered = two_streams(60, joint_period_ms, imu_period_ms, imu_phase_ns)
    rng = np.random.default_rng(seed)
    damaged, arrivals_ns = jittered(ordered, lambda _: rng.uniform(0, LATENCY_MS * MS))
    estimator = NotingEstimator()
    guard = GuardedEstimator(lambda: estimator)
    for sample, arrival_ns in zip(damaged, arrivals_ns, strict=True):
        guard.push(sample, arrival_ns if knows_arrival else None)
    list(guard.finish())
    assert estimator.got == ordered
    assert all(stream.used == stream.arrived and not stream.late for stream in guard.status.streams)


def test_500_hz_with_30_ms_of_jitter_lose_no_sample() -> None:
    ordered = two_streams(2500, 2, 2, MS // 2)
    rng = np.random.default_rng(3)
    damaged, _ = jittered(ordered, lambda _: rng.uniform(0, LATENCY_MS * MS))
    estimator = NotingEstimator()
    guard = GuardedEstimator(lambda: estimator)
    for sample in damaged:
        guard.push(sample)
    list(guard.finish())
    assert estimator.got == ordered
    assert not guard.counts


def test_regular_samples_in_order_are_not_held() -> None:
    """Once the periods are known a joint sample, before which the IMU's of the same stamp comes, goes on at once."""
    estimator = NotingEstimator()
    guard = GuardedEstimator(lambda: estimator)
    for number, sample in enumerate(two_streams(400, 2, 2, 0)):
        guard.push(sample)
        if number > 60 and isinstance(sample, JointSample):
            assert len(estimator.got) == number + 1


def test_late_images_delay_no_joint_sample_and_keep_their_stamps() -> None:
    regular = two_streams(1000, 2, 2, 0)
    images: list[Measurement] = [tracks(number * 33 * MS) for number in range(60)]
    rng = np.random.default_rng(5)
    damaged, _ = jittered(
        list(sort_measurements([*regular, *images])),
        lambda sample: rng.uniform(50, 150) * MS if isinstance(sample, StereoTracks) else 0.0,
    )
    estimator = NotingEstimator()
    guard = GuardedEstimator(lambda: estimator)
    for number, sample in enumerate(damaged):
        guard.push(sample)
        if number > 60 and isinstance(sample, JointSample):
            assert estimator.got[-1] is sample
    list(guard.finish())
    (status,) = [stream for stream in guard.status.streams if stream.name == "stereo_tracks"]
    assert status.used + sum(status.refused.values()) == 60
    assert status.used > 30, "those that overtook no other image"
    assert {"late"} >= set(status.refused)


def test_a_stream_that_falls_silent_is_not_waited_for() -> None:
    estimator = NotingEstimator()
    guard = GuardedEstimator(lambda: estimator)
    for sample in two_streams(500, 2, 2, 0):
        if isinstance(sample, JointSample) or sample.stamp_ns <= 200 * MS:
            guard.push(sample)
            if sample.stamp_ns > 250 * MS:
                assert estimator.got[-1] is sample


def test_a_stream_that_is_always_late_is_not_waited_for() -> None:
    """The cameras' IMU comes 20 ms late, its latency is 5 ms: it is used, and joints do not wait."""
    ordered = two_streams(500, 2, 2, 0)
    others: list[Measurement] = [camera_imu(number * 5 * MS) for number in range(200)]
    damaged, _ = jittered(
        list(sort_measurements([*ordered, *others])),
        lambda sample: 0.0 if isinstance(sample, ImuSample | JointSample) else 20.0 * MS,
    )
    estimator = NotingEstimator()
    guard = GuardedEstimator(lambda: estimator)
    for sample in damaged:
        guard.push(sample)
        if isinstance(sample, JointSample) and sample.stamp_ns > 200 * MS:
            assert estimator.got[-1] is sample
    list(guard.finish())
    assert all(stream.used == stream.arrived for stream in guard.status.streams)


@pytest.mark.parametrize(("latency_s", "lost"), [(0.03, 0), (0.0, 1)])
def test_a_latency_of_zero_waits_for_nothing(latency_s: float, lost: int) -> None:
    samples = [joints(number * 2 * MS) for number in range(100)]
    samples[50], samples[51] = samples[51], samples[50]
    config = OnlineConfig(latency=LatencyConfig(joints_s=latency_s))
    guard = GuardedEstimator(NotingEstimator, config)
    for sample in samples:
        guard.push(sample)
    list(guard.finish())
    assert guard.counts == ({"joints_late": lost} if lost else {})
