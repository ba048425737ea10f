# SPDX-License-Identifier: BSD-3-Clause
import numpy as np
import pytest

from coclo_vio.datasets.rosbag.message_types import IMAGE, IMU
from coclo_vio.live.intake import Intake
from coclo_vio.live.latency_histogram import LatencyHistogram
from coclo_vio.live.topic_counts import TopicCounts
from coclo_vio.live.wire import WireMessage
from coclo_vio.live.wire_events import WireEvents


def _message(number, topic="/imu", msgtype=IMU, sender=b"a"):
    return WireMessage(topic, msgtype, b"", 2_000_000, 1_000_000, number, sender)


def _intake(events, most_messages=100, most_images=2):
    return Intake(lambda topic, msgtype: True, events, most_messages=most_messages, most_images=most_images)


def test_received_and_lost_make_what_was_sent():
    counts = TopicCounts(IMU)
    numbers = [n for n in range(5, 1001) if n % 10]
    for number in numbers:
        counts.add(_message(number))
    record = counts.record()
    assert record.received == len(numbers)
    assert record.received + record.lost == 999 - 5 + 1  # the last number that came is 999
    assert record.earlier == 4


def test_messages_that_overtake_each_other_are_late_and_not_lost():
    counts = TopicCounts(IMU)
    for number in (1, 2, 4, 3, 5):
        counts.add(_message(number))
    record = counts.record()
    assert (record.lost, record.late) == (0, 1)


def test_two_senders_are_counted_apart():
    counts = TopicCounts(IMU)
    for number in (1, 2, 3):
        counts.add(_message(number, sender=b"a"))
        counts.add(_message(number + 100, sender=b"b"))
    record = counts.record()
    assert (record.senders, record.lost, record.received) == (2, 0, 6)


def test_percentiles_of_latencies_are_those_of_numpy_to_two_percent():
    random = np.random.default_rng(3)
    latencies = np.round(np.exp(random.normal(14.0, 1.0, 20_000))).astype(int)
    histogram = LatencyHistogram()
    for latency in latencies.tolist():
        histogram.add(latency)
    record = histogram.record()
    for name, share in (("p50_ms", 50), ("p95_ms", 95), ("p99_ms", 99)):
        assert getattr(record, name) == pytest.approx(np.percentile(latencies, share) / 1e6, rel=0.021)
    assert record.max_ms == pytest.approx(latencies.max() / 1e6)


def test_a_clock_that_is_behind_is_reported():
    histogram = LatencyHistogram()
    histogram.add(-5)
    assert histogram.record().negative == 1


def test_images_make_room_before_anything_else():
    events = WireEvents(0.0)
    intake = _intake(events)
    for number in range(1, 6):
        intake.take(_message(number, "/left", IMAGE))
        intake.take(_message(number))
    taken = [intake.next(0.0) for _ in range(7)]
    assert [(m.topic, m.sequence) for m in taken] == [
        ("/imu", 1), ("/imu", 2), ("/imu", 3), ("/left", 4), ("/imu", 4), ("/left", 5), ("/imu", 5),
    ]  # fmt: skip
    assert intake.next(0.0) is None
    assert intake.records()["/left"].dropped == 3
    assert any(event.kind == "wire_overload" and "/left" in event.detail for event in events.due(0))


def test_a_full_queue_drops_and_counts():
    intake = _intake(WireEvents(0.0), most_messages=3)
    for number in range(1, 11):
        intake.take(_message(number))
    assert intake.records()["/imu"].dropped == 7
    assert intake.records()["/imu"].received == 10


def test_topics_that_are_not_chosen_are_not_held():
    intake = _intake(WireEvents(0.0))
    intake.take(_message(1, "/other"))
    intake.choose(frozenset({"/imu"}))
    intake.take(_message(2, "/other"))
    assert list(intake.records()) == []
    assert intake.next(0.0).sequence == 1
    assert intake.next(0.0) is None


def test_events_of_one_reason_are_rare_and_count():
    now = [0.0]
    events = WireEvents(1.0, lambda: now[0])
    for _ in range(500):
        events.report("/imu", "cannot be decoded")
    first = events.due(10)
    assert [(event.stamp_ns, event.kind) for event in first] == [(10, "wire_message_refused")]
    assert "/imu: 500 messages: cannot be decoded" in first[0].detail
    events.report("/imu", "cannot be decoded")
    assert events.due(20) == []
    now[0] = 1.5
    assert "501 in all" in events.due(30)[0].detail
    assert events.due(40) == []


def test_reasons_without_end_do_not_fill_the_memory():
    events = WireEvents(0.0)
    for number in range(10_000):
        events.report(f"/topic{number}", "unknown")
    assert len(events.due(0, is_last=True)) <= 201
