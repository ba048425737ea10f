# SPDX-License-Identifier: BSD-3-Clause
"""Rows with answers known by hand: medians, spreads, wins, policies, claims."""

from typing import Any

import pytest
from short_walk import plan_of, row

from coclo_vio.experiments.table.summary import representative_seed, spread, summarise
from coclo_vio.experiments.table.trial_results import Results

PLAN = plan_of(seeds=4, modes=("coclo", "vins", "combined"), policy_seeds=2)
COCLO, VINS = (2.0, 4.0, 1.0, 3.0), (3.0, 1.0, 5.0, 7.0)  # drift by seed, percent; RPE is a tenth of it
COMBINED = (1.0, 1.5, 0.5, 6.0)


def drift(value: float) -> dict[str, float | None]:
    return {"drift_percent": value, "rpe_1m_percent": value / 10, "yaw_drift_deg": -value}


@pytest.fixture
def rows() -> list[dict[str, Any]]:
    made = []
    for seed, (coclo, vins, both) in enumerate(zip(COCLO, VINS, COMBINED, strict=True), start=1):
        made.append(row("flat", seed, "coclo", {"coclo": drift(coclo)}))
        made.append(row("flat", seed, "vins", {"vins": drift(vins)}))
        made.append(row("flat", seed, "combined", {"combined_coclo": drift(both), "combined_vins": drift(both)}))
    return made


def test_medians_and_spreads_are_over_seeds() -> None:
    assert spread([3.0, 1.0, None, 2.0]) == pytest.approx({"median": 2.0, "p10": 1.2, "p90": 2.8, "worst": 3.0})
    assert spread([3.0, 1.0], more_is_better=True) == pytest.approx({"median": 2.0, "p10": 1.2, "p90": 2.8, "worst": 1})
    assert spread([None]) is None


def test_each_estimator_has_its_figures_against_both_references(rows: list[dict[str, Any]]) -> None:
    told = summarise(PLAN, rows)["trials"]["flat"]
    assert list(told) == ["coclo", "vins", "combined_coclo", "combined_vins"]
    assert told["coclo"]["vicon"]["drift_percent"]["median"] == pytest.approx(2.5)
    assert told["coclo"]["truth"]["drift_percent"]["median"] == pytest.approx(1.25)
    assert told["coclo"]["vicon"]["yaw_drift_deg"]["worst"] == 4.0, "yaw counts by its size"
    assert (told["coclo"]["n"], told["coclo"]["failures"], told["coclo"]["realtime_factor"]["median"]) == (4, 0, 3.0)


def test_a_win_is_a_smaller_error_of_the_same_trial_and_seed(rows: list[dict[str, Any]]) -> None:
    wins = summarise(PLAN, rows)["wins"]
    assert wins["combined_coclo"]["vicon"]["flat"]["drift"] == {"wins": 3, "of": 4, "share": 0.75}
    assert wins["combined_vins"]["vicon"]["all"]["rpe"] == {"wins": 3, "of": 4, "share": 0.75}


def test_who_failed_has_no_figures_and_loses(rows: list[dict[str, Any]]) -> None:
    rows[0] = row("flat", 1, "coclo", {"coclo": "it fell"})  # combined wins against it
    rows[11] = row("flat", 4, "combined", {"combined_coclo": "no sight", "combined_vins": "no sight"})  # and loses here
    rows[9] = row("flat", 4, "coclo", {"coclo": "it fell"})  # where both fail nobody wins
    told = summarise(PLAN, rows)
    coclo = told["trials"]["flat"]["coclo"]
    assert (coclo["n"], coclo["failures"], coclo["vicon"]["drift_percent"]["median"]) == (4, 2, 2.5)
    assert told["wins"]["combined_coclo"]["vicon"]["flat"]["drift"]["wins"] == 3
    assert told["wins"]["combined_vins"]["vicon"]["flat"]["drift"]["wins"] == 2


def test_combined_is_held_against_the_better_of_the_two(rows: list[dict[str, Any]]) -> None:
    """Quotients 1/2, 1.5/1, 0.5/1, 6/3."""
    against = summarise(PLAN, rows)["against_the_better"]["combined_vins"]["flat"]["vicon"]
    assert against["drift"] == {"median_ratio": pytest.approx(1.0), "holds": True}
    for index in (2, 8):
        rows[index] = row(
            "flat", 1 + index // 3, "combined", {name: drift(9.0) for name in ("combined_coclo", "combined_vins")}
        )
    worse = summarise(PLAN, rows)["against_the_better"]["combined_vins"]["flat"]["vicon"]["drift"]
    assert worse == {"median_ratio": pytest.approx(3.25), "holds": False}


def test_policies_are_compared_on_the_seeds_that_all_have(rows: list[dict[str, Any]]) -> None:
    for seed, policies in ((1, ("off", "paper", "ci")), (2, ("off", "paper"))):
        for policy in policies:
            rows.append(
                row(
                    "flat",
                    seed,
                    f"combined:{policy}",
                    {name: {"drift_percent": 8.0, "anees_pose": 6.0} for name in ("combined_coclo", "combined_vins")},
                )
            )
    told = summarise(PLAN, rows)
    policies = told["policies"]["flat"]
    assert list(policies) == ["off", "paper", "ci", "decorrelated"]
    assert {one["combined_coclo"]["n"] for one in policies.values()} == {1}
    assert policies["decorrelated"]["combined_coclo"]["vicon"]["drift_percent"]["median"] == 1.0
    assert policies["paper"]["combined_vins"]["truth"]["anees_pose"]["median"] == 3.0
    assert told["trials"]["flat"]["combined_coclo"]["n"] == 4, "policies are not among the seeds of combined"


def test_claims_are_computed_from_the_medians(rows: list[dict[str, Any]]) -> None:
    claims = {(one["first"], one["second"]): one for one in summarise(PLAN, rows)["claims"]}
    first = claims["coclo", "vins"]
    assert (first["better"], first["paper"]) == ({"drift": True, "rpe": True}, True)
    assert first["sentence"] == (
        "flat: COCLO against VINS: drift 2.50 against 4.00 %, RPE 0.25 against 0.40 %: drifts less, is better over a "
        "metre (the paper: better, 1.01 against 1.65 %)"
    )
    assert claims["combined_coclo", "coclo"]["paper"] is False, "on flat ground the paper's combined COCLO was worse"
    swapped = [
        {
            **one,
            "estimators": {
                "vins" if name == "coclo" else "coclo" if name == "vins" else name: told
                for name, told in one["estimators"].items()
            },
        }
        for one in rows
    ]
    (other,) = (
        one for one in summarise(PLAN, swapped)["claims"] if one["second"] == "vins" and one["first"] == "coclo"
    )
    assert "does not drift less, is not better over a metre" in other["sentence"]


def test_the_paper_says_nothing_of_combined_on_the_ramp(rows: list[dict[str, Any]]) -> None:
    claims = summarise(PLAN, [{**one, "trial": "ramp"} for one in rows])["claims"]
    assert [one["paper"] for one in claims] == [True, None, None]
    assert "(the paper does not say)" in claims[1]["sentence"]


def test_the_middle_seed_is_that_of_the_combined_drift(rows: list[dict[str, Any]]) -> None:
    """0.5, 1, 1.5, 6: the lower of the two in the middle is seed 1."""
    assert representative_seed(Results.of(rows), "flat") == 1
    alone = [one for one in rows if one["variant"] == "coclo"]
    assert representative_seed(Results.of(alone), "flat") == 1, "1, 2, 3, 4: 2 is that of seed 1"
    assert representative_seed(Results.of([row("flat", 1, "coclo", {"coclo": "it fell"})]), "flat") is None


def test_a_table_of_the_legs_alone_has_neither_wins_nor_policies(rows: list[dict[str, Any]]) -> None:
    told = summarise(plan_of(modes=("coclo",)), [one for one in rows if one["variant"] == "coclo"])
    assert (told["wins"], told["against_the_better"], told["policies"], told["claims"]) == ({}, {}, {}, [])
