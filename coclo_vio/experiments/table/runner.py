# SPDX-License-Identifier: BSD-3-Clause
"""Units of work done one after the other, or in several processes of one thread each.

Whoever stops the run stops its processes: they leave what is finished, and nothing half. Processes whose run was killed
go by themselves.
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

from coclo_vio.experiments.table.work_unit import Listener, News, WorkUnit, run_unit
from coclo_vio.simulation.process_environment import environment
from coclo_vio.values.errors import DatasetError

_ONE_THREAD = dict.fromkeys(
    ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENCV_FOR_THREADS_NUM"), "1"
)
_POLL_S = 0.2
_GRACE_S = 10.0


class _Stopped(BaseException):
    """The run was stopped; nothing on the way may take it for a failure of a job."""


def run_here(work: Sequence[WorkUnit], tell: Listener) -> None:
    """One unit after the other, in this process."""
    for unit in work:
        run_unit(unit, tell)


def run_in_processes(work: Sequence[WorkUnit], workers: int, tell: Listener) -> None:
    """All units in so many processes.

    Raises:
        DatasetError: a process died, or a finished job could not be kept.
    """
    spawn = multiprocessing.get_context("spawn")
    news: Queue[News] = spawn.Queue()
    others = set(multiprocessing.active_children())
    pool = ProcessPoolExecutor(workers, spawn, initializer=_prepare, initargs=(news,))
    try:
        with environment(_ONE_THREAD):  # processes are started while work is handed in, and inherit it
            pending = {pool.submit(_work, unit) for unit in work}
            _follow(pending, news, tell)
    except BrokenProcessPool as error:
        raise DatasetError(
            "a worker process died; if it says no reason of its own above, it lacked memory: run again with fewer "
            "--workers, the finished jobs are kept"
        ) from error
    except BaseException:
        pool.shutdown(wait=False, cancel_futures=True)
        _stop([child for child in multiprocessing.active_children() if child not in others])
        raise
    finally:
        pool.shutdown(wait=True, cancel_futures=True)
        _hand_on(news, tell)


def _follow(pending: set[Future[None]], news: "Queue[News]", tell: Listener) -> None:
    """Hand on the news until all is done."""
    while pending:
        done, pending = wait(pending, timeout=_POLL_S, return_when=FIRST_COMPLETED)
        _hand_on(news, tell)
        for future in done:
            future.result()


def _hand_on(news: "Queue[News]", tell: Listener) -> None:
    while True:
        try:
            tell(news.get(timeout=0.01))
        except Empty:
            return


def _stop(children: Sequence[multiprocessing.process.BaseProcess]) -> None:
    """Ask the processes to go, and end those that do not."""
    for child in children:
        child.terminate()
    until_s = time.monotonic() + _GRACE_S
    for child in children:
        child.join(max(0.0, until_s - time.monotonic()))
        if child.is_alive():
            child.kill()
            child.join()


_NEWS: list["Queue[News]"] = []  # at most one: where this process tells its news
_STOPPING: list[bool] = []  # not empty once this process was asked to go
_BUSY: list[str] = []  # the unit that this process works on


def _prepare(news: "Queue[News]") -> None:
    """What a worker process does first: the run, not the keyboard, stops it."""
    _NEWS[:] = [news]
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, _stopping)
    Thread(target=_go_with_the_run, daemon=True).start()


def _stopping(_number: int, _frame: FrameType | None) -> None:
    _STOPPING.append(True)
    if not _BUSY:
        _go()
    raise _Stopped


def _go() -> None:
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    os.kill(os.getpid(), signal.SIGTERM)


def _go_with_the_run() -> None:
    """Wait until the run is dead, then end this process: orderly if it can be, and else at once."""
    run = multiprocessing.parent_process()
    if run is not None:
        wait_for([run.sentinel])
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(_GRACE_S)
        os.kill(os.getpid(), signal.SIGKILL)


def _work(unit: WorkUnit) -> None:
    _BUSY.append(unit.name)
    try:
        run_unit(unit, _NEWS[0].put)
    finally:
        _BUSY.clear()
        if _STOPPING:
            _go()
