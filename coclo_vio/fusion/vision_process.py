# SPDX-License-Identifier: BSD-3-Clause
"""Front end and smoother in a process of their own: frames go there, results come back whenever they are ready.

A thread would share the interpreter's lock with the filter, which GTSAM holds while it solves. Images go through memory
that both processes map (``SharedImages``), the rest is pickled.
"""

import os
import time
from collections.abc import Callable, Mapping
from concurrent.futures import Future
from dataclasses import dataclass, replace
from multiprocessing.connection import Connection

from coclo_vio.fusion.child_process import ChildProcess
from coclo_vio.fusion.frame_processor import FrameJob, Processed, VisionStages
from coclo_vio.fusion.shared_images import SharedFrame, SharedImages
from coclo_vio.values.errors import CocloError
from coclo_vio.values.measurements import StereoFrame

NICENESS = 5
"""Of the process: where cores are short, the filter comes first, and frames are left out."""

_READY_WITHIN_S = 120.0  # kernels may have to be compiled
_FIRST_FRAME_WITHIN_S = 120.0

StageRecipe = Callable[[], VisionStages]
"""Makes the stages in the process; it can be pickled."""


@dataclass(frozen=True, slots=True, eq=False)
class _Answer:
    """What came of a frame, and the counts by then; ``result`` is None for a process that is ready."""

    result: Processed | CocloError = None
    counts: Mapping[str, int] | None = None


class VisionProcess:
    """Processes frames one by one in another process, which is started anew where it failed.

    Invariant: at most one frame is in process; ``poll`` completes its future.
    """

    def __init__(self, recipe: StageRecipe, image_bytes: int, timeout_s: float) -> None:
        """Start the process.

        Args:
            recipe: of the stages.
            image_bytes: size of one image; larger ones are pickled.
            timeout_s: a frame that is in process for longer has failed.
        """
        self._recipe, self._timeout_s = recipe, timeout_s
        self._memory = SharedImages(image_bytes, 1)
        self._child: ChildProcess | None = None
        self._future: Future[Processed] | None = None
        self._counts: Mapping[str, int] = {}
        self._is_ready, self._deadline_s = False, 0.0
        self._answered = 0
        self.start()

    @property
    def counts(self) -> Mapping[str, int]:
        """What was counted by front end and smoother up to the last answer of each process."""
        return self._counts

    @property
    def is_ready(self) -> bool:
        """Whether it can take a frame: it has started, and no frame is in process."""
        return self._is_ready and self._future is None

    @property
    def pid(self) -> int | None:
        """Number of the process; None where there is none."""
        return None if self._child is None else self._child.pid

    def start(self) -> None:
        """Start a process, with fresh stages, in place of the one that there was.

        Raises:
            CocloError: the system starts no process.
        """
        self.close()
        self._answered = 0
        self._memory.clear()
        arguments = self._recipe, self._memory.descriptor, self._memory.image_bytes
        self._child = ChildProcess(_serve, *arguments, descriptors=(self._memory.descriptor,))
        self._deadline_s = time.monotonic() + _READY_WITHIN_S

    def submit(self, job: FrameJob) -> "Future[Processed]":
        """Have a frame processed; call it where ``is_ready``. ``poll`` completes what is returned."""
        future: Future[Processed] = Future()
        self._future = future
        frame = job.frame
        message: object = job
        if isinstance(frame, StereoFrame) and self._memory.fits(frame):
            message = replace(job, frame=self._memory.write(frame))  # type: ignore[arg-type]
        limit_s = self._timeout_s if self._answered else max(_FIRST_FRAME_WITHIN_S, self._timeout_s)
        self._deadline_s = time.monotonic() + limit_s
        if self._child is not None:
            try:
                self._child.connection.send(message)
            except OSError:
                self._deadline_s = 0.0  # the process is gone, as the next ``poll`` says
        return future

    def poll(self, wait_s: float = 0.0) -> str | None:
        """Take what has come from the process; where it failed, what happened to it. Then there is no process.

        Args:
            wait_s: waits for something to come at most so long.
        """
        if self._child is None:
            return None
        try:
            if self._child.has_message(wait_s):
                self._take(self._child.connection.recv())
                return None
        except (EOFError, OSError):
            return self._failed("ended")
        is_awaited = self._future is not None or not self._is_ready
        if is_awaited and time.monotonic() > self._deadline_s:
            return self._failed("did not answer in time")
        return None

    def close(self) -> None:
        """End the process; a frame that is in process is given up."""
        child, self._child = self._child, None
        self._future, self._is_ready = None, False
        if child is not None:
            child.end()

    def _take(self, answer: _Answer) -> None:
        future, self._future = self._future, None
        if answer.counts is None:
            self._is_ready = True
            return
        self._answered += 1
        self._counts = answer.counts
        if future is None:
            return
        if isinstance(answer.result, CocloError):
            future.set_exception(answer.result)
        else:
            future.set_result(answer.result)

    def _failed(self, how: str) -> str:
        child, self._child = self._child, None
        self._future, self._is_ready = None, False
        if child is None:
            return how
        child.end(0.2)
        status = child.status
        return f"{how} (status {status})" if status and how == "ended" else how


def _serve(connection: Connection, recipe: StageRecipe, descriptor: int, image_bytes: int) -> None:
    """What the process does: a frame in, its result out, until the connection is closed."""
    os.nice(NICENESS)
    memory, stages = SharedImages(image_bytes, 1, descriptor), recipe()
    connection.send(_Answer())
    while True:
        job = connection.recv()
        if isinstance(job.frame, SharedFrame):
            job = replace(job, frame=memory.read(job.frame))
        result: Processed | CocloError
        try:
            result = stages.process(job)
        except CocloError as error:
            result = error
        connection.send(_Answer(result, dict(stages.counts)))
