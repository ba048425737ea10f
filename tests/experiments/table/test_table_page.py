# SPDX-License-Identifier: BSD-3-Clause
"""The pages of a table: our figures beside the paper's, the same in every format."""

from pathlib import Path

import pytest
from short_walk import job_record, plan_of

from coclo_vio.experiments.table.build import table_record
from coclo_vio.experiments.table.table_page import failures, html, markdown
from coclo_vio.experiments.table.table_record import TableRecord
from coclo_vio.experiments.table.text_tables import text_tables

PLAN = plan_of(seeds=2, modes=("coclo", "vins", "combined"), policy_seeds=1)


@pytest.fixture
def table() -> TableRecord:
    both = {"combined_coclo": {"drift_percent": 0.5}, "combined_vins": {"drift_percent": 0.25, "anees_pose": 3.0}}
    jobs = [
        job_record("flat", seed, name, {name: {"drift_percent": 2.0}}) for seed in (1, 2) for name in ("coclo", "vins")
    ]
    jobs += [job_record("flat", seed, "combined", both) for seed in (1, 2)]
    jobs += [job_record("flat", 1, f"combined:{policy}", both) for policy in ("off", "paper", "ci")]
    jobs[1] = job_record("flat", 1, "vins", {"vins": "lost <itself> | in the dark"})
    return table_record(PLAN, jobs, "coclo-vio table --seeds 2", {})


def test_the_first_table_is_the_papers_with_the_papers_own_figures(table: TableRecord) -> None:
    first = text_tables(table.summary)[0]
    assert first.head == ("", "COCLO", "VINS", "combined COCLO", "combined VINS")
    assert first.rows == (
        ("flat, 2 seeds", "2.00 / 1.00", "2.00 / 1.00 (1 failed)", "0.50 / 1.00", "0.25 / 1.00"),
        ("flat, drift as the paper's", "1.00", "1.00", "1.00", "1.00"),
        ("flat, paper, another robot's data", "1.01", "1.65", "1.57", "1.46"),
    )


def test_all_rows_are_as_wide_as_their_heads(table: TableRecord) -> None:
    made = text_tables(table.summary)
    assert len(made) == 5
    for text in made:
        assert {len(cells) for cells in text.rows} == {len(text.head)}, text.title


def test_consistency_is_against_the_truth(table: TableRecord) -> None:
    policies = next(text for text in text_tables(table.summary) if text.title.startswith("Feedback"))
    assert [cells[0] for cells in policies.rows] == ["flat, off", "flat, paper", "flat, ci", "flat, decorrelated"]
    assert policies.rows[0][1:] == ("1", "0.50 / 1.00", "0.50", "0.25 / 1.00", "1.50")


def test_markdown_and_html_hold_the_same(table: TableRecord) -> None:
    text, page = markdown(table), html(table)
    for cell in (
        "2.00 / 1.00 (1 failed)",
        "combined COCLO over COCLO, drift",
        "2/2, 100 %",
        "coclo-vio table --seeds 2",
    ):
        assert cell in text
        assert cell in page
    widths = [line.count("|") for line in text.splitlines() if line.startswith("| flat, ")]
    assert set(widths[:3]) == {6}


def test_failures_are_listed_and_escaped(table: TableRecord) -> None:
    assert failures(table) == ["flat 1 vins, vins: lost <itself> | in the dark"]
    assert "<itself>" not in html(table)
    assert "lost &lt;itself&gt;" in html(table)


def test_the_page_holds_its_figures(table: TableRecord, tmp_path: Path) -> None:
    picture = tmp_path / "flat_1_path.png"
    picture.write_bytes(b"\x89PNG")
    page = html(table, [picture])
    assert 'alt="flat 1 path" src="data:image/png;base64,iVBORw=="' in page
    assert "http" not in page
