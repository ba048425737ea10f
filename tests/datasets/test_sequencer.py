# SPDX-License-Identifier: BSD-3-Clause
from itertools import count, islice

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from coclo_vio.datasets.sequencer import merge_streams, sort_measurements
from coclo_vio.values.measurements import (
    BodyTwistSample,
    CameraImuSample,
    FootForceSample,
    ImuSample,
    JointSample,
    StereoFrame,
    StereoTracks,
)


def force_at(stamp_ns):
    return FootForceSample(stamp_ns, [1.0])


def imu_at(stamp_ns):
    return ImuSample(stamp_ns, np.zeros(3), np.zeros(3))


def joints_at(stamp_ns):
    return JointSample(stamp_ns, [0.0], [0.0], [0.0])


MAKERS = (force_at, imu_at, joints_at)
STAMPS = st.lists(st.integers(0, 30), max_size=20)


@settings(max_examples=200, deadline=None, derandomize=True)
@given(st.tuples(STAMPS, STAMPS, STAMPS), st.permutations([0, 1, 2]))
def test_merged_streams_are_in_order_and_complete(stamps, order):
    streams = [[make(stamp) for stamp in sorted(mine)] for make, mine in zip(MAKERS, stamps, strict=True)]
    merged = list(merge_streams([streams[i] for i in order]))
    rank = {FootForceSample: 0, ImuSample: 1, JointSample: 2}
    keys = [(sample.stamp_ns, rank[type(sample)]) for sample in merged]
    assert keys == sorted(keys)
    assert {id(sample) for sample in merged} == {id(sample) for stream in streams for sample in stream}
    assert len(merged) == sum(map(len, streams))


@settings(max_examples=100, deadline=None, derandomize=True)
@given(st.lists(st.tuples(st.sampled_from(MAKERS), st.integers(0, 10)), max_size=30))
def test_sorting_is_stable_and_orders_as_the_merge_does(made):
    samples = [make(stamp) for make, stamp in made]
    ordered = list(sort_measurements(samples))
    streams = [
        sorted((s for s in samples if type(s) is kind), key=lambda s: s.stamp_ns)
        for kind in (FootForceSample, ImuSample, JointSample)
    ]
    assert [id(sample) for sample in ordered] == [id(sample) for sample in merge_streams(streams)]


def test_the_merge_is_lazy():
    endless = [(imu_at(2 * i) for i in count()), (joints_at(3 * i) for i in count())]
    stamps = [sample.stamp_ns for sample in islice(merge_streams(endless), 7)]
    assert stamps == [0, 0, 2, 3, 4, 6, 6]


def test_a_sample_out_of_order_is_passed_on_not_lost():
    stamps = [sample.stamp_ns for sample in merge_streams([[imu_at(5), imu_at(1), imu_at(6)], [joints_at(4)]])]
    assert sorted(stamps) == [1, 4, 5, 6]
    assert stamps.index(5) < stamps.index(1)


def test_at_one_stamp_the_frame_comes_after_the_step_that_it_needs():
    image = np.zeros((2, 2), dtype=np.uint8)
    frame, camera_imu = StereoFrame(7, image, image), CameraImuSample(7, np.zeros(3), np.zeros(3))
    samples = [frame, camera_imu, joints_at(7), imu_at(7), force_at(7)]
    kinds = [type(sample) for sample in merge_streams([sample] for sample in samples)]
    assert kinds == [FootForceSample, ImuSample, JointSample, CameraImuSample, StereoFrame]


def test_at_one_stamp_the_twist_comes_before_the_tracks_that_it_leads_to():
    image = np.zeros((2, 2), dtype=np.uint8)
    twist = BodyTwistSample(7, np.zeros(3), np.zeros(3))
    vision = [StereoTracks(7, np.zeros(0), np.zeros((0, 2)), np.zeros((0, 2))), StereoFrame(7, image, image)]
    for samples in ([*vision, twist, imu_at(7)], [imu_at(7), twist, *vision]):
        kinds = [type(sample) for sample in merge_streams([sample] for sample in samples)]
        assert kinds == [ImuSample, BodyTwistSample, StereoFrame, StereoTracks]
