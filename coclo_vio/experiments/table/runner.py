# SPDX-License-Identifier: BSD-3-Clause
"""Units of work done one after the other, or in several processes of one thread each.

Stopping the run stops its processes: finished jobs stay, unfinished ones leave nothing. Processes whose run was killed
end by themselves.
"""

import multiprocessing
import os
import signal
import time
from collections.abc import Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from multiprocessing.connection import wait as wait_for
from multiprocessing.queues import Queue
from queue import Empty
from threading import Thread
from types import FrameType

from coclo_vio.experiments.table.work_unit import ProgressCallback, WorkProgress, WorkUnit, run_unit
from coclo_vio.simulation.process_environment import environment
from coclo_vio.values.errors import DatasetError

_ONE_THREAD = dict.fromkeys(
    ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENCV_FOR_THREADS_NUM"), "1"
)
_POLL_S = 0.2
_GRACE_S = 10.0
_MOST_DEATHS = 3  # of worker processes in a run


class _Stopped(BaseException):
    """The run was stopped; not an Exception, so that it is not recorded as the failure of a job."""


def run_here(work: Sequence[WorkUnit], report: ProgressCallback) -> None:
    """One unit after the other, in this process."""
    for unit in work:
        run_unit(unit, report)


def run_in_processes(work: Sequence[WorkUnit], workers: int, report: ProgressCallback) -> None:
    """All units in ``workers`` processes. Where one dies, new ones go on with the jobs that are not finished.

    Raises:
        DatasetError: processes died again and again, or a finished job could not be stored.
    """
    remaining = list(work)
    for _ in range(_MOST_DEATHS):
        ended: set[str] = set()

        def follow(step: WorkProgress, ended: set[str] = ended) -> None:
            if step.kind == "ended":
                ended.add(step.name)
            report(step)

        try:
            _run_once(remaining, min(workers, len(remaining)), follow)
            return
        except BrokenProcessPool as error:
            last = error
            remaining = [unit for unit in remaining if unit.name not in ended]
            if not remaining:
                return
    raise DatasetError(
        f"worker processes died {_MOST_DEATHS} times; without an error of their own above they ran out of memory: run "
        "again with fewer --workers, the finished jobs are kept"
    ) from last


def _run_once(work: Sequence[WorkUnit], workers: int, report: ProgressCallback) -> None:
    """All units in one set of processes.

    Raises:
        BrokenProcessPool: one of them died.
    """
    spawn = multiprocessing.get_context("spawn")
    steps: Queue[WorkProgress] = spawn.Queue()
    unrelated = set(multiprocessing.active_children())
    pool = ProcessPoolExecutor(workers, spawn, initializer=_prepare, initargs=(steps,))
    try:
        with environment(_ONE_THREAD):  # processes are started while work is handed in, and inherit it
            pending = {pool.submit(_work, unit) for unit in work}
            _follow(pending, steps, report)
    except BrokenProcessPool:
        raise
    except BaseException:
        pool.shutdown(wait=False, cancel_futures=True)
        _stop([child for child in multiprocessing.active_children() if child not in unrelated])
        raise
    finally:
        pool.shutdown(wait=True, cancel_futures=True)
        _hand_on(steps, report)


def _follow(pending: set[Future[None]], steps: "Queue[WorkProgress]", report: ProgressCallback) -> None:
    """Report the steps of the processes until all are done."""
    while pending:
        done, pending = wait(pending, timeout=_POLL_S, return_when=FIRST_COMPLETED)
        _hand_on(steps, report)
        for future in done:
            future.result()


def _hand_on(steps: "Queue[WorkProgress]", report: ProgressCallback) -> None:
    while True:
        try:
            report(steps.get(timeout=0.01))
        except Empty:
            return


def _stop(children: Sequence[multiprocessing.process.BaseProcess]) -> None:
    """Terminate the processes, and kill those that do not end in time."""
    for child in children:
        child.terminate()
    until_s = time.monotonic() + _GRACE_S
    for child in children:
        child.join(max(0.0, until_s - time.monotonic()))
        if child.is_alive():
            child.kill()
            child.join()


_STEPS: list["Queue[WorkProgress]"] = []  # at most one: the queue for the steps of this process
_STOPPING: list[bool] = []  # not empty once this process has received SIGTERM
_BUSY: list[str] = []  # the unit that this process works on


def _prepare(steps: "Queue[WorkProgress]") -> None:
    """Set up a worker process: the run, not the keyboard, stops it."""
    _STEPS[:] = [steps]
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, _stopping)
    Thread(target=_end_with_the_run, daemon=True).start()


def _stopping(_number: int, _frame: FrameType | None) -> None:
    _STOPPING.append(True)
    if not _BUSY:
        _end()
    raise _Stopped


def _end() -> None:
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    os.kill(os.getpid(), signal.SIGTERM)


def _end_with_the_run() -> None:
    """Wait until the run has died, then end this process: in order if possible, at once otherwise."""
    run = multiprocessing.parent_process()
    if run is not None:
        wait_for([run.sentinel])
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(_GRACE_S)
        os.kill(os.getpid(), signal.SIGKILL)


def _work(unit: WorkUnit) -> None:
    _BUSY.append(unit.name)
    try:
        run_unit(unit, _STEPS[0].put)
    finally:
        _BUSY.clear()
        if _STOPPING:
            _end()
