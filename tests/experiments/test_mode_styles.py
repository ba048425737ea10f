# SPDX-License-Identifier: BSD-3-Clause
"""The modes' trajectories are distinguishable in figures, and the paper's figures are those of its Table I."""

from coclo_vio.evaluation.figure_style import style_of
from coclo_vio.evaluation.paper_table import paper_table
from coclo_vio.evaluation.trajectory_roles import featured, fused_pairs, is_fused, standalone_names
from coclo_vio.runs.modes.registry import modes

NAMES = [name for mode in modes().values() for name in mode.trajectory_names]


def test_no_two_trajectories_look_the_same() -> None:
    looks = {(style_of(name)["color"], style_of(name)["linestyle"]) for name in NAMES}
    assert len(looks) == len(NAMES)


def test_fused_trajectories_are_drawn_on_top_of_all_others() -> None:
    standalone = max(style_of(name)["zorder"] for name in NAMES if not is_fused(name))
    assert min(style_of(name)["zorder"] for name in NAMES if is_fused(name)) > standalone


def test_the_papers_figures_are_those_of_its_table() -> None:
    assert paper_table() == {
        "flat": {"coclo": 1.01, "vins": 1.65, "combined_coclo": 1.57, "combined_vins": 1.46},
        "ramp": {"coclo": 6.51, "vins": 22.04},
        "stairs": {"coclo": 7.28, "vins": 8.55, "combined_coclo": 2.61, "combined_vins": 5.28},
    }
    pairs = [("combined_coclo", "coclo"), ("combined_vins", "vins"), ("tight", "coclo"), ("tight_vins", "vins")]
    assert fused_pairs(NAMES) == pairs
    assert standalone_names() == ["coclo", "vins"]


def test_columns_and_rows_are_in_the_order_of_the_papers_table() -> None:
    assert list(paper_table()) == ["flat", "ramp", "stairs"]
    assert featured(reversed(NAMES)) == ["coclo", "vins", "combined_coclo", "combined_vins"]
