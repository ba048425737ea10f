# SPDX-License-Identifier: BSD-3-Clause
"""An estimator looks the same in every figure, and unlike every other."""

from coclo_vio.evaluation.figure_style import COMBINED, style_of
from coclo_vio.runs.estimators import ESTIMATORS

NAMES = [*(name for name in ESTIMATORS if name != "combined"), *COMBINED]


def test_no_two_estimators_look_the_same() -> None:
    looks = {(style_of(name)["color"], style_of(name).get("linestyle", "-")) for name in NAMES}
    assert len(looks) == len(NAMES)


def test_combined_is_drawn_on_top_of_all_others() -> None:
    others = max(style_of(name)["zorder"] for name in NAMES if name not in COMBINED)
    assert min(style_of(name)["zorder"] for name in COMBINED) > others


def test_a_name_that_nobody_knows_keeps_its_looks_and_its_name() -> None:
    assert style_of("mine") == style_of("mine")
    assert style_of("mine")["label"] == "mine"
