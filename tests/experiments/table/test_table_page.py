# SPDX-License-Identifier: BSD-3-Clause
"""The table as it is read: our figures beside the paper's, the same in every form."""

from pathlib import Path
from typing import Any

import pytest
from short_walk import plan_of, row

from coclo_vio.experiments.table.text_tables import grids
from coclo_vio.experiments.table.summary import summarise
from coclo_vio.experiments.table.table_page import failures, html, markdown

PLAN = plan_of(seeds=2, modes=("coclo", "vins", "combined"), policy_seeds=1)


@pytest.fixture
def table() -> dict[str, Any]:
    both = {"combined_coclo": {"drift_percent": 0.5}, "combined_vins": {"drift_percent": 0.25, "anees_pose": 3.0}}
    rows = [row("flat", seed, name, {name: {"drift_percent": 2.0}}) for seed in (1, 2) for name in ("coclo", "vins")]
    rows += [row("flat", seed, "combined", both) for seed in (1, 2)]
    rows += [row("flat", 1, f"combined:{policy}", both) for policy in ("off", "paper", "ci")]
    rows[1] = row("flat", 1, "vins", {"vins": "lost <itself> | in the dark"})
    return {"command": "coclo-vio table --seeds 2", "summary": summarise(PLAN, rows), "jobs": rows}


def test_the_first_table_is_the_papers_with_the_papers_own_figures(table: dict[str, Any]) -> None:
    first = grids(table["summary"])[0]
    assert first.head == ("", "COCLO", "VINS", "combined COCLO", "combined VINS")
    assert first.rows == (
        ("flat, 2 seeds", "2.00 / 1.00", "2.00 / 1.00 (1 failed)", "0.50 / 1.00", "0.25 / 1.00"),
        ("flat, drift as the paper's", "1.00", "1.00", "1.00", "1.00"),
        ("flat, paper, another robot's data", "1.01", "1.65", "1.57", "1.46"),
    )


def test_all_grids_are_as_wide_as_their_heads(table: dict[str, Any]) -> None:
    made = grids(table["summary"])
    assert len(made) == 5
    for grid in made:
        assert {len(cells) for cells in grid.rows} == {len(grid.head)}, grid.title


def test_consistency_is_against_the_truth(table: dict[str, Any]) -> None:
    policies = next(grid for grid in grids(table["summary"]) if grid.title.startswith("What is fed back"))
    assert [cells[0] for cells in policies.rows] == ["flat, off", "flat, paper", "flat, ci", "flat, decorrelated"]
    assert policies.rows[0][1:] == ("1", "0.50 / 1.00", "0.50", "0.25 / 1.00", "1.50")


def test_markdown_and_html_say_the_same(table: dict[str, Any]) -> None:
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


def test_failures_are_listed_and_escaped(table: dict[str, Any]) -> None:
    assert failures(table) == ["flat 1 vins, vins: lost <itself> | in the dark"]
    assert "<itself>" not in html(table)
    assert "lost &lt;itself&gt;" in html(table)


def test_the_page_holds_its_figures(table: dict[str, Any], tmp_path: Path) -> None:
    picture = tmp_path / "flat_1_path.png"
    picture.write_bytes(b"\x89PNG")
    page = html(table, [picture])
    assert 'alt="flat 1 path" src="data:image/png;base64,iVBORw=="' in page
    assert "http" not in page
