# SPDX-License-Identifier: BSD-3-Clause
"""Several recordings as the paper's Table I, and the page over them."""

import numpy as np
import pytest

from coclo_vio.evaluation.evaluate import evaluate
from coclo_vio.evaluation.html_index import Entry, write_index
from coclo_vio.evaluation.table_one import Cell, TableOne
from coclo_vio.values.errors import EvaluationError
from coclo_vio.values.trajectory import GroundTruth


@pytest.fixture
def evaluation(walk):
    truth = walk(np.arange(0.0, 25.0, 0.02))
    return evaluate(walk(np.arange(0.0, 25.0, 0.02), 1), GroundTruth(truth, True, "vicon"))


def test_rows_are_recordings_and_columns_the_featured_trajectories(evaluation):
    table = TableOne.of({"a": {"vision": evaluation, "naive": evaluation}, "b": {"legs": evaluation}})
    assert table.columns == ("legs", "vision")
    assert table.headers == ("Legs", "Vision")
    own = f"{evaluation.drift_percent:.2f} / {evaluation.rpe_1m_percent:.2f}"
    assert [[str(cell) for cell in row.cells] for row in table.rows[:2]] == [["-", own], [own, "-"]]
    paper = {row.name: [str(cell) for cell in row.cells] for row in table.rows if row.is_paper}
    assert paper == {"flat": ["1.00", "2.00"], "ramp": ["6.00", "22.00"], "stairs": ["7.00", "-"]}


def test_without_a_trajectory_of_the_paper_there_is_no_row_of_its(evaluation):
    table = TableOne.of({"a": {"naive": evaluation, "unregistered": evaluation}})
    assert table.columns == ("naive", "unregistered")
    assert [row.is_paper for row in table.rows] == [False]


def test_a_cell_without_a_metre_of_path_has_a_drift_only():
    assert str(Cell(0.934)) == "0.93"
    assert str(Cell()) == "-"


def test_the_page_marks_the_papers_figures_and_leads_to_each_recording(evaluation, tmp_path):
    table = TableOne.of({"a & b": {"legs": evaluation}})
    entries = {"a & b": Entry("a & b/report.html", ["It went well."])}
    text = write_index(tmp_path / "report.html", "Two", table, entries).read_text(encoding="utf-8")
    assert "flat (paper, another robot&#x27;s data)" in text
    assert '<a href="a%20%26%20b/report.html">a &amp; b</a>' in text
    assert "It went well." in text
    with pytest.raises(EvaluationError, match="cannot write the report"):
        write_index(tmp_path / "no" / "report.html", "Two", table, entries)
