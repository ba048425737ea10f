# SPDX-License-Identifier: BSD-3-Clause
"""Processing of a frame beside the filter: in a thread of its own, or at once where there is none.

The caller decides by stamps when it takes a result, and waits for it then. So outputs do not depend on threads.
"""

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any, TypeVar

from coclo_vio.values.errors import CocloError

THREAD_NAME = "coclo_vio_frames"

_T = TypeVar("_T")


class FrameWorker:
    """Runs one job after the other. The thread begins with the first job and ends with ``close``, or with this object.

    Args:
        threads: 1 for a thread beside the caller's, 0 for none.
    """

    def __init__(self, threads: int) -> None:
        self._threads = threads
        self._executor: ThreadPoolExecutor | None = None

    def checkpoint_fields(self) -> dict[str, Any]:
        """What a checkpoint keeps: no thread, the next job begins one."""
        return {"_threads": self._threads}

    def restore_fields(self, fields: dict[str, Any]) -> None:
        """Take what a checkpoint kept."""
        self._threads, self._executor = fields["_threads"], None

    def submit(self, job: Callable[[], _T]) -> Future[_T]:
        """Begin a job. Its result, or the CocloError that it raised, comes from ``result()`` of what is returned."""
        if not self._threads:
            done: Future[_T] = Future()
            try:
                done.set_result(job())
            except CocloError as error:
                done.set_exception(error)
            return done
        if self._executor is None:
            self._executor = ThreadPoolExecutor(self._threads, thread_name_prefix=THREAD_NAME)
        return self._executor.submit(job)

    def close(self) -> None:
        """Wait for the thread's end; the next job begins another one."""
        if self._executor is not None:
            self._executor.shutdown()
            self._executor = None
