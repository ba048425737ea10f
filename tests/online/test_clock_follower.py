# SPDX-License-Identifier: BSD-3-Clause
"""Stamps that cannot be are refused by name; clocks that stepped are followed; all samples are accounted for."""

from typing import Any

import numpy as np
import pytest
from damaged_streams import MS, NotingEstimator, S, imu, joints, moved, moved_from, tracks
from hypothesis import given, settings
from hypothesis import strategies as st

from coclo_vio.datasets.sequencer import sort_measurements
from coclo_vio.online.guarded_estimator import GuardedEstimator
from coclo_vio.values.measurements import ImuSample, JointSample, Measurement, StereoTracks
from coclo_vio.values.outputs import Estimate, Event, Output, StreamStatus

T0 = 1_700_000_000 * S


def three_streams(seconds: float) -> list[Measurement]:
    """Joints and IMU at 200 Hz, tracks at 10 Hz."""
    stamps = [T0 + number * 5 * MS for number in range(round(seconds * 200))]
    images: list[Measurement] = [tracks(stamp_ns) for stamp_ns in stamps[::20]]
    return list(sort_measurements([*map(imu, stamps), *map(joints, stamps), *images]))


def run(measurements: list[Any], arrivals_ns: list[int] | None = None) -> tuple[GuardedEstimator, list[Output]]:
    guard = GuardedEstimator(NotingEstimator)
    outputs: list[Output] = []
    for index, measurement in enumerate(measurements):
        outputs += guard.push(measurement, None if arrivals_ns is None else arrivals_ns[index])
    return guard, [*outputs, *guard.finish()]


def got(guard: GuardedEstimator) -> list[tuple[type, int]]:
    estimator = guard._estimator
    assert isinstance(estimator, NotingEstimator)
    return estimator.order


def events(outputs: list[Output]) -> list[Event]:
    return [output for output in outputs if isinstance(output, Event)]


def of(guard: GuardedEstimator, name: str) -> StreamStatus:
    return next(stream for stream in guard.status.streams if stream.name == name)


def stamped(sample: Measurement, stamp: object) -> Measurement:
    """With a stamp that its class refuses."""
    object.__setattr__(sample, "stamp_ns", stamp)
    return sample


@pytest.mark.long
@settings(max_examples=40)
@given(
    garbage=st.lists(
        st.tuples(
            st.sampled_from(["joints", "imu", "tracks", "stranger"]),
            st.one_of(
                st.integers(-(2**70), 2**70),
                st.integers(T0 - 10 * S, T0 + 10 * S),
                st.floats(),
                st.none(),
                st.text(max_size=3),
            ),
            st.integers(0, 150),
        ),
        max_size=80,
    ),
    knows_arrival=st.booleans(),
)
def test_garbage_never_raises_and_everything_is_counted(
    garbage: list[tuple[str, object, int]], knows_arrival: bool
) -> None:
    make: dict[str, Any] = {"joints": joints, "imu": imu, "tracks": tracks}
    samples: list[Any] = three_streams(0.5)
    for kind, stamp, at in garbage:
        samples.insert(at, object() if kind == "stranger" else stamped(make[kind](0), stamp))
    guard, _ = run(samples, [T0 + number * MS for number in range(len(samples))] if knows_arrival else None)
    strangers = sum(kind == "stranger" for kind, *_ in garbage)
    assert sum(stream.arrived for stream in guard.status.streams) + strangers == len(samples)
    for stream in guard.status.streams:
        assert stream.held == 0
        assert stream.arrived == stream.used + sum(stream.refused.values()), stream
    used = got(guard)
    for kind in (ImuSample, JointSample):
        stamps = [stamp_ns for each, stamp_ns in used if each is kind]
        assert stamps == sorted(set(stamps)), "the estimator gets rising stamps"
    assert sum(stream.used for stream in guard.status.streams) == len(used)


@pytest.mark.parametrize(
    ("stamp", "reason"),
    [
        (1.7e9, "not_integer"),
        (True, "not_integer"),
        (-5, "negative"),
        (2**63, "overflow"),
        (T0 + 3600 * S, "future"),
        (T0 - 3600 * S, "past"),
        (T0 + 995 * MS, "repeated"),
    ],
)
def test_one_impossible_stamp_is_refused_by_name(stamp: object, reason: str) -> None:
    samples = three_streams(3.0)
    at = next(index for index, each in enumerate(samples) if each.stamp_ns == T0 + S and isinstance(each, JointSample))
    guard, outputs = run([*samples[:at], stamped(joints(0), stamp), *samples[at:]])
    assert got(guard) == [(type(each), each.stamp_ns) for each in samples]
    (event,) = events(outputs)
    assert event.kind == "stamp_refused"
    assert event.detail.startswith(f"1 sample of joints refused ({reason}): the stamp of the first was {stamp}")
    assert of(guard, "joints").refused == {reason: 1}


def test_numpy_integers_are_stamps() -> None:
    guard, outputs = run([stamped(joints(0), np.int64(T0 + number * 5 * MS)) for number in range(50)])
    assert of(guard, "joints").used == 50
    assert not events(outputs)


@pytest.mark.parametrize("step_s", [3600.0, -10.0, -0.3, 61.0])
def test_a_step_of_all_clocks_loses_nothing_and_outputs_follow(step_s: float) -> None:
    samples, step_ns = three_streams(4.0), round(step_s * S)
    guard, outputs = run(moved_from(samples, T0 + 2 * S, step_ns))
    assert got(guard) == [(type(each), each.stamp_ns) for each in samples], "the estimator's clock never steps"
    (event,) = events(outputs)
    assert event.kind == "clock_step"
    assert event.stamp_ns == T0 + 2 * S + step_ns
    assert f"stepped {'forward' if step_s > 0 else 'back'} by {abs(step_s):g} s" in event.detail
    stamps = [output.state.stamp_ns for output in outputs if isinstance(output, Estimate)]
    expected = moved_from(map(joints, range(T0, T0 + 4 * S, 5 * MS)), T0 + 2 * S, step_ns)
    assert stamps == [each.stamp_ns for each in expected]


@pytest.mark.parametrize("step_s", [3600.0, -10.0])
@pytest.mark.parametrize("kind", [ImuSample, JointSample])
def test_a_step_of_one_clock_is_undone(kind: type, step_s: float) -> None:
    samples = three_streams(4.0)
    guard, outputs = run(moved_from(samples, T0 + 2 * S, round(step_s * S), (kind,)))
    assert sorted(got(guard), key=str) == sorted(((type(each), each.stamp_ns) for each in samples), key=str)
    (event,) = events(outputs)
    assert event.kind == "clock_step"
    assert f"the clock of {'imu' if kind is ImuSample else 'joints'} stepped" in event.detail
    stamps = [output.state.stamp_ns for output in outputs if isinstance(output, Estimate)]
    assert stamps == [T0 + number * 5 * MS for number in range(800)], "the other streams' clock goes on"


@pytest.mark.parametrize("step_s", [0.15, 0.3, 0.9])
def test_a_camera_clock_that_steps_ahead_by_less_than_what_is_impossible_is_followed(step_s: float) -> None:
    samples = three_streams(8.0)
    guard, outputs = run(moved_from(samples, T0 + 4 * S, round(step_s * S), (StereoTracks,)))
    (event,) = events(outputs)
    assert event.kind == "clock_step"
    assert "the clock of stereo_tracks stepped forward by" in event.detail
    assert of(guard, "stereo_tracks").used == of(guard, "stereo_tracks").arrived
    stamps = np.array([stamp_ns for kind, stamp_ns in got(guard) if kind is StereoTracks])
    own = np.array([each.stamp_ns for each in samples if isinstance(each, StereoTracks)])
    assert np.abs(stamps - own).max() <= 6 * MS, "to a period of the other streams"


@pytest.mark.parametrize("stall_s", [0.25, 0.45, 0.9])
def test_images_are_not_ahead_where_the_other_streams_are_held_back(stall_s: float) -> None:
    samples, begin_ns, end_ns = three_streams(8.0), 4 * S, round((4.0 + stall_s) * S)
    times = [each.stamp_ns - T0 for each in samples]
    is_held = [
        begin_ns < time_ns < end_ns and not isinstance(each, StereoTracks)
        for each, time_ns in zip(samples, times, strict=True)
    ]
    order = sorted(range(len(samples)), key=lambda i: end_ns if is_held[i] else times[i])
    guard, outputs = run([samples[i] for i in order])
    assert not events(outputs)
    assert all(stream.used == stream.arrived for stream in guard.status.streams)
    stamps = [stamp_ns for kind, stamp_ns in got(guard) if kind is StereoTracks]
    assert stamps == [each.stamp_ns for each in samples if isinstance(each, StereoTracks)]


def test_a_single_image_that_is_ahead_is_refused_by_name() -> None:
    samples = three_streams(8.0)
    frames = [i for i, each in enumerate(samples) if isinstance(each, StereoTracks)]
    samples[frames[40]] = moved(samples[frames[40]], 500 * MS)
    guard, outputs = run(samples)
    (event,) = events(outputs)
    assert event.kind == "stamp_refused"
    assert "(ahead)" in event.detail
    assert dict(of(guard, "stereo_tracks").refused) == {"ahead": 1}


def test_a_clock_that_steps_there_and_back_is_followed_twice() -> None:
    samples = moved_from(moved_from(three_streams(6.0), T0 + 4 * S, -100 * S), T0 + 2 * S, 100 * S)
    guard, outputs = run(samples)
    assert [event.kind for event in events(outputs)] == ["clock_step", "clock_step"]
    assert all(stream.used == stream.arrived for stream in guard.status.streams)


def test_times_of_arrival_say_how_long_a_restarted_driver_was_away() -> None:
    """Five seconds pass; the driver's new clock begins an hour earlier."""
    before, after = three_streams(2.0), [moved(each, -3600 * S) for each in three_streams(2.0)]
    arrivals = [each.stamp_ns - T0 for each in before] + [each.stamp_ns - T0 + 3607 * S for each in after]
    guard, outputs = run([*before, *after], arrivals)
    (event,) = events(outputs)
    assert event.kind == "clock_step"
    stamps = [stamp_ns for kind, stamp_ns in got(guard) if kind is JointSample]
    assert stamps[400] - stamps[399] == pytest.approx(5005 * MS, abs=10 * MS)


def test_a_pause_is_no_step() -> None:
    """Without times of arrival up to online.longest_pause_s, with them as long as it lasted."""
    samples = moved_from(three_streams(4.0), T0 + 2 * S, 30 * S)
    for arrivals in (None, [each.stamp_ns - T0 for each in samples]):
        guard, outputs = run(samples, arrivals)
        assert not events(outputs)
        assert got(guard) == [(type(each), each.stamp_ns) for each in samples]


@pytest.mark.parametrize("stall_s", [1.5, 4.0])
def test_samples_that_were_held_back_are_no_step(stall_s: float) -> None:
    """The network stops, then everything comes at once: what counts is that stamps go on where they ended."""
    samples = three_streams(8.0)
    end_ns = round((2.0 + stall_s) * S)
    times = [each.stamp_ns - T0 for each in samples]
    guard, outputs = run(samples, [end_ns if 2 * S < time_ns < end_ns else time_ns for time_ns in times])
    assert not events(outputs)
    assert sorted(got(guard), key=lambda one: one[1]) == [(type(each), each.stamp_ns) for each in samples]
    assert all(stream.used == stream.arrived for stream in guard.status.streams)


def test_a_stream_that_falls_behind_the_others_is_still_in_doubt() -> None:
    """Its stamps go on where they ended, but the others' are two seconds ahead."""
    samples = three_streams(6.0)
    times = [each.stamp_ns - T0 for each in samples]
    late = [
        time_ns + 2 * S * (isinstance(each, JointSample) and time_ns > 2 * S)
        for each, time_ns in zip(samples, times, strict=True)
    ]
    order = sorted(range(len(samples)), key=late.__getitem__)
    guard, outputs = run([samples[i] for i in order], [late[i] for i in order])
    (step,) = (event for event in events(outputs) if event.kind == "clock_step")
    assert "the clock of joints stepped back by" in step.detail
    assert of(guard, "imu").used == of(guard, "imu").arrived


def test_repeated_samples_give_one_event_at_a_time() -> None:
    guard, outputs = run([each for sample in three_streams(4.0) for each in (sample, sample)])
    assert of(guard, "joints").refused == {"repeated": 800}
    assert len(events(outputs)) == 3
    assert any(event.detail.startswith("800 samples of joints refused (repeated)") for event in events(outputs))


def test_a_stream_with_another_clock_from_the_start_is_left_as_it_is() -> None:
    samples = [
        moved(each, 5000 * S) if not isinstance(each, ImuSample | JointSample) else each for each in three_streams(3.0)
    ]
    guard, outputs = run(samples)
    assert not events(outputs)
    assert sorted(got(guard), key=str) == sorted(((type(each), each.stamp_ns) for each in samples), key=str)


def test_status_says_used_of_arrived() -> None:
    samples = three_streams(2.0)
    guard, outputs = run([*samples[:400], moved(samples[401], 100 * S), *samples[400:]])
    text = str(guard.status)
    assert "used 400 of 401, 1 refused (future)" in text
    assert sum(type(output).__name__ == "Status" for output in outputs) == 2
