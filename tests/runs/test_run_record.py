# SPDX-License-Identifier: BSD-3-Clause
"""``run.json``: read back as it was written; other schema versions and malformed files are refused in one sentence."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from coclo_vio.datasets.read_report import ReadReport, StreamReport
from coclo_vio.runs.run_folder import read_record
from coclo_vio.runs.run_record import (
    CalibrationRecord,
    EventRecord,
    GroundTruthRecord,
    KeyframeSummary,
    RunRecord,
    TrajectoryRecord,
)
from coclo_vio.values.errors import DatasetError
from coclo_vio.values.outputs import Calibration, Event

NEXT_STEP = r"; run again with `coclo-vio run` or `coclo-vio compare`$"
START_NS = 1_700_000_000_123_456_789


def trajectory(mode: str, *events: Event, **values: Any) -> TrajectoryRecord:
    usual: dict[str, Any] = {
        "sensors": ("imu", "joints"),
        "measurements": 903,
        "estimates": 300,
        "compute_s": 0.25,
        "realtime_factor": 12.0,
        "counts": {"gap": 2},
        "events": tuple(EventRecord.of(event, START_NS) for event in events),
        "keyframes": None,
        "calibration": None,
        "pictures": 0,
        "recording_ns": None,
        "failure": None,
    }
    return TrajectoryRecord(mode=mode, **{**usual, **values})


LOST = Event(START_NS + 5_000_000_000, "vision_lost", "it is dark")
RESTART = Event(START_NS + 6_500_000_000, "window_restart", "the window restarts from the last pose")


def record() -> RunRecord:
    keyframes = KeyframeSummary(
        count=3,
        tracks_median=100.0,
        tracks_p95=110.0,
        reprojection_px_median=None,
        reprojection_px_p95=None,
        iterations_median=2.0,
        iterations_p95=3.0,
        compute_ms_median=4.0,
        compute_ms_p95=5.0,
    )
    calibration = CalibrationRecord.of(
        Calibration(START_NS, np.array([1e-3, -2e-3, 3e-3]), np.full(3, 1e-4), 1.01, 0.002)
    )
    both = {"keyframes": keyframes, "calibration": calibration, "recording_ns": (START_NS, START_NS + 7)}
    return RunRecord(
        version="0.1.0",
        dataset="walk",
        robot="daisy",
        imu_calibration="robot",
        ground_truth=GroundTruthRecord(source="/vicon", has_stamps=True),
        faults={"frame_loss": 0.3},
        recording_ns=(START_NS, START_NS + 9_000_000_000),
        estimators={
            "combined_coclo": trajectory("combined", LOST, RESTART, **both),
            "combined_vins": trajectory("combined", LOST, RESTART, **both),
            "vins": trajectory("vins", LOST, failure="no IMU"),
        },
        reader=ReadReport(
            "made", (StreamReport("imu", 11, 10.0, 0, 7, 0, 0.1, 0, 0, 0, 0),), {"broken": 4}, ("a note",)
        ),
    )


def test_a_record_is_read_as_it_was_written(tmp_path: Path) -> None:
    record().write(tmp_path / "run.json")
    back = read_record(tmp_path)
    assert back == record()
    assert back.reader is not None
    assert back.reader.stream("imu") is not None
    assert back.recording_ns == (START_NS, START_NS + 9_000_000_000), "every nanosecond"


def test_times_of_events_count_from_the_beginning_of_the_recording() -> None:
    [lost, restart] = record().estimators["combined_coclo"].events
    assert (lost.time_s, lost.stamp_ns) == (5.0, LOST.stamp_ns)
    assert restart.time_s == 6.5


def test_an_event_of_a_mode_with_two_trajectories_is_listed_once() -> None:
    listed = [(mode, event.kind) for mode, event in record().events()]
    assert listed == [("combined", "vision_lost"), ("combined", "window_restart"), ("vins", "vision_lost")]


def test_each_mode_has_its_first_trajectory() -> None:
    by_mode = record().by_mode()
    assert list(by_mode) == ["combined", "vins"]
    assert by_mode["combined"] is not None
    assert by_mode["vins"].failure == "no IMU"


def test_a_learnt_calibration_is_recorded_with_its_sigmas() -> None:
    calibration = record().estimators["combined_coclo"].calibration
    assert calibration is not None
    assert calibration.rotation_body_rad == (1e-3, -2e-3, 3e-3)
    assert calibration.rotation_sigma_rad == (1e-4, 1e-4, 1e-4)
    assert (calibration.stereo_scale, calibration.stereo_scale_sigma) == (1.01, 0.002)


def test_a_record_is_frozen_and_holds_no_nan() -> None:
    with pytest.raises(ValidationError, match="frozen"):
        record().robot = "go1"  # type: ignore[misc]
    with pytest.raises(ValidationError, match="finite"):
        trajectory("coclo", compute_s=float("nan"))


OLD = {  # as the package wrote it before records had versions
    "version": "0.1.0",
    "dataset": "walk",
    "robot": "daisy",
    "imu_calibration": "robot",
    "ground_truth": None,
    "recording_ns": [1, 2],
    "estimators": {"coclo": {"mode": "coclo", "estimates": 3, "failure": None}},
    "reader": None,
}


@pytest.mark.parametrize(
    ("values", "found"),
    [
        (OLD, "no schema version"),
        (OLD | {"schema_version": 1}, "schema version 1"),
        ({"schema_version": 9}, "schema version 9"),
    ],
)
def test_a_record_of_another_version_is_refused_with_both_versions_and_the_next_step(
    values: dict[str, Any], found: str, tmp_path: Path
) -> None:
    (tmp_path / "run.json").write_text(json.dumps(values), encoding="utf-8")
    words = rf"run\.json: it has {found}, this release reads version 3{NEXT_STEP}"
    with pytest.raises(DatasetError, match=words) as caught:
        read_record(tmp_path)
    assert "\n" not in str(caught.value)


def _changed(**changes: object) -> str:
    return json.dumps(record().to_json() | changes)


def _with_trajectory(**changes: object) -> str:
    return _changed(estimators={"vins": record().to_json()["estimators"]["vins"] | changes})


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (_changed()[:-40], "is not JSON"),
        ("\xff\xfe\x00", "is not JSON"),
        ("[]", "Input should be"),
        ("{}", "it has no schema version"),
        (
            _changed(colour="red"),
            "there is no colour; the keys there are: dataset, estimators, failure, faults, findings, ground_truth",
        ),
        (
            _with_trajectory(mood="good"),
            r"there is no estimators\.vins\.mood; the keys there are: calibration, clock_steps, comp",
        ),
        (_changed(estimators=["vins"]), "estimators = .*valid dictionary"),
        (_with_trajectory(estimates="many"), r"estimators\.vins\.estimates = 'many': Input should be a valid integer"),
        (_changed(recording_ns=[1]), "recording_ns"),
        (_changed(recording_ns=["a", "b"]), r"recording_ns\.0 = 'a'"),
        (_changed(ground_truth={"source": "x"}), r"ground_truth\.has_stamps: Field required"),
        (_changed(imu_calibration="guess"), "imu_calibration = 'guess': Input should be 'recording' or 'robot'"),
    ],
)
def test_a_malformed_record_is_refused_with_key_value_and_next_step(content: str, words: str, tmp_path: Path) -> None:
    (tmp_path / "run.json").write_bytes(content.encode("latin-1"))
    with pytest.raises(DatasetError, match=rf"run\.json.*{words}.*{NEXT_STEP}") as caught:
        read_record(tmp_path)
    assert "\n" not in str(caught.value)


def test_a_record_that_lacks_a_key_names_it(tmp_path: Path) -> None:
    values = record().to_json()
    del values["dataset"]
    (tmp_path / "run.json").write_text(json.dumps(values), encoding="utf-8")
    with pytest.raises(DatasetError, match=rf"run\.json: dataset: Field required{NEXT_STEP}"):
        read_record(tmp_path)
