# SPDX-License-Identifier: BSD-3-Clause
"""Outputs of a mode into the files of a run folder."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from coclo_vio.runs.modes.registry import mode_of
from coclo_vio.runs.output_logs import read_calibrations, read_health
from coclo_vio.runs.pipeline import RunSummary
from coclo_vio.runs.recorder import OutputRecorder, failed_records
from coclo_vio.runs.run_folder import read_estimates
from coclo_vio.values.errors import ConfigError
from coclo_vio.values.estimates import FootState, NavState, StateEstimate
from coclo_vio.values.measurements import LEG_SENSORS, StereoTracks
from coclo_vio.values.outputs import Calibration, Estimate, Event, KeyframeHealth, Output, Picture

LEGS = ("left", "right")
FEET = FootState(np.zeros((2, 3)), np.array([0.25, 0.75]), np.array([False, True]))


def estimate(name: str, stamp_ns: int, feet: FootState | None) -> Estimate:
    nav = NavState(np.eye(4), *(np.zeros(3) for _ in range(4)))
    return Estimate(name, StateEstimate(stamp_ns, nav, np.eye(9), feet))


OUTPUTS: tuple[Output, ...] = (
    estimate("combined_coclo", 10, FEET),
    estimate("combined_vins", 12, None),
    KeyframeHealth(12, 1, 20, 30, 40, 0.5, 6, 0.007, 8.0),
    Calibration(12, np.zeros(3), np.ones(3), 1.0, 0.1),
    Picture(12, np.zeros((4, 8, 3), dtype=np.uint8)),
    Event(12, "vision_lost", "it is dark"),
    estimate("combined_coclo", 20, FEET),
)
SUMMARY = RunSummary(
    9,
    {"combined_coclo": 2, "combined_vins": 1},
    (10, 20),
    0.5,
    {"gap": 1},
    None,
    (Event(12, "vision_lost", "dark"),),
    20,
)


@pytest.fixture
def recorder(tmp_path: Path) -> Iterator[OutputRecorder]:
    with OutputRecorder(tmp_path, mode_of("combined"), LEGS) as opened:
        yield opened


def test_each_kind_of_output_has_its_file(recorder: OutputRecorder, tmp_path: Path) -> None:
    with recorder:
        for output in OUTPUTS:
            recorder.take(output)
    assert {path.name for path in tmp_path.iterdir()} == {
        *("combined_coclo.tum", "combined_coclo_state.csv", "combined_coclo_calibration.csv"),
        *("combined_vins.tum", "combined_vins_state.csv", "combined_vins_keyframes.csv", "debug_images"),
    }
    by_legs, by_vision = (read_estimates(tmp_path, name) for name in ("combined_coclo", "combined_vins"))
    assert by_legs.trajectory.stamps_ns.tolist() == [10, 20]
    assert by_legs.contact_probability.tolist() == [[0.25, 0.75]] * 2
    assert (by_legs.leg_names, by_vision.leg_names) == (LEGS, ())
    assert len(read_health(tmp_path, "combined_vins")) == 1
    assert len(read_calibrations(tmp_path, "combined_coclo")) == 1


def test_both_trajectories_of_a_mode_are_recorded_with_how_it_fared(recorder: OutputRecorder) -> None:
    for output in OUTPUTS:
        recorder.take(output)
    records = recorder.records(SUMMARY, LEG_SENSORS | {StereoTracks})
    assert [(name, one.mode, one.estimates) for name, one in records.items()] == [
        ("combined_coclo", "combined", 2),
        ("combined_vins", "combined", 1),
    ]
    for one in records.values():
        assert one.sensors == ("foot_force", "imu", "joints", "stereo_tracks")
        assert (one.measurements, one.counts, one.pictures, one.failure) == (9, {"gap": 1}, 1, None)
        assert one.realtime_factor == pytest.approx(2e-8)
        assert [(event.time_s, event.kind) for event in one.events] == [(2e-9, "vision_lost")]
        assert one.keyframes is not None
        assert one.calibration is not None


def test_an_estimate_of_an_undeclared_trajectory_is_refused(recorder: OutputRecorder) -> None:
    words = r"the mode combined gave an estimate of 'coclo', but it declares combined_coclo, combined_vins; name the"
    with pytest.raises(ConfigError, match=words):
        recorder.take(estimate("coclo", 10, None))


def test_a_mode_that_could_not_start_is_recorded_by_its_first_trajectory() -> None:
    [(name, record)] = failed_records(mode_of("combined"), "no cameras").items()
    assert (name, record.mode, record.estimates, record.failure) == ("combined_coclo", "combined", 0, "no cameras")


def test_estimates_that_come_seldom_are_not_held_longer_than_a_quarter_of_a_second(
    recorder: OutputRecorder, tmp_path: Path
) -> None:
    """At 10 Hz sixteen of them would be 1.6 s."""
    with recorder:
        for number in range(8):
            recorder.take(estimate("combined_vins", number * 100_000_000, None))
        assert len((tmp_path / "combined_vins.tum").read_text(encoding="ascii").splitlines()) == 8
        recorder.take(estimate("combined_vins", 800_000_000, None))
        recorder.take(estimate("combined_vins", 900_000_000, None))
        recorder.take(estimate("combined_vins", 999_000_000, None))
        assert len((tmp_path / "combined_vins.tum").read_text(encoding="ascii").splitlines()) == 8
