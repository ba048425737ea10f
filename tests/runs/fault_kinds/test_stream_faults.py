# SPDX-License-Identifier: BSD-3-Clause
"""Faults of stamps and arrival on samples made by hand, early and late images, and gaps of ground truth."""

from itertools import pairwise

import numpy as np
import pytest
from fault_samples import BEGIN_NS, STEP_NS, of_kind, recorded, step_of, with_faults

from coclo_vio.runs.faults import Faults, FaultsConfig
from coclo_vio.values.errors import ConfigError
from coclo_vio.values.measurements import ImuSample, JointSample, Measurement, StereoFrame, StereoTracks
from coclo_vio.values.trajectory import GroundTruth, Trajectory

ROWS = recorded(100)


def test_shuffled_samples_keep_their_stamps_and_are_all_there() -> None:
    faulty = with_faults(ROWS, shuffled="2:3:0.25", seed=1)
    assert sorted(map(id, faulty)) == sorted(map(id, ROWS))
    stamps = np.array([one.stamp_ns for one in faulty])
    backwards = np.flatnonzero(np.diff(stamps) < 0)
    assert len(backwards) > 20
    assert (np.maximum.accumulate(stamps) - stamps).max() <= 250_000_000
    inside = [step_of(faulty[row]) for row in backwards]
    assert min(inside) >= 20
    assert max(inside) < 53


def test_repeated_samples_follow_themselves() -> None:
    faulty = with_faults(ROWS, repeated_samples="2:5:0.3", seed=1)
    twice = [one for one, other in pairwise(faulty) if one is other]
    assert len(faulty) == len(ROWS) + len(twice)
    assert len(twice) == pytest.approx(0.3 * 6 * 50, abs=35)
    assert {step_of(one) for one in twice} <= set(range(20, 70))


def test_a_stamp_ahead_is_of_single_samples_of_one_stream() -> None:
    faulty = with_faults(ROWS, future_stamps="joints:1:8:3600", seed=5)
    assert [type(one) for one in faulty] == [type(one) for one in ROWS]
    ahead = [(one, row) for one, row in zip(faulty, ROWS, strict=True) if one is not row]
    assert 0 < len(ahead) < 12
    for one, row in ahead:
        assert isinstance(one, JointSample)
        assert one.stamp_ns == row.stamp_ns + 3_600_000_000_000
        assert 10 <= step_of(row) < 90


@pytest.mark.parametrize(
    ("stream", "kinds"), [("all", {*map(type, ROWS)}), ("stereo", {StereoFrame}), ("imu", {ImuSample})]
)
def test_a_clock_steps_for_its_span_and_the_order_of_arrival_stays(stream: str, kinds: set[type]) -> None:
    faulty = with_faults(ROWS, clock_steps=f"{stream}:2:3:-0.5")
    for one, row in zip(faulty, ROWS, strict=True):
        is_stepped = type(row) in kinds and 20 <= step_of(row) < 50
        assert one.stamp_ns == row.stamp_ns - (500_000_000 if is_stepped else 0)
        assert type(one) is type(row)


@pytest.mark.parametrize("delay_s", [0.25, -0.25, -0.04])
def test_late_and_early_images_come_in_the_order_of_stamps_and_all_of_them(delay_s: float) -> None:
    faulty = with_faults(ROWS, image_delay_s=delay_s)
    stamps = [one.stamp_ns for one in faulty]
    assert stamps == sorted(stamps)
    frames, plain = of_kind(faulty, StereoFrame), of_kind(ROWS, StereoFrame)
    assert [one.stamp_ns for one in frames] == [one.stamp_ns + round(delay_s * 1e9) for one in plain]

    def others(rows: list[Measurement]) -> list[Measurement]:
        return [one for one in rows if type(one) not in {StereoFrame, StereoTracks}]

    assert others(faulty) == others(ROWS)


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"clock_steps": "cameras:1:2:3"}, "there is no stream cameras; there are: all, "),
        ({"future_stamps": "1:2:3"}, "is no STREAM:START:SECONDS:AHEAD_S, such as joints:20:5:3600"),
        ({"repeated_samples": "1:2:1.5"}, "the size of SHARE must be between 0 and 1"),
    ],
)
def test_a_malformed_fault_of_a_stream_is_named(values: dict[str, str], words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        with_faults(ROWS, **values)


def truth_of(count: int, *, has_stamps: bool) -> GroundTruth:
    stamps = BEGIN_NS * has_stamps + np.arange(count, dtype=np.int64) * STEP_NS
    return GroundTruth(Trajectory(stamps, np.tile(np.eye(4), (count, 1, 1))), has_stamps, "test")


@pytest.mark.parametrize("has_stamps", [True, False])
def test_ground_truth_has_gaps_and_the_measurements_stay(*, has_stamps: bool) -> None:
    faults = Faults(FaultsConfig.parse({"truth_gaps": ["1:0.5", "3:1"]}, "test"))
    assert faults.config.leaves_measurements
    assert not faults.config.is_none
    truth = truth_of(60, has_stamps=has_stamps)
    cut = faults.truth(truth, lambda sensors: iter(ROWS))
    assert cut is not None
    steps = (cut.trajectory.stamps_ns - truth.trajectory.stamps_ns[0]) // STEP_NS
    assert set(steps.tolist()) == set(range(60)) - {*range(10, 15), *range(30, 40)}
    with pytest.raises(ConfigError, match="no pose of the ground truth is left; make them shorter"):
        Faults(FaultsConfig.parse({"truth_gaps": "0:100"}, "test")).truth(truth, lambda sensors: iter(ROWS))
    assert Faults(FaultsConfig()).truth(truth, lambda sensors: iter(ROWS)) is truth
