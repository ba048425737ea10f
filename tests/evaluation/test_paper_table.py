# SPDX-License-Identifier: BSD-3-Clause
"""The paper's figures are those that the kinds of trajectories declare."""

from coclo_vio.evaluation.paper_table import is_in_paper, paper_table


def test_the_table_has_the_declared_figures_by_trial() -> None:
    assert paper_table() == {
        "flat": {"legs": 1.0, "vision": 2.0, "fused_legs": 1.5},
        "ramp": {"legs": 6.0, "vision": 22.0},
        "stairs": {"legs": 7.0},
    }


def test_trajectories_without_declared_figures_are_not_in_the_paper() -> None:
    assert is_in_paper(["naive", "fused_legs"])
    assert not is_in_paper(["naive", "fused_vision", "unregistered"])
