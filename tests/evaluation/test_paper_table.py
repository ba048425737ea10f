# SPDX-License-Identifier: BSD-3-Clause
"""The paper's Table I, copied once."""

from coclo_vio.evaluation.paper_table import PAPER_TABLE_I


def test_the_papers_legs_beat_its_eyes_on_every_trial_as_its_text_says() -> None:
    assert set(PAPER_TABLE_I) == {"flat", "ramp", "stairs"}
    assert all(drifts["coclo"] < drifts["vins"] for drifts in PAPER_TABLE_I.values())


def test_the_paper_combined_both_on_flat_ground_and_stairs_only() -> None:
    assert PAPER_TABLE_I["stairs"] == {"coclo": 7.28, "vins": 8.55, "combined_coclo": 2.61, "combined_vins": 5.28}
    assert "combined_coclo" in PAPER_TABLE_I["flat"]
    assert "combined_coclo" not in PAPER_TABLE_I["ramp"]
