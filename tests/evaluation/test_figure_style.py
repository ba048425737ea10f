# SPDX-License-Identifier: BSD-3-Clause
"""A trajectory is drawn as its kind declares, in every figure."""

from coclo_vio.evaluation.figure_style import style_of


def test_a_line_is_drawn_as_its_kind_declares() -> None:
    assert style_of("naive") == {
        "color": style_of("naive")["color"],
        "linewidth": 1.2,
        "linestyle": "--",
        "zorder": 2,
        "label": "naive",
    }
    assert (style_of("fused_legs")["color"], style_of("fused_legs")["zorder"]) == ("#00a000", 6)


def test_an_unregistered_name_has_a_style_of_its_own() -> None:
    assert style_of("mine") == style_of("mine")
    assert style_of("mine")["label"] == "mine"
