# SPDX-License-Identifier: BSD-3-Clause
"""Joints and feet whose messages each hold a part: of one time, or milliseconds apart."""

import numpy as np
import pytest
from tiny_bags import JOINTS, START_NS, STEP_NS, TinyBag

from coclo_vio.datasets.dataset import DatasetConfig, open_dataset
from coclo_vio.datasets.rosbag.reading_parts import span_ns, tolerance_ns
from coclo_vio.values.config import parse_settings
from coclo_vio.values.measurements import FootForceSample, JointSample

MS = 1_000_000
SIDES = (JOINTS[:2], JOINTS[2:])


@pytest.fixture(params=["walk.bag", "walk.mcap"])
def bag(request, tmp_path):
    return TinyBag(tmp_path / request.param)


def add_sides(bag, apart_ns, *, topics=("/left", "/right"), lost=(), count=60):
    """Each side's joints at 100 Hz, the right ones later; every angle is 1 rad/s times the time since the start."""
    for i in range(count):
        for side, names in enumerate(SIDES):
            since_ns = i * STEP_NS + side * apart_ns
            if (i, side) not in lost:
                angle = since_ns / 1e9
                fields = {"position": (angle, angle), "velocity": (1.0, 1.0), "effort": (2.0, 2.0)}
                bag.add_joints(START_NS + since_ns, names=names, topic=topics[side], **fields)


def joints_of(dataset):
    return list(dataset.measurements(frozenset({JointSample})))


@pytest.mark.parametrize("topics", [("/left", "/right"), ("/joints", "/joints")], ids=["topics", "messages"])
@pytest.mark.parametrize("apart_ms", [0, 2, 5])
def test_parts_that_come_apart_are_complete_samples_at_the_later_stamp(bag, biped, topics, apart_ms):
    add_sides(bag, apart_ms * MS, topics=topics)
    dataset = open_dataset(bag.write(), biped)
    samples = joints_of(dataset)
    assert len(samples) == 60
    for i, sample in enumerate(samples):
        assert sample.stamp_ns == START_NS + i * STEP_NS + apart_ms * MS
        measured_ns = np.array([0, 0, 1, 1]) * apart_ms * MS + i * STEP_NS
        np.testing.assert_allclose(sample.position, measured_ns / 1e9, atol=1e-12)
        np.testing.assert_array_equal(sample.effort, 2.0)
    notes = [note for note in dataset.report().notes if "samples are complete" in note]
    assert notes == [] if apart_ms == 0 else notes[0].startswith("joints: 100.0 % of 60 samples are complete; their")


def test_a_lost_part_makes_one_incomplete_sample_and_the_share_is_noted(bag, biped):
    add_sides(bag, 3 * MS, lost={(20, 1)})
    dataset = open_dataset(bag.write(), biped)
    samples = joints_of(dataset)
    incomplete = [i for i, sample in enumerate(samples) if np.isnan(sample.position).any()]
    assert len(samples) == 60
    assert incomplete == [20]
    np.testing.assert_array_equal(np.isnan(samples[20].position), [False, False, True, True])
    assert any("joints: 98.3 % of 60 samples are complete" in note for note in dataset.report().notes)


def test_a_lost_part_of_equal_stamps_is_not_filled_by_the_next_reading(bag, biped):
    add_sides(bag, 0, lost={(20, 0)})
    samples = joints_of(open_dataset(bag.write(), biped))
    assert [i for i, sample in enumerate(samples) if np.isnan(sample.position).any()] == [20]


def test_a_part_that_comes_twice_as_often_is_read_at_the_rate_of_the_others(bag, biped):
    for i in range(120):
        bag.add_joints(START_NS + i * STEP_NS // 2, names=SIDES[0], topic="/left")
        if i % 2 == 0:
            bag.add_joints(START_NS + i * STEP_NS // 2 + 3 * MS, names=SIDES[1], topic="/right")
    samples = joints_of(open_dataset(bag.write(), biped))
    assert sum(not np.isnan(sample.position).any() for sample in samples) >= 58
    assert len(samples) <= 66  # the first show which part is rare


def test_parts_farther_apart_than_the_limit_stay_apart_and_the_setting_is_named(bag, biped):
    for i in range(40):
        for side, names in enumerate(SIDES):
            bag.add_joints(START_NS + i * 10 * STEP_NS + side * 50 * MS, names=names, topic=f"/{side}")
    path = bag.write()
    dataset = open_dataset(path, biped)
    assert all(np.isnan(sample.position).any() for sample in joints_of(dataset))
    assert any("joints: 0.0 % of 80" in note and "parts_tolerance_s" in note for note in dataset.report().notes)
    config = DatasetConfig.parse(parse_settings(["rosbag.parts_tolerance_s=0.06"]), "test")
    assert sum(not np.isnan(sample.position).any() for sample in joints_of(open_dataset(path, biped, config))) == 40


def test_foot_forces_that_come_apart_are_one_sample(bag, biped):
    for i in range(30):
        for side, leg in enumerate(("left", "right")):
            stamp_ns = START_NS + i * STEP_NS + side * 4 * MS
            bag.add(f"/force/{leg}", "geometry_msgs/msg/WrenchStamped", stamp_ns, wrench__force__z=10.0 + side)
    dataset = open_dataset(bag.write(), biped)
    samples = list(dataset.measurements(frozenset({FootForceSample})))
    assert [list(sample.force) for sample in samples] == [[10.0, 11.0]] * 30


def test_the_limit_follows_the_parts_and_is_bounded():
    even = [(name, START_NS + i * STEP_NS + k * STEP_NS // 4) for i in range(20) for k, name in enumerate("abcd")]
    assert span_ns(even) == 7_500_000
    assert tolerance_ns(7_500_000, 500_000) == 9_750_000
    assert span_ns([("a", 0), ("b", 5)]) == 0  # of one message each nothing follows
    assert span_ns([]) == 0
    assert tolerance_ns(10**9, 500_000) == 20_000_000
    assert tolerance_ns(0, 500_000) == 500_000
