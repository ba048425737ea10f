# SPDX-License-Identifier: BSD-3-Clause
"""A run that fails, is stopped or killed continues where it was, here, in processes and on a cluster."""

import multiprocessing
import os
import pickle
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from distributed import LocalCluster
from short_walk import MadePlan

from coclo_vio.experiments.table import cluster, job
from coclo_vio.experiments.table.build import missing, run_work, unfinished
from coclo_vio.experiments.table.runner import run_in_processes
from coclo_vio.experiments.table.work_unit import WorkProgress, WorkUnit
from coclo_vio.values.errors import ConfigError, DatasetError, FilterError

Made = Callable[..., MadePlan]
# Works until the first job is finished, prints the ids of its processes, and is killed.
_KILLED = """
import multiprocessing, os, pickle, signal, sys
from coclo_vio.experiments.table.runner import run_in_processes

def report(step):
    if step.kind == "done":
        print(step.name, *(child.pid for child in multiprocessing.active_children()), flush=True)
        os.kill(os.getpid(), signal.SIGKILL)

run_in_processes(pickle.load(open(sys.argv[1], "rb")), 1, report)
"""


def work_of(table: MadePlan) -> list[WorkUnit]:
    return unfinished(table.plan, table.recordings, table.store)


def names_run(steps: list[WorkProgress]) -> list[str]:
    return [step.name for step in steps if step.kind == "running"]


def half_files(table: MadePlan) -> list[Path]:
    return list(table.store.folder.rglob(".*"))


def is_running(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


@pytest.mark.long
def test_a_failed_job_is_reported_stored_and_run_again(made: Made, monkeypatch: pytest.MonkeyPatch) -> None:
    table = made(seeds=3)
    whole = job.run_modes

    def fails(path: Path, *rest: object) -> object:
        if path.name == "flat_1":
            raise FilterError(f"{path} has\n no feet")
        if path.name == "flat_2":
            raise ZeroDivisionError("by zero")
        return whole(path, *rest)  # type: ignore[arg-type]

    monkeypatch.setattr(job, "run_modes", fails)
    steps: list[WorkProgress] = []
    run_work(work_of(table), 1, None, steps.append)
    reasons = [step.reason for step in steps if step.kind == "failed"]
    assert reasons == ["flat_1 has no feet", "ZeroDivisionError: by zero"]
    assert missing(table.plan, table.store) == []
    assert half_files(table) == []
    monkeypatch.setattr(job, "run_modes", whole)
    again: list[WorkProgress] = []
    run_work(work_of(table), 1, None, again.append)
    assert names_run(again) == ["flat_1_naive", "flat_2_naive"], "finished jobs are not run again"
    assert [record.failure for record in table.store.kept(table.plan).values()] == [None] * 3
    assert work_of(table) == []
    assert {unit.name for unit in unfinished(table.plan, table.recordings, table.store, fresh=True)} == {
        *("flat_1", "flat_2", "flat_3")
    }


def test_an_interrupt_that_compiled_code_made_an_error_of_is_no_failure_of_a_job(
    made: Made, monkeypatch: pytest.MonkeyPatch
) -> None:
    table = made(seeds=2)

    def stopped(path: Path, *rest: object) -> object:
        raise SystemError("CPUDispatcher returned a result with an exception set") from KeyboardInterrupt()

    monkeypatch.setattr(job, "run_modes", stopped)
    with pytest.raises(KeyboardInterrupt):
        run_work(work_of(table), 1, None, lambda _: None)
    assert len(missing(table.plan, table.store)) == 2


def test_a_mode_that_lacks_a_sensor_fails_with_its_message(made: Made) -> None:
    table = made(modes=("combined",))
    run_work(work_of(table), 1, None, lambda _: None)
    (record,) = table.store.kept(table.plan).values()
    assert set(record.estimators) == {"combined_coclo", "combined_vins"}
    assert record.failure is not None
    assert record.failure == record.estimators["combined_vins"].failure
    assert "images" in record.failure or "cameras" in record.failure


@pytest.mark.slow
def test_a_run_that_is_killed_takes_its_processes_with_it_and_goes_on(made: Made, tmp_path: Path) -> None:
    table = made(seeds=2)
    plan = tmp_path / "work.pickle"
    plan.write_bytes(pickle.dumps(work_of(table)))
    killed = subprocess.run([sys.executable, "-c", _KILLED, plan], capture_output=True, text=True, check=False)
    assert killed.returncode < 0
    finished, *pids = killed.stdout.split()
    assert finished == "flat_1_naive"
    assert pids
    until_s = time.monotonic() + 60.0
    while any(is_running(int(pid)) for pid in pids) and time.monotonic() < until_s:
        time.sleep(0.1)
    assert not any(is_running(int(pid)) for pid in pids)
    steps: list[WorkProgress] = []
    run_work(work_of(table), 1, None, steps.append)
    assert finished not in names_run(steps)
    assert missing(table.plan, table.store) == []


@pytest.mark.long
def test_a_run_that_is_stopped_leaves_nothing_half_and_goes_on(made: Made) -> None:
    table = made(seeds=2)

    def stop(step: WorkProgress) -> None:
        raise KeyboardInterrupt

    before = set(multiprocessing.active_children())
    with pytest.raises(KeyboardInterrupt):
        run_in_processes(work_of(table), 1, stop)
    assert set(multiprocessing.active_children()) <= before
    assert half_files(table) == []
    threads = dict(os.environ)
    run_in_processes(work_of(table), 1, lambda _: None)
    assert work_of(table) == []
    assert dict(os.environ) == threads


@pytest.mark.long
def test_a_process_that_is_killed_is_replaced_and_finished_jobs_are_not_done_again(made: Made) -> None:
    table = made(seeds=2)
    steps: list[WorkProgress] = []

    def kill_once(step: WorkProgress) -> None:
        steps.append(step)
        if step.kind == "done" and sum(each.kind == "done" for each in steps) == 1:
            for child in multiprocessing.active_children():
                child.kill()

    run_in_processes(work_of(table), 1, kill_once)
    assert work_of(table) == []
    assert sum(step == WorkProgress("done", "flat_1_naive") for step in steps) == 1


@pytest.mark.slow
def test_processes_that_die_again_and_again_are_an_error_with_the_next_step(made: Made) -> None:
    table = made()
    (unit,) = work_of(table)

    def kill(step: WorkProgress) -> None:
        for child in multiprocessing.active_children():
            child.kill()

    slow = replace(unit, jobs=unit.jobs * 5)
    with pytest.raises(DatasetError, match="fewer --workers, the finished jobs are kept"):
        run_in_processes([slow], 1, kill)


@pytest.mark.long
def test_a_cluster_does_the_same_work_and_reports_its_steps(made: Made, tmp_path: Path) -> None:
    table = made(seeds=2)
    steps: list[WorkProgress] = []
    here = {"host": "127.0.0.1", "protocol": "tcp://", "dashboard_address": "127.0.0.1:0"}
    with LocalCluster(1, threads_per_worker=1, processes=False, local_directory=str(tmp_path), **here) as local:
        run_work(work_of(table), 1, local.scheduler_address, steps.append)
    assert work_of(table) == []
    assert sorted(step.name for step in steps if step.kind == "done") == ["flat_1_naive", "flat_2_naive"], "each once"


def test_a_scheduler_that_does_not_answer_is_named(made: Made, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cluster, "_CONNECT_S", 0.2)
    with pytest.raises(DatasetError, match=r"no Dask scheduler answers at tcp://127.0.0.1:9 .*`dask scheduler`"):
        run_work(work_of(made()), 1, "tcp://127.0.0.1:9", lambda _: None)


def test_without_dask_the_error_has_the_command_that_installs_it(made: Made, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(ConfigError, match=r"pip install 'coclo-vio\[cluster\]'"):
        run_work(work_of(made()), 1, "tcp://127.0.0.1:9", lambda _: None)


@pytest.mark.long
def test_a_worker_of_a_cluster_that_is_killed_is_survived(made: Made, tmp_path: Path) -> None:
    table = made(seeds=3)
    killed: list[int] = []
    here = {"host": "127.0.0.1", "protocol": "tcp://", "dashboard_address": "127.0.0.1:0"}
    with LocalCluster(2, threads_per_worker=1, processes=True, local_directory=str(tmp_path), **here) as local:

        def kill_once(step: WorkProgress) -> None:
            if step.kind == "running" and not killed:
                worker = next(iter(local.workers.values()))
                killed.append(worker.pid)
                os.kill(worker.pid, signal.SIGKILL)

        run_work(work_of(table), 1, local.scheduler_address, kill_once)
    assert killed
    assert work_of(table) == []
    assert half_files(table) == []
