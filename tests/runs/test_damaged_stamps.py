# SPDX-License-Identifier: BSD-3-Clause
"""A recording with damaged stamps: the run goes through, and its record says what was refused."""

import csv
import shutil
from pathlib import Path

import numpy as np
import pytest

import coclo_vio as cv

HOUR_NS = 3_600_000_000_000


@pytest.fixture
def damaged_log(leg_log: Path, tmp_path: Path) -> Path:
    """The short leg log with the stamp of one row, in the middle, an hour ahead."""
    folder = tmp_path / "damaged"
    shutil.copytree(leg_log, folder)
    (log,) = [file for file in folder.glob("*.csv") if "groundtruth" not in file.name]
    with log.open(newline="", encoding="utf-8") as stream:
        header, *rows = csv.reader(stream)
    column = header.index(next(name for name in header if "stamp" in name))
    rows[len(rows) // 2][column] = str(int(rows[len(rows) // 2][column]) + HOUR_NS)
    with log.open("w", newline="", encoding="utf-8") as stream:
        csv.writer(stream).writerows([header, *rows])
    return folder


def test_one_stamp_an_hour_ahead_ends_nothing(damaged_log: Path, leg_log: Path) -> None:
    run, clean = cv.run(damaged_log, "coclo"), cv.run(leg_log, "coclo")
    record, expected = run.record.estimators["coclo"], clean.record.estimators["coclo"]
    assert record.failure is None
    assert record.estimates >= expected.estimates - 1
    assert [event.kind for event in record.events] == ["stamp_refused"] * len(record.events)
    assert any("(future)" in event.detail for event in record.events)
    assert record.recording_ns == expected.recording_ns
    assert run.record.recording_ns == clean.record.recording_ns
    ends = [each.trajectories["coclo"].T_world_body[-1][:3, 3] for each in (run, clean)]
    assert np.linalg.norm(ends[0] - ends[1]) < 0.005
