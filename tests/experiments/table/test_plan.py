# SPDX-License-Identifier: BSD-3-Clause
"""The jobs of a table, their order, and what makes two results different."""

import pickle
import shutil
from pathlib import Path

import pytest
from short_walk import plan_of

from coclo_vio.experiments.table.plan import Job, TablePlan, Variant, checked_modes, checked_trials, default_modes
from coclo_vio.runs.run_config import resolve
from coclo_vio.values.errors import ConfigError


def test_the_jobs_of_a_recording_follow_each_other_and_all_trials_of_a_seed() -> None:
    plan = plan_of(seeds=2, trials=("flat", "ramp"), modes=("coclo", "vins"))
    assert [job.name for job in plan.jobs()] == [
        *("flat_1_coclo", "flat_1_vins", "ramp_1_coclo", "ramp_1_vins"),
        *("flat_2_coclo", "flat_2_vins", "ramp_2_coclo", "ramp_2_vins"),
    ]


def test_the_policies_are_run_for_the_first_seeds_and_the_configured_one_only_once() -> None:
    plan = plan_of(seeds=2, modes=("combined",), policy_seeds=1)
    names = [job.variant.name for job in plan.jobs()]
    assert names == ["combined", "combined:off", "combined:paper", "combined:ci", "combined"]
    assert [plan.policy_of(one) for one in plan.policies] == ["off", "paper", "ci", "decorrelated"]
    other = plan_of(config=resolve("daisy", settings=["bridge.feedback=ci"]), modes=("combined",), policy_seeds=1)
    assert [one.name for one in other.policies] == [
        "combined:off",
        "combined:paper",
        "combined",
        "combined:decorrelated",
    ]


@pytest.mark.parametrize("changes", [{"modes": ("coclo", "vins"), "policy_seeds": 3}, {"modes": ("combined",)}])
def test_without_a_combined_mode_or_seeds_for_it_there_are_no_policies(changes: dict[str, object]) -> None:
    plan = plan_of(**changes)
    assert plan.policies == ()
    assert {job.variant for job in plan.jobs()} == set(plan.variants)


def test_a_variant_runs_with_its_own_policy_and_all_else_as_it_is_configured() -> None:
    config = resolve("daisy", settings=["bridge.vision_latency_s=0.3"])
    changed = Variant("combined", "paper").configured(config)
    assert (changed.bridge.feedback, changed.bridge.vision_latency_s) == ("paper", 0.3)
    assert Variant("combined").configured(config) is config
    assert Variant("combined", "paper").trajectories == ("combined_coclo", "combined_vins")
    assert ":" not in Job("flat", 3, Variant("combined", "paper")).name


def test_a_result_is_another_one_with_another_setting_robot_trial_seed_or_policy() -> None:
    plan, job = plan_of(), Job("flat", 1, Variant("combined"))
    others = [
        plan_of(config=resolve("daisy", settings=["filter.profile=paper"])).fingerprint(job),
        plan_of(ideal=True).fingerprint(job),
        plan_of(simulation={"trial": {"stand_s": 1.5}}).fingerprint(job),
        plan.fingerprint(Job("ramp", 1, job.variant)),
        plan.fingerprint(Job("flat", 2, job.variant)),
        plan.fingerprint(Job("flat", 1, Variant("combined", "ci"))),
    ]
    assert plan.fingerprint(job) not in others
    assert plan_of(seeds=5, modes=("vins",)).fingerprint(job) == plan.fingerprint(job), (
        "the number of seeds does not matter"
    )


def test_a_plan_can_be_sent_to_another_process() -> None:
    plan = plan_of()
    sent: TablePlan = pickle.loads(pickle.dumps(plan))
    assert sent == plan


def test_an_ideal_robot_is_as_described() -> None:
    imperfection = plan_of(ideal=True).simulation_of("ramp").trial.imperfection
    assert set(imperfection.model_dump().values()) == {0.0}
    assert plan_of().simulation_of("ramp").camera.encoding == "jpeg"


@pytest.mark.parametrize("names", [[], ["hill"], ["flat", "hill"]])
def test_an_unknown_trial_is_refused_with_the_choices(names: list[str]) -> None:
    with pytest.raises(ConfigError, match="flat, ramp, stairs"):
        checked_trials(names)
    assert checked_trials(["stairs", "flat", "flat"]) == ("flat", "stairs")


def test_the_default_modes_are_those_of_the_papers_table() -> None:
    assert default_modes() == ("coclo", "vins", "combined")
    assert TablePlan(seeds=1).modes == default_modes()


def test_an_unknown_mode_is_refused() -> None:
    with pytest.raises(ConfigError, match="names no mode"):
        checked_modes([])
    with pytest.raises(ConfigError, match="there is no mode 'cocla'"):
        checked_modes(["coclo", "cocla"])
    assert checked_modes(["vins", "coclo", "vins"]) == ("vins", "coclo")


def test_the_content_of_a_urdf_matters_and_not_its_path(tmp_path: Path) -> None:
    plan = plan_of()
    job = next(plan.jobs())
    robot = plan.config.robot
    assert robot is not None
    moved = Path(shutil.copy(robot.urdf, tmp_path / "moved.urdf"))
    elsewhere = plan.config.model_copy(update={"robot": robot.model_copy(update={"urdf": str(moved)})})
    assert plan_of(config=elsewhere).fingerprint(job) == plan.fingerprint(job)
    moved.write_text(moved.read_text(encoding="utf-8") + "<!-- another -->", encoding="utf-8")
    assert plan_of(config=elsewhere).fingerprint(job) != plan.fingerprint(job)
