# SPDX-License-Identifier: BSD-3-Clause
"""The report is one file that loads nothing from the network and shows every note."""

import base64
import re

import numpy as np
import pytest

from coclo_vio.evaluation.evaluate import evaluate
from coclo_vio.evaluation.html_report import ReportContent, ReportedEvent, write_report
from coclo_vio.evaluation.ranking import Ranking
from coclo_vio.values.errors import EvaluationError
from coclo_vio.values.outputs import Calibration
from coclo_vio.values.trajectory import GroundTruth


@pytest.fixture
def evaluations(walk):
    truth = walk(np.arange(0.0, 25.0, 0.02))
    numbered = GroundTruth(truth.restamped(np.arange(len(truth)) * 7_000_000), False, "mocap.csv")
    return {"legs": evaluate(truth, numbered), "<b>": evaluate(truth, GroundTruth(truth, True, "vicon"))}


def test_report_holds_numbers_notes_figures_and_configuration(evaluations, tmp_path):
    image = b"\x89PNG pretended"
    (tmp_path / "path.png").write_bytes(image)
    report = write_report(
        tmp_path / "report.html",
        "Flat & square",
        evaluations,
        [tmp_path / "path.png"],
        ReportContent({"filter": {"profile": "robust"}}),
    )
    text = report.read_text(encoding="utf-8")
    assert "<title>Flat &amp; square</title>" in text
    assert "<th>legs</th><th>&lt;b&gt;</th>" in text
    assert f"<td>{evaluations['legs'].path_length_m:.2f}</td>" in text
    assert re.search(r"The ground truth has no time stamps: its rate, (49\.9|50\.0)\d+ Hz", text)
    assert "profile: robust" in text
    assert "<td>&ndash;</td>" in text
    assert base64.b64encode(image).decode() in text
    assert not re.search(r"(?:src|href)\s*=\s*[\"'](?!data:)", text)
    assert "http" not in text


def test_the_result_is_before_the_numbers_and_the_events_are_after_them(evaluations, tmp_path):
    text = write_report(
        tmp_path / "report.html",
        "x",
        evaluations,
        content=ReportContent(
            summary=["It went <well>."],
            rankings=[Ranking("fused_legs", "vision", "undecided", 0.002, 0.003, 0.0016, 0.6)],
            events=[ReportedEvent(3.25, "vision", "vision_lost", "it is dark & cold")],
        ),
    ).read_text(encoding="utf-8")
    parts = ["It went &lt;well&gt;.", "<h2>Numbers</h2>", "fused Legs or Vision: ground truth too short to decide"]
    parts += ["ground truth resolves differences above 1.6 mm", "3.25 s", "it is dark &amp; cold", "<h2>Notes</h2>"]
    assert sorted(parts, key=text.index) == parts


def test_the_best_of_each_row_is_marked_where_less_is_better(walk, tmp_path):
    truth = walk(np.arange(0.0, 25.0, 0.02))
    vicon = GroundTruth(truth, True, "vicon")
    both = {"near": evaluate(truth, vicon), "far": evaluate(walk(np.arange(0.0, 25.0, 0.02), 1), vicon)}
    text = write_report(tmp_path / "report.html", "x", both).read_text(encoding="utf-8")
    rows = {
        line.partition("<td>")[2].partition("<")[0]: line for line in text.splitlines() if line.startswith("<tr><td>")
    }
    assert rows["ATE [m]"].index('class="best"') < rows["ATE [m]"].index(f"{both['far'].ate_m:.4f}")
    assert rows["ATE [m]"].count('class="best"') == 1
    assert "best" not in rows["Path of the estimate / ground truth"]


def test_the_configuration_is_folded(evaluations, tmp_path):
    content = ReportContent({"filter": {"profile": "robust"}})
    page = write_report(tmp_path / "report.html", "x", evaluations, content=content)
    assert re.search(r"<details>.*<pre>filter:\n  profile: robust", page.read_text(encoding="utf-8"))


def test_a_learnt_calibration_is_listed_with_its_sigmas(evaluations, tmp_path):
    learnt = Calibration(0, np.array([0.001, -0.002, 0.0]), np.array([0.0005, 0.0001, 0.003]), 1.012, 0.0015)
    content = ReportContent(calibrations={"fused_<legs>": learnt})
    text = write_report(tmp_path / "report.html", "x", evaluations, content=content).read_text(encoding="utf-8")
    section = text.partition("<h2>Calibration of the cameras, estimated</h2>")[2].partition("<h2>")[0]
    assert "<th>fused_&lt;legs&gt;</th>" in section
    cells = re.findall(r"<td>([^<]*&plusmn;[^<]*)</td>", section)
    assert cells == ["1.00 &plusmn; 0.50", "-2.00 &plusmn; 0.10", "0.00 &plusmn; 3.00", "1.20 &plusmn; 0.15"]
    plain = write_report(tmp_path / "plain.html", "x", evaluations).read_text(encoding="utf-8")
    assert "Calibration of the cameras, estimated" not in plain


def test_a_missing_figure_is_an_error(evaluations, tmp_path):
    with pytest.raises(EvaluationError, match=r"gone\.png"):
        write_report(tmp_path / "report.html", "x", evaluations, [tmp_path / "gone.png"])
    with pytest.raises(EvaluationError, match="cannot write the report"):
        write_report(tmp_path / "no" / "report.html", "x", evaluations)
