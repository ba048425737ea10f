# SPDX-License-Identifier: BSD-3-Clause
"""The command ``table``: what it plans, prints and writes, what stops it. The jobs themselves are invented here."""

import json
import os
import shlex
import signal
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import pytest
from console import Coclo, is_one_sentence
from typer.testing import CliRunner

from coclo_vio import cli
from coclo_vio.experiments.table import build, recordings
from coclo_vio.experiments.table.job import failed
from coclo_vio.experiments.table.trial_results import FIGURES
from coclo_vio.experiments.table.work_unit import Listener, News, WorkUnit

SMALL = ("table", "--seeds", 2, "--trials", "flat,ramp", "--policy-seeds", 1, "-o", "out")
JOBS = 2 * 2 * 3 + 2 * 3


class Invented:
    """Does the work of a table without any: every estimator drifts by 1 %, combined by half of it."""

    def __init__(self) -> None:
        self.calls: list[tuple[int, str | None]] = []
        self.jobs: list[str] = []
        self.fails = ""

    def __call__(self, work: Sequence[WorkUnit], workers: int, scheduler: str | None, tell: Listener) -> None:
        self.calls.append((workers, scheduler))
        for unit in work:
            for job in unit.jobs:
                self.jobs.append(job.name)
                row = failed(job, "it fell")
                for name, told in row["estimators"].items() if job.name != self.fails else ():
                    drift = 0.5 if name.startswith("combined") else 1.0
                    told |= {
                        "failure": None,
                        "vicon": dict.fromkeys(FIGURES, drift),
                        "truth": dict.fromkeys(FIGURES, drift),
                    }
                row["failure"] = "it fell" if job.name == self.fails else None
                unit.store.write(job, {"fingerprint": unit.plan.fingerprint(job), **row})
                tell(News("failed", job.name, "it fell") if row["failure"] else News("done", job.name))


@pytest.fixture
def invented(monkeypatch: pytest.MonkeyPatch) -> Invented:
    instead = Invented()
    monkeypatch.setattr(build, "do", instead)
    return instead


def test_it_prints_the_table_and_writes_it_in_three_forms(invented: Invented, coclo: Coclo, tmp_path: Path) -> None:
    answer = coclo(*SMALL)
    assert answer.status == 0
    assert len(invented.jobs) == JOBS
    assert invented.calls == [(os.cpu_count(), None)]
    for words in (
        "Table I: drift / RPE per metre",
        "0.50 / 0.50",
        "2/2, 100 %",
        "22.04",
        "combined VINS against VINS",
    ):
        assert words in answer.out
    assert answer.err.splitlines()[-1].startswith(f"{JOBS} of {JOBS}: ramp_12_combined")
    assert {path.name for path in (tmp_path / "out").iterdir()} >= {"table.json", "table.md", "table.html", "jobs"}
    made = json.loads((tmp_path / "out" / "table.json").read_text(encoding="utf-8"))
    assert len(made["jobs"]) == JOBS
    assert made["summary"]["wins"]["combined_coclo"]["vicon"]["all"]["drift"]["share"] == 1.0
    assert str(tmp_path) not in json.dumps(made), "a table that is handed on names no place of this machine"


def test_json_goes_alone_to_standard_output(invented: Invented, coclo: Coclo, tmp_path: Path) -> None:
    answer = coclo(*SMALL, "--json", "--set", "bridge.vision_latency_s=0.1", "--ideal", "--workers", 3)
    made = json.loads(answer.out)
    assert made == json.loads((tmp_path / "out" / "table.json").read_text(encoding="utf-8"))
    assert made["settings"] == {"set": {"bridge": {"vision_latency_s": 0.1}}, "file": {}}
    assert shlex.split(made["command"]) == [
        *("coclo-vio", "table", "--seeds", "2", "--first-seed", "11", "--trials", "flat,ramp"),
        *("--modes", "coclo,vins,combined", "--policy-seeds", "1", "--ideal", "--set", "bridge.vision_latency_s=0.1"),
    ]
    assert invented.calls == [(3, None)]


def test_finished_jobs_are_not_run_again_failed_ones_are(invented: Invented, coclo: Coclo) -> None:
    invented.fails = "flat_12_vins"
    first = coclo(*SMALL)
    assert first.status == 0, "one failure is a line of the table"
    assert "flat 12 vins, vins: it fell" in first.err
    invented.fails, invented.jobs = "", []
    again = coclo(*SMALL, "--scheduler", "tcp://127.0.0.1:9")
    assert invented.jobs == ["flat_12_vins"]
    assert invented.calls[-1][1] == "tcp://127.0.0.1:9"
    assert f"{JOBS - 1} of {JOBS} jobs are finished already, in out" in again.err
    assert "(1" in first.out
    assert "(1" not in again.out


def test_another_configuration_in_the_same_folder_is_refused_unless_fresh(invented: Invented, coclo: Coclo) -> None:
    coclo(*SMALL)
    invented.jobs = []
    answer = coclo(*SMALL, "--set", "filter.profile=paper")
    assert (answer.status, invented.jobs) == (1, [])
    assert f"{JOBS} of the {JOBS} finished jobs in " in answer.err
    assert is_one_sentence(answer)
    assert coclo(*SMALL, "--set", "filter.profile=paper", "--fresh").status == 0
    assert len(invented.jobs) == JOBS


def test_jobs_that_a_cluster_left_elsewhere_are_missed(
    invented: Invented, coclo: Coclo, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(build, "do", lambda *_: None)
    answer = coclo(*SMALL)
    assert answer.status == 1
    assert f"{JOBS} jobs have left nothing in " in answer.err
    assert is_one_sentence(answer)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--trials", "flat,hill"), "some of flat, ramp, stairs"),
        (("--modes", ","), "--modes names no estimator"),
        (("--modes", "cocla"), "there is no mode 'cocla'"),
        (("--set", "filter.profil=paper"), "there is no filter.profil"),
        (("--seeds", "0"), "--seeds"),
        (("--workers", "0"), "--workers"),
    ],
)
def test_what_is_wrong_is_said_before_anything_is_made(
    arguments: tuple[str, ...], words: str, invented: Invented, coclo: Coclo, tmp_path: Path
) -> None:
    answer = coclo("table", "-o", "out", *arguments)
    assert (answer.status, invented.calls) == (2, [])
    assert words in answer.err
    assert list(tmp_path.iterdir()) == []


def test_a_request_to_end_is_an_interrupt_that_keeps_what_is_finished(
    coclo: Coclo, monkeypatch: pytest.MonkeyPatch
) -> None:
    def ends(work: Sequence[WorkUnit], *_: object) -> None:
        Invented()(work[:1], 1, None, lambda _: None)
        os.kill(os.getpid(), signal.SIGTERM)
        pytest.fail("it went on")

    before = signal.getsignal(signal.SIGTERM)
    monkeypatch.setattr(build, "do", ends)
    answer = coclo(*SMALL)
    assert answer.status not in (0, 2)
    assert "stopped; finished jobs are kept: the same command goes on from here" in answer.err
    assert signal.getsignal(signal.SIGTERM) is before
    instead = Invented()
    monkeypatch.setattr(build, "do", instead)
    assert coclo(*SMALL).status == 0
    assert not any(name.startswith("flat_11") for name in instead.jobs)


def test_the_choices_of_the_help_are_those_of_the_plan() -> None:
    shown = CliRunner().invoke(cli.app, ["table", "--help"], env={"COLUMNS": "200"}).output
    for words in ("flat,ramp,stairs", "coclo,vins,combined", "--no-keep-recordings", "--no-nanny"):
        assert words in shown
    assert recordings.TablePlan().trials == ("flat", "ramp", "stairs")


def test_without_mujoco_it_names_the_extra(tmp_path: Path) -> None:
    code = "import sys; sys.modules['mujoco'] = None; from coclo_vio.cli import main; main()"
    command = [sys.executable, "-c", code, "table", "-o", "out"]
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=tmp_path)
    assert done.returncode == 1
    assert "pip install 'coclo-vio[sim,viz]'" in done.stderr
    assert list(tmp_path.iterdir()) == []
