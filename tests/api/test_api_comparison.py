# SPDX-License-Identifier: BSD-3-Clause
"""Comparisons through the API: metrics by recording, rankings, and the same files that the command line writes."""

import json
import sys
from collections.abc import Sequence
from pathlib import Path

import pytest

import coclo_vio as cv
from coclo_vio.api import comparison
from coclo_vio.evaluation.evaluation_record import EvaluationRecord

MODES = ["naive", "naive_rolling"]


@pytest.fixture(scope="module")
def twin(leg_log: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The leg log once more, under the same name in another folder."""
    folder = tmp_path_factory.mktemp("twin") / "walk"
    folder.mkdir()
    for file in leg_log.iterdir():
        (folder / file.name).write_bytes(file.read_bytes())
    return folder


@pytest.mark.long
def test_two_recordings_have_a_page_over_both(
    leg_log: Path, twin: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)  # a report without figures takes less time
    result = cv.compare([cv.open(leg_log, robot="daisy"), twin], MODES, output=tmp_path / "both")
    assert isinstance(result, cv.Comparison)
    assert list(result.recordings) == list(result.metrics) == ["walk", "walk_2"]
    written = json.loads((tmp_path / "both" / "compare.json").read_text(encoding="utf-8"))
    for name, metrics in result.metrics.items():
        assert list(metrics) == MODES
        assert written[name] == {key: EvaluationRecord.of(one).to_json() for key, one in metrics.items()}
        assert (tmp_path / "both" / name / "report.html").is_file()
    page = (tmp_path / "both" / "report.html").read_text(encoding="utf-8")
    assert '<a href="walk_2/report.html">' in page
    assert [row.name for row in result.table.rows if not row.is_paper] == ["walk", "walk_2"]


def test_one_recording_has_its_report_in_the_folder_itself(leg_log: Path, tmp_path: Path) -> None:
    result = cv.compare([leg_log], ["naive"], output=tmp_path / "out")
    assert {path.name for path in (tmp_path / "out").iterdir()} >= {"report.html", "compare.json", "run.json"}
    compared = result.recordings["walk"]
    assert compared.title == "walk, daisy"
    assert not compared.has_failed
    assert compared.run.folder == tmp_path / "out"


def test_without_an_output_nothing_is_written_to_the_working_folder(
    leg_log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    result = cv.compare([leg_log], ["naive"])
    assert result.metrics["walk"]["naive"].ate_m < 0.1
    assert list(tmp_path.iterdir()) == []


def test_a_mode_that_lacks_something_is_a_failure_of_its_recording(leg_log: Path) -> None:
    compared = cv.compare([leg_log], ["naive", "vins"]).recordings["walk"]
    assert set(compared.metrics) == {"naive"}
    assert "walk has no stereo images" in compared.failures["vins"]
    assert not compared.has_failed, "the other mode has a result"


def test_the_default_modes_are_those_of_the_recording(leg_log: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    chosen: list[Sequence[str]] = []

    def keep_modes(recording: cv.Recording, modes: Sequence[str], **_: object) -> cv.Run:
        chosen.append(modes)
        return cv.run(recording, "naive")

    monkeypatch.setattr(comparison, "run", keep_modes)
    recording = cv.open(leg_log)
    cv.compare([recording])
    assert chosen == [recording.modes] == [("coclo", "coclo_paper", "inekf", "naive")]
