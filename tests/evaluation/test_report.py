# SPDX-License-Identifier: BSD-3-Clause
"""The report is one file that asks nothing of the network and hides no note."""

import base64
import re

import numpy as np
import pytest

from coclo_vio.errors import EvaluationError
from coclo_vio.evaluation.evaluate import evaluate
from coclo_vio.evaluation.report import write_report
from coclo_vio.trajectory import GroundTruth


@pytest.fixture
def evaluations(walk):
    truth = walk(np.arange(0.0, 25.0, 0.02))
    numbered = GroundTruth(truth.restamped(np.arange(len(truth)) * 7_000_000), False, "mocap.csv")
    return {"coclo": evaluate(truth, numbered), "<b>": evaluate(truth, GroundTruth(truth, True, "vicon"))}


def test_report_holds_numbers_notes_figures_and_configuration(evaluations, tmp_path):
    image = b"\x89PNG pretended"
    (tmp_path / "path.png").write_bytes(image)
    report = write_report(
        tmp_path / "report.html",
        "Flat & square",
        evaluations,
        [tmp_path / "path.png"],
        {"filter": {"profile": "robust"}},
    )
    text = report.read_text(encoding="utf-8")
    assert "<title>Flat &amp; square</title>" in text
    assert "<th>coclo</th><th>&lt;b&gt;</th>" in text
    assert f"<td>{evaluations['coclo'].path_length_m:.2f}</td>" in text
    assert re.search(r"The ground truth has no time stamps: its rate, (49\.9|50\.0)\d+ Hz", text)
    assert "profile: robust" in text
    assert "<td>&ndash;</td>" in text
    assert base64.b64encode(image).decode() in text
    assert not re.search(r"(?:src|href)\s*=\s*[\"'](?!data:)", text)
    assert "http" not in text


def test_a_figure_that_is_not_there_is_an_error(evaluations, tmp_path):
    with pytest.raises(EvaluationError, match=r"gone\.png"):
        write_report(tmp_path / "report.html", "x", evaluations, [tmp_path / "gone.png"])
    with pytest.raises(EvaluationError, match="cannot write the report"):
        write_report(tmp_path / "no" / "report.html", "x", evaluations)
