# SPDX-License-Identifier: BSD-3-Clause
"""What a comparison writes: numbers, ranking, figures and pages."""

import json
from collections.abc import Mapping
from pathlib import Path

import pytest
from headless_chromium import chromium, drawn

from coclo_vio.evaluation.evaluation import Evaluation
from coclo_vio.evaluation.evaluation_record import ComparisonRecord, ComparisonsRecord, RankingRecord
from coclo_vio.runs.comparison_report import Compared, report_title, write_comparison, write_comparisons
from coclo_vio.runs.evaluating import evaluate_run
from coclo_vio.runs.run_config import RunConfig, resolve
from coclo_vio.runs.running import run_modes

CONFIG = resolve("daisy")

pytestmark = pytest.mark.usefixtures("stand_ins")


def compared(recording: Path, folder: Path, modes: list[str], config: RunConfig) -> Mapping[str, Evaluation]:
    run_modes(recording, modes, config, folder)
    return evaluate_run(folder, config.evaluation)[0]


@pytest.mark.long
def test_a_comparison_writes_numbers_figures_and_a_report(leg_log: Path, tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    evaluations = compared(leg_log, tmp_path, ["naive", "naive_rolling"], CONFIG)
    report = write_comparison(tmp_path, "a <walk>", evaluations, CONFIG)
    values = json.loads((tmp_path / "compare.json").read_text(encoding="utf-8"))
    assert set(values) == {"naive", "naive_rolling"}
    assert values["naive"]["ate_m"] == evaluations["naive"].ate_m
    assert set(ComparisonRecord.read(tmp_path / "compare.json").root) == set(evaluations)
    RankingRecord.read(tmp_path / "ranking.json")
    assert (tmp_path / "figures" / "contacts.png").stat().st_size > 1000
    assert not (tmp_path / "figures" / "keyframes.png").exists()
    page = report.read_text(encoding="utf-8")
    assert "a &lt;walk&gt;" in page
    assert "data:image/png" not in page, "zoomable plots are there instead"
    assert 'id="plot-contacts"' in page
    assert "The robot daisy travelled" in page


def test_a_comparison_shows_keyframes_calibration_faults_and_events(film: Path, tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    config = resolve(settings=["faults.frame_loss=0.25"])
    evaluations = compared(film, tmp_path, ["resting"], config)
    page = write_comparison(tmp_path, "film", evaluations, config).read_text(encoding="utf-8")
    assert (tmp_path / "figures" / "keyframes.png").stat().st_size > 1000
    assert 'id="plot-keyframes"' in page
    assert "A body travelled 0.00 m" in page
    assert "Simulated faults: frame_loss 0.25." in page
    assert "<td>resting</td><td>vision_lost</td><td>it is dark</td>" in page
    assert "<td>2.00 &plusmn; 3.00</td>" in page, "the stereo scale that was learnt, %"


def test_without_plotly_the_report_has_the_figures_as_pictures(
    leg_log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("matplotlib")
    monkeypatch.setattr("coclo_vio.runs.comparison_report.can_zoom", lambda: False)
    page = write_comparison(tmp_path, "walk", compared(leg_log, tmp_path, ["naive"], CONFIG), CONFIG)
    text = page.read_text(encoding="utf-8")
    assert "data:image/png" in text
    assert 'alt="contacts"' in text
    assert "<script" not in text


@pytest.mark.long
@pytest.mark.parametrize("width", [400, 1280])
def test_a_browser_draws_the_report(leg_log: Path, tmp_path: Path, width: int) -> None:
    chromium()
    evaluations = compared(leg_log, tmp_path, ["naive", "naive_rolling"], CONFIG)
    page = write_comparison(tmp_path, "walk", evaluations, CONFIG)
    assert page.stat().st_size < 5_000_000
    shown = drawn(page, tmp_path, width)
    assert shown.console == []
    assert shown.measured["failed"] == ""
    assert shown.measured["drawn"] == page.read_text(encoding="utf-8").count('class="zoomable"') == 5
    assert shown.measured["lines"] == 3 * (2 + 3 + 3) + 2, "ground truth has no error, the others all curves"
    assert shown.measured["buttons"] == "Zoom, Pan, Zoom in, Zoom out, Reset axes", "nothing sends data anywhere"
    assert shown.measured["needed"] <= shown.measured["width"] <= width, "no horizontal scrolling"
    assert shown.measured["smallest"] >= 11.0


def test_several_recordings_have_a_page_with_links_to_their_own(leg_log: Path, tmp_path: Path) -> None:
    recordings = {}
    for name, mode in (("first", "naive"), ("second", "naive_rolling")):
        evaluations = compared(leg_log, tmp_path / name, [mode], CONFIG)
        recordings[name] = Compared(tmp_path / name, evaluations, CONFIG)
    page = write_comparisons(tmp_path, "2 recordings", recordings)
    text = page.read_text(encoding="utf-8")
    assert page == tmp_path / "report.html"
    assert 'href="first/report.html"' in text
    assert 'href="second/report.html"' in text
    both = ComparisonsRecord.read(tmp_path / "compare.json")
    assert set(both.root) == {"first", "second"}
    assert json.loads((tmp_path / "ranking.json").read_text(encoding="utf-8")).keys() == {"first", "second"}


def test_a_comparison_without_any_evaluation_states_it(leg_log: Path, tmp_path: Path) -> None:
    compared(leg_log, tmp_path, ["failing_at_once"], CONFIG)
    page = write_comparison(tmp_path, "walk", {}, CONFIG).read_text(encoding="utf-8")
    assert "No estimate could be compared with ground truth." in page


def test_the_title_names_the_robot_where_there_is_one() -> None:
    assert report_title("walk", CONFIG) == "walk, daisy"
    assert report_title("film", resolve()) == "film"
