# SPDX-License-Identifier: BSD-3-Clause
"""Stages for a process of vision: the real smoother of tracks, and stand-ins that fail, hang, die or wait.

They are made in that process, which loads no more than this file asks for.
"""

import os
import signal
import time
from collections.abc import Callable
from pathlib import Path

from stand_ins import NotingFrontend, NotingSmoother

from coclo_vio.fusion.frame_processor import FrameJob, Processed, VisionStages
from coclo_vio.fusion.vision_chain import VisionChain
from coclo_vio.values.errors import SmootherError
from coclo_vio.values.measurements import StereoFrame


class Scripted(VisionStages):
    """Stages of stand-ins that do something at the n-th frame of their process, if ``marker`` is not there yet."""

    def __init__(self, at: int, what: Callable[[], None], marker: Path | None = None) -> None:
        super().__init__(VisionChain(NotingFrontend()), NotingSmoother(keyframes_every=1))
        self._at, self._what, self._marker, self._number = at, what, marker, 0

    def process(self, job: FrameJob) -> Processed:
        self._number += 1
        is_first = self._marker is None or not self._marker.exists()
        if self._number >= self._at and is_first:
            if self._marker is not None:
                self._marker.touch()
            self._what()
        return super().process(job)


def real_stages() -> VisionStages:
    from walk_among_points import NOISE_PX, RIG  # noqa: PLC0415 -- loads Pinocchio

    from coclo_vio.backend.window.config import SmootherConfig  # noqa: PLC0415 -- loads GTSAM
    from coclo_vio.backend.window.smoother import SlidingWindowSmoother  # noqa: PLC0415

    config = SmootherConfig.parse({"noise": {"track_px": NOISE_PX, "disparity_px": NOISE_PX}}, "test")
    return VisionStages(VisionChain(None), SlidingWindowSmoother(RIG, config))


def fails() -> None:
    raise SmootherError("the third frame is at fault")


def dies() -> None:
    os.kill(os.getpid(), signal.SIGKILL)


class Delayed(VisionStages):
    """The real smoother, which takes longer."""

    def __init__(self, takes_s: float) -> None:
        stages = real_stages()
        super().__init__(stages.chain, stages._smoother)
        self._takes_s = takes_s

    def process(self, job: FrameJob) -> Processed:
        time.sleep(self._takes_s)
        return super().process(job)


class Echo(VisionStages):
    """Raises what it got."""

    def __init__(self) -> None:
        super().__init__(VisionChain(None), NotingSmoother())

    def process(self, job: FrameJob) -> Processed:
        assert isinstance(job.frame, StereoFrame)
        left, right = job.frame.left, job.frame.right
        raise SmootherError(f"{left.shape} {int(left.sum())} {int(right.sum())}")
