# SPDX-License-Identifier: BSD-3-Clause
"""The grid: what its cells are, that it goes on where it was stopped, and its summary with answers known by hand."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from coclo_vio.evaluation.evaluation_record import EvaluationRecord, GapsRecord
from coclo_vio.experiments.grid.__main__ import main
from coclo_vio.experiments.grid.cells import CELLS, Cell, chosen_cells
from coclo_vio.experiments.grid.grid_plan import GridPlan
from coclo_vio.experiments.grid.grid_summary import cell_summary, shares
from coclo_vio.experiments.resumable_jobs import commit_of_code
from coclo_vio.experiments.table.build import run_work
from coclo_vio.experiments.table.table_record import Fingerprint, JobRecord, JobTrajectory
from coclo_vio.runs.modes.registry import modes
from coclo_vio.simulation.conditions import CONDITIONS
from coclo_vio.simulation.simulated_recording import simulation_config
from coclo_vio.simulation.trial.physics import Simulator
from coclo_vio.values.errors import ConfigError

SLIPPERY = Cell("good", "slippery", ("legs_exact", "legs_slippery"))
ENCODER = Cell("good", "encoder", ("legs_exact", "encoder_off"))
EXACT = Cell("good", "exact", ("legs_exact",))


def plan_in(folder: Path, commit: str = "abc1234", *cells: Cell) -> GridPlan:
    """One flat trial of 1.6 s without images."""
    return GridPlan(folder, commit, cells or (EXACT, ENCODER), trials=("flat",), modes=("naive",), until_s=1.6)


def test_policies_are_run_unless_left_out(tmp_path: Path) -> None:
    everything = GridPlan(tmp_path, "abc1234", (EXACT,), trials=("flat",), modes=("combined",))
    alone = replace(everything, has_policies=False)
    assert len(list(everything.table(EXACT).jobs())) > 1
    assert [job.variant.feedback for job in alone.table(EXACT).jobs()] == [None]


def test_every_condition_is_in_both_groups_by_itself_and_the_names_are_unique() -> None:
    assert 55 <= len(CELLS) <= 65
    assert len({cell.name for cell in CELLS}) == len(CELLS)
    for group in ("good", "field"):
        cells = [cell for cell in CELLS if cell.group == group]
        base = set(cells[0].conditions)
        apart = [set(cell.conditions) ^ base for cell in cells[1:]]
        assert {name for each in apart if len(each) == 1 for name in each} == set(CONDITIONS)
    for cell in CELLS:
        assert simulation_config("ramp", cell.changes)


def test_cells_are_chosen_by_name_or_by_group() -> None:
    assert chosen_cells([]) == CELLS
    assert chosen_cells(["good"])[0].name == "good-base"
    assert {cell.group for cell in chosen_cells(["corners", "good-lamp"])} == {"corners", "good"}
    with pytest.raises(ConfigError, match="no cell 'fog'"):
        chosen_cells(["fog"])


def test_fused_modes_are_run_with_every_feedback_policy() -> None:
    table = GridPlan(Path("grid"), "abc1234").table(EXACT)
    variants = [job.variant.name for job in table.jobs() if job.trial == "ramp"]
    assert {"coclo", "vins", "combined", "combined:off", "combined:paper", "combined:ci"} <= set(variants)
    assert table.simulation_of("ramp").trial.frame_rate_hz == 7.5
    assert table.simulation_of("ramp").trial.imperfection.link_length == 0.0


@pytest.mark.long
def test_it_goes_on_where_it_was_stopped_and_shares_motions(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    walks = []
    walk = Simulator.walk
    monkeypatch.setattr(Simulator, "walk", lambda self, *a, **k: (walks.append(1), walk(self, *a, **k))[1])
    plan = plan_in(tmp_path)
    names = [unit.name for unit in plan.work()]
    assert names == ["exact/flat_1", "encoder/flat_1"]
    steps = []
    run_work(plan.work()[:1], 1, None, steps.append)
    assert [step.name for step in steps if step.kind == "done"] == ["exact/flat_1_naive"]
    assert [unit.name for unit in plan.work()] == ["encoder/flat_1"]
    record = tmp_path / "abc1234" / "exact" / "jobs" / "flat_1_naive.json"
    assert json.loads(record.read_text(encoding="utf-8"))["fingerprint"]["commit"] == "abc1234"
    run_work(plan.work(), 1, None, steps.append)
    assert plan.work() == []
    assert len(walks) == 1, "an encoder does not change the motion"
    assert len(list((tmp_path / "motions").iterdir())) == 1
    assert list((tmp_path / "recordings" / "exact").iterdir()) == []
    assert not any((tmp_path / "abc1234").rglob("*.tum"))


@pytest.mark.long
def test_another_commit_begins_anew_and_a_damaged_record_is_made_again(tmp_path: Path) -> None:
    run_work(plan_in(tmp_path, "abc1234", SLIPPERY).work(), 1, None, lambda step: None)
    assert [unit.name for unit in plan_in(tmp_path, "def5678", SLIPPERY).work()] == ["slippery/flat_1"]
    record = tmp_path / "abc1234" / "slippery" / "jobs" / "flat_1_naive.json"
    record.write_text(record.read_text(encoding="utf-8")[:50], encoding="utf-8")
    assert len(plan_in(tmp_path, "abc1234", SLIPPERY).work()) == 1


def record(trial: str, seed: int, variant: str, **errors: float | None) -> JobRecord:
    """A job whose trajectories have this drift, a tenth of it as RPE, and an ANEES of 1; None: it failed."""
    modes()
    fingerprint = Fingerprint(
        version="", configuration="", simulation="", ideal=False, trial=trial, seed=seed, variant=variant
    )
    estimators = {name: trajectory(error) for name, error in errors.items()}
    failure = next((each.failure for each in estimators.values() if each.failure), None)
    return JobRecord(
        fingerprint=fingerprint,
        trial=trial,
        seed=seed,
        variant=variant,
        cpu_s=60.0,
        failure=failure,
        estimators=estimators,
    )


def trajectory(error: float | None) -> JobTrajectory:
    values = dict.fromkeys(EvaluationRecord.model_fields, 1.0) | {
        "schema_version": 1,
        "paper_drift_at": "end",
        "velocity_source": "estimate",
        "alignment": "yaw_position",
        "clock_is_estimated": True,
        "notes": (),
        "gaps": GapsRecord(ground_truth_holes=0, estimate_holes=0, poses_outside=0, poses_in_holes=0),
    }
    figures = {} if error is None else {"drift_percent": error, "rpe_1m_percent": error / 10.0}
    truth = EvaluationRecord(**(values | figures))
    return JobTrajectory(
        vicon=None,
        truth=truth,
        realtime_factor=1.0,
        estimates=1,
        counts={},
        keyframes=None,
        events=(),
        failure="lost" if error is None else None,
    )


def cell_of(name: str, coclo: float, vins: float, combined: float | None, policy: float) -> list[JobRecord]:
    return [
        record("flat", 1, "coclo", coclo=coclo),
        record("flat", 1, "vins", vins=vins),
        record("flat", 1, "combined", combined_coclo=combined, combined_vins=combined),
        record("flat", 1, "combined:ci", combined_coclo=policy, combined_vins=policy),
    ]


def test_a_fused_trajectory_is_compared_with_the_better_half_cell_by_cell() -> None:
    records = cell_of("one", coclo=2.0, vins=1.0, combined=0.5, policy=1.2)
    records += [record("ramp", 1, "coclo", coclo=1.0), record("ramp", 1, "vins", vins=4.0)]
    records += [record("ramp", 1, "combined", combined_coclo=1.3, combined_vins=1.3)]
    one = cell_summary("good", "one", (), records)
    assert one.ratios["combined_coclo"].drift == pytest.approx((0.5 + 1.3) / 2.0)
    assert one.ratios["combined_coclo"].worst == pytest.approx(1.3)
    assert one.ratios["combined_coclo"].worst_trial == "ramp"
    assert one.ratios["combined_coclo:ci"].rpe == pytest.approx(1.2)
    assert one.trajectories["vins"].drift_percent == pytest.approx(2.5)
    assert set(one.ratios) == {f"combined_{half}{policy}" for half in ("coclo", "vins") for policy in ("", ":ci")}


def test_shares_count_cells_and_a_failure_is_worse_than_anything() -> None:
    every = [
        cell_summary("good", "better", (), cell_of("better", 2.0, 1.0, 0.5, 1.05)),
        cell_summary("good", "worse", (), cell_of("worse", 2.0, 1.0, 1.25, 3.0)),
        cell_summary("good", "failed", (), cell_of("failed", 2.0, 1.0, None, 1.0)),
    ]
    assert every[2].ratios["combined_coclo"].drift is None
    assert every[2].trajectories["combined_coclo"].failures == 1
    share = shares(every)["combined_coclo"]
    assert (share.cells, share.within_1_1, share.within_1_3, share.better) == (3, 0.3333, 0.6667, 0.3333)
    assert shares(every)["combined_coclo:ci"].within_1_1 == pytest.approx(0.6667)


@pytest.mark.long
def test_the_command_runs_and_sums_up(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    grid = [
        "-o",
        str(tmp_path),
        "--cells",
        "good-encoder_off",
        "--trials",
        "flat",
        "--modes",
        "naive",
        "--until",
        "1.6",
    ]
    main(["run", *grid, "--workers", "1"])
    assert "1 of 1: good-encoder_off/flat_1_naive" in capsys.readouterr().err
    main(["summary", *grid])
    assert "good-encoder_off" in capsys.readouterr().out
    summed_up = json.loads((tmp_path / commit_of_code() / "grid.json").read_text(encoding="utf-8"))
    assert [cell["name"] for cell in summed_up["cells"]] == ["good-encoder_off"]
    with pytest.raises(SystemExit, match="grid: no job of commit none is finished"):
        main(["summary", *grid, "--commit", "none"])
