# SPDX-License-Identifier: BSD-3-Clause
"""Jobs with answers known by hand: medians, spreads, wins, policies, comparisons with the paper."""

import pytest
from short_walk import job_record, plan_of

from coclo_vio.experiments.table.summary import representative_seed, spread, summarise
from coclo_vio.experiments.table.table_record import ErrorRatio, JobRecord, Spread, WinCount
from coclo_vio.experiments.table.trial_results import Results

PLAN = plan_of(seeds=4, modes=("coclo", "vins", "combined"), policy_seeds=2)
COCLO, VINS = (2.0, 4.0, 1.0, 3.0), (3.0, 1.0, 5.0, 7.0)  # drift by seed, percent; RPE is a tenth of it
COMBINED = (1.0, 1.5, 0.5, 6.0)


def drift(value: float) -> dict[str, float | None]:
    return {"drift_percent": value, "rpe_1m_percent": value / 10, "yaw_drift_deg": -value}


@pytest.fixture
def jobs() -> list[JobRecord]:
    made = []
    for seed, (coclo, vins, both) in enumerate(zip(COCLO, VINS, COMBINED, strict=True), start=1):
        made.append(job_record("flat", seed, "coclo", {"coclo": drift(coclo)}))
        made.append(job_record("flat", seed, "vins", {"vins": drift(vins)}))
        made.append(job_record("flat", seed, "combined", {"combined_coclo": drift(both), "combined_vins": drift(both)}))
    return made


def test_medians_and_spreads_are_over_seeds() -> None:
    every, least = spread([3.0, 1.0, None, 2.0]), spread([3.0, 1.0], more_is_better=True)
    assert every is not None
    assert every.model_dump() == pytest.approx({"median": 2.0, "p10": 1.2, "p90": 2.8, "worst": 3.0})
    assert least is not None
    assert least.model_dump() == pytest.approx({"median": 2.0, "p10": 1.2, "p90": 2.8, "worst": 1.0})
    assert spread([None]) is None


def median(figure: Spread | None) -> float:
    assert figure is not None
    return figure.median


def test_each_trajectory_has_its_figures_against_both_references(jobs: list[JobRecord]) -> None:
    flat = summarise(PLAN, jobs).trials["flat"]
    assert list(flat) == ["coclo", "vins", "combined_coclo", "combined_vins"]
    coclo = flat["coclo"]
    assert median(coclo.vicon.drift_percent) == pytest.approx(2.5)
    assert median(coclo.truth.drift_percent) == pytest.approx(1.25)
    assert coclo.vicon.yaw_drift_deg is not None
    assert coclo.vicon.yaw_drift_deg.worst == 4.0, "yaw counts by its size"
    assert (coclo.n, coclo.failures, median(coclo.realtime_factor)) == (4, 0, 3.0)


def test_a_win_is_a_smaller_error_of_the_same_trial_and_seed(jobs: list[JobRecord]) -> None:
    wins = summarise(PLAN, jobs).wins
    assert wins["combined_coclo"]["vicon"]["flat"].drift == WinCount(wins=3, of=4, share=0.75)
    assert wins["combined_vins"]["vicon"]["all"].rpe == WinCount(wins=3, of=4, share=0.75)


def test_a_failed_trajectory_has_no_figures_and_loses(jobs: list[JobRecord]) -> None:
    lost = {"combined_coclo": "no image", "combined_vins": "no image"}
    jobs[0] = job_record("flat", 1, "coclo", {"coclo": "it fell"})  # combined wins against it
    jobs[11] = job_record("flat", 4, "combined", lost)  # and loses here
    jobs[9] = job_record("flat", 4, "coclo", {"coclo": "it fell"})  # where both fail nobody wins
    summary = summarise(PLAN, jobs)
    coclo = summary.trials["flat"]["coclo"]
    assert (coclo.n, coclo.failures, median(coclo.vicon.drift_percent)) == (4, 2, 2.5)
    assert summary.wins["combined_coclo"]["vicon"]["flat"].drift.wins == 3
    assert summary.wins["combined_vins"]["vicon"]["flat"].drift.wins == 2


def test_combined_is_compared_with_the_better_of_the_two(jobs: list[JobRecord]) -> None:
    """Quotients 1/2, 1.5/1, 0.5/1, 6/3."""
    against = summarise(PLAN, jobs).against_the_better["combined_vins"]["flat"]["vicon"]
    assert against.drift == ErrorRatio(median_ratio=1.0, holds=True)
    for index in (2, 8):
        jobs[index] = job_record(
            "flat", 1 + index // 3, "combined", {name: drift(9.0) for name in ("combined_coclo", "combined_vins")}
        )
    worse = summarise(PLAN, jobs).against_the_better["combined_vins"]["flat"]["vicon"].drift
    assert worse == ErrorRatio(median_ratio=3.25, holds=False)


def test_policies_are_compared_on_the_seeds_that_all_have(jobs: list[JobRecord]) -> None:
    for seed, policies in ((1, ("off", "paper", "ci")), (2, ("off", "paper"))):
        for policy in policies:
            jobs.append(
                job_record(
                    "flat",
                    seed,
                    f"combined:{policy}",
                    {name: {"drift_percent": 8.0, "anees_pose": 6.0} for name in ("combined_coclo", "combined_vins")},
                )
            )
    summary = summarise(PLAN, jobs)
    by_policy = summary.policies["flat"]
    assert list(by_policy) == ["off", "paper", "ci", "decorrelated"]
    assert {by_name["combined_coclo"].n for by_name in by_policy.values()} == {1}
    assert median(by_policy["decorrelated"]["combined_coclo"].vicon.drift_percent) == 1.0
    assert median(by_policy["paper"]["combined_vins"].truth.anees_pose) == 3.0
    assert summary.trials["flat"]["combined_coclo"].n == 4, "policies are not among the seeds of combined"


def swapped(job: JobRecord) -> JobRecord:
    """The job with the results of coclo and vins exchanged."""
    names = {"vins": "coclo", "coclo": "vins"}
    return job.model_copy(
        update={"estimators": {names.get(name, name): result for name, result in job.estimators.items()}}
    )


def test_comparisons_with_the_paper_are_of_the_medians(jobs: list[JobRecord]) -> None:
    found = {(each.first, each.second): each for each in summarise(PLAN, jobs).against_the_paper}
    assert list(found) == [("coclo", "vins"), ("combined_coclo", "coclo"), ("combined_vins", "vins")]
    first = found["coclo", "vins"]
    assert (first.better.drift, first.better.rpe, first.paper) == (True, True, True)
    assert first.sentence == (
        "flat: COCLO against VINS: drift 2.50 against 4.00 %, RPE 0.25 against 0.40 %: drifts less, is better over a "
        "metre (the paper: better, 1.01 against 1.65 %)"
    )
    assert found["combined_coclo", "coclo"].paper is False, "on flat ground the paper's combined COCLO was worse"
    other = summarise(PLAN, [swapped(job) for job in jobs]).against_the_paper[0]
    assert (other.first, other.second) == ("coclo", "vins")
    assert "does not drift less, is not better over a metre" in other.sentence


def test_the_paper_has_no_figure_of_combined_on_the_ramp(jobs: list[JobRecord]) -> None:
    found = summarise(PLAN, [job.model_copy(update={"trial": "ramp"}) for job in jobs]).against_the_paper
    assert [each.paper for each in found] == [True, None, None]
    assert "(the paper has no figure)" in found[1].sentence


def test_the_representative_seed_is_that_of_the_median_combined_drift(jobs: list[JobRecord]) -> None:
    """0.5, 1, 1.5, 6: the lower of the two in the middle is seed 1."""
    assert representative_seed(Results.of(jobs), "flat") == 1
    alone = [job for job in jobs if job.variant == "coclo"]
    assert representative_seed(Results.of(alone), "flat") == 1, "1, 2, 3, 4: 2 is that of seed 1"
    assert representative_seed(Results.of([job_record("flat", 1, "coclo", {"coclo": "it fell"})]), "flat") is None


def test_a_table_of_one_standalone_mode_has_neither_wins_nor_policies(jobs: list[JobRecord]) -> None:
    summary = summarise(plan_of(modes=("coclo",)), [job for job in jobs if job.variant == "coclo"])
    assert (summary.wins, summary.against_the_better, summary.policies) == ({}, {}, {})
    assert summary.against_the_paper == ()
