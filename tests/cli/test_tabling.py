# SPDX-License-Identifier: BSD-3-Clause
"""The command ``table``: its plan, output and files, and how it is stopped. The jobs themselves are made up here."""

import json
import os
import shlex
import signal
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest
from console import Coclo, is_one_sentence
from typer.testing import CliRunner

from coclo_vio import cli
from coclo_vio.evaluation.evaluation_record import EvaluationRecord, GapsRecord
from coclo_vio.experiments.table import build, recordings
from coclo_vio.experiments.table.job import failed
from coclo_vio.experiments.table.work_unit import ProgressCallback, WorkProgress, WorkUnit

SMALL = ("table", "--seeds", 2, "--trials", "flat,ramp", "--policy-seeds", 1, "-o", "out")
JOBS = 2 * 2 * 3 + 2 * 3


def evaluation(drift: float) -> EvaluationRecord:
    """An evaluation whose numbers are all the same."""
    values: dict[str, Any] = dict.fromkeys(EvaluationRecord.model_fields, drift)
    values |= {
        "schema_version": 1,
        "paper_drift_at": "end",
        "velocity_source": "estimate",
        "alignment": "yaw_position",
        "clock_is_estimated": True,
        "poses": 1,
        "notes": (),
        "gaps": GapsRecord(ground_truth_holes=0, estimate_holes=0, poses_outside=0, poses_in_holes=0),
    }
    return EvaluationRecord(**values)


class MadeUp:
    """Stands in for the work of a table: every estimator drifts by 1 %, combined by half of it."""

    def __init__(self) -> None:
        self.calls: list[tuple[int, str | None]] = []
        self.jobs: list[str] = []
        self.fails = ""

    def __call__(self, work: Sequence[WorkUnit], workers: int, scheduler: str | None, report: ProgressCallback) -> None:
        self.calls.append((workers, scheduler))
        for unit in work:
            for job in unit.jobs:
                self.jobs.append(job.name)
                record = failed(job, unit.plan, "it fell")
                if job.name != self.fails:
                    drifts = {name: 0.5 if name.startswith("combined") else 1.0 for name in record.estimators}
                    estimators = {
                        name: record.estimators[name].model_copy(
                            update={"failure": None, "vicon": evaluation(drift), "truth": evaluation(drift)}
                        )
                        for name, drift in drifts.items()
                    }
                    record = record.model_copy(update={"failure": None, "estimators": estimators})
                unit.store.write(job, record)
                report(WorkProgress("done" if record.failure is None else "failed", job.name, record.failure or ""))


@pytest.fixture
def made_up(monkeypatch: pytest.MonkeyPatch) -> MadeUp:
    instead = MadeUp()
    monkeypatch.setattr(build, "run_work", instead)
    return instead


def test_it_prints_the_table_and_writes_it_in_three_forms(made_up: MadeUp, coclo: Coclo, tmp_path: Path) -> None:
    answer = coclo(*SMALL)
    assert answer.status == 0
    assert len(made_up.jobs) == JOBS
    assert made_up.calls == [(os.cpu_count(), None)]
    for text in (
        "Table I: drift / RPE per metre",
        "0.50 / 0.50",
        "2/2, 100 %",
        "22.04",
        "combined VINS against VINS",
    ):
        assert text in answer.out
    assert answer.err.splitlines()[-1].startswith(f"{JOBS} of {JOBS}: ramp_12_combined")
    assert {path.name for path in (tmp_path / "out").iterdir()} >= {"table.json", "table.md", "table.html", "jobs"}
    made = json.loads((tmp_path / "out" / "table.json").read_text(encoding="utf-8"))
    assert len(made["jobs"]) == JOBS
    assert made["summary"]["wins"]["combined_coclo"]["vicon"]["all"]["drift"]["share"] == 1.0
    assert str(tmp_path) not in json.dumps(made), "a table names no path of this machine"


def test_json_goes_alone_to_standard_output(made_up: MadeUp, coclo: Coclo, tmp_path: Path) -> None:
    answer = coclo(*SMALL, "--json", "--set", "bridge.vision_latency_s=0.1", "--ideal", "--workers", 3)
    made = json.loads(answer.out)
    assert made == json.loads((tmp_path / "out" / "table.json").read_text(encoding="utf-8"))
    assert made["settings"] == {"set": {"bridge": {"vision_latency_s": 0.1}}, "file": {}}
    assert shlex.split(made["command"]) == [
        *("coclo-vio", "table", "--seeds", "2", "--first-seed", "11", "--trials", "flat,ramp"),
        *("--modes", "coclo,vins,combined", "--policy-seeds", "1", "--ideal", "--set", "bridge.vision_latency_s=0.1"),
    ]
    assert made_up.calls == [(3, None)]


def test_finished_jobs_are_not_run_again_failed_ones_are(made_up: MadeUp, coclo: Coclo) -> None:
    made_up.fails = "flat_12_vins"
    first = coclo(*SMALL)
    assert first.status == 0, "one failure is a line of the table"
    assert "flat 12 vins, vins: it fell" in first.err
    made_up.fails, made_up.jobs = "", []
    again = coclo(*SMALL, "--scheduler", "tcp://127.0.0.1:9")
    assert made_up.jobs == ["flat_12_vins"]
    assert made_up.calls[-1][1] == "tcp://127.0.0.1:9"
    assert f"{JOBS - 1} of {JOBS} jobs are finished already, in out" in again.err
    assert "(1" in first.out
    assert "(1" not in again.out


def test_another_configuration_in_the_same_folder_is_refused_unless_fresh(made_up: MadeUp, coclo: Coclo) -> None:
    coclo(*SMALL)
    made_up.jobs = []
    answer = coclo(*SMALL, "--set", "filter.profile=paper")
    assert (answer.status, made_up.jobs) == (1, [])
    assert f"{JOBS} of the {JOBS} finished jobs in " in answer.err
    assert is_one_sentence(answer)
    assert coclo(*SMALL, "--set", "filter.profile=paper", "--fresh").status == 0
    assert len(made_up.jobs) == JOBS


def test_jobs_that_a_cluster_stored_elsewhere_are_reported_missing(
    made_up: MadeUp, coclo: Coclo, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(build, "run_work", lambda *_: None)
    answer = coclo(*SMALL)
    assert answer.status == 1
    assert f"{JOBS} jobs have left nothing in " in answer.err
    assert is_one_sentence(answer)


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (("--trials", "flat,hill"), "some of flat, ramp, stairs"),
        (("--modes", ","), "--modes names no mode"),
        (("--modes", "cocla"), "there is no mode 'cocla'"),
        (("--set", "filter.profil=paper"), "there is no filter.profil"),
        (("--seeds", "0"), "--seeds"),
        (("--workers", "0"), "--workers"),
    ],
)
def test_a_wrong_argument_is_refused_before_anything_is_made(
    arguments: tuple[str, ...], text: str, made_up: MadeUp, coclo: Coclo, tmp_path: Path
) -> None:
    answer = coclo("table", "-o", "out", *arguments)
    assert (answer.status, made_up.calls) == (2, [])
    assert text in answer.err
    assert list(tmp_path.iterdir()) == []


def test_sigterm_is_an_interrupt_that_keeps_finished_jobs(coclo: Coclo, monkeypatch: pytest.MonkeyPatch) -> None:
    def ends(work: Sequence[WorkUnit], *_: object) -> None:
        MadeUp()(work[:1], 1, None, lambda _: None)
        os.kill(os.getpid(), signal.SIGTERM)
        pytest.fail("it went on")

    before = signal.getsignal(signal.SIGTERM)
    monkeypatch.setattr(build, "run_work", ends)
    answer = coclo(*SMALL)
    assert answer.status == 143
    assert "stopped by SIGTERM" in answer.err
    assert f"of {JOBS} jobs are finished, in out; finished jobs are kept: the same command goes on" in answer.err
    assert signal.getsignal(signal.SIGTERM) is before
    instead = MadeUp()
    monkeypatch.setattr(build, "run_work", instead)
    assert coclo(*SMALL).status == 0
    assert not any(name.startswith("flat_11") for name in instead.jobs)


def test_the_choices_of_the_help_are_those_of_the_plan() -> None:
    shown = CliRunner().invoke(cli.app, ["table", "--help"], env={"COLUMNS": "200"}).output
    for text in ("flat,ramp,stairs", "those of the paper's table", "--no-keep-recordings", "--no-nanny"):
        assert text in shown
    assert recordings.TablePlan().trials == ("flat", "ramp", "stairs")


def test_without_mujoco_it_names_the_extra(tmp_path: Path) -> None:
    code = "import sys; sys.modules['mujoco'] = None; from coclo_vio.cli import main; main()"
    command = [sys.executable, "-c", code, "table", "-o", "out"]
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=tmp_path)
    assert done.returncode == 1
    assert "pip install 'coclo-vio[sim,viz]'" in done.stderr
    assert list(tmp_path.iterdir()) == []
