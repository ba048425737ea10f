# SPDX-License-Identifier: BSD-3-Clause
"""A frame through front end and smoother: the work that ``combined`` has done at once, in a thread or in a process."""

from collections.abc import Mapping
from concurrent.futures import Future
from dataclasses import dataclass
from typing import Protocol

from coclo_vio.fusion.frame_worker import FrameWorker
from coclo_vio.fusion.vision_chain import Smoother, TrackedFrame, VisionChain, prefixed
from coclo_vio.values.arrays import Array
from coclo_vio.values.keyframes import FrameResult, OdometryDelta, PoseEvidence, PoseMarginal
from coclo_vio.values.measurements import StereoFrame, StereoTracks

Processed = tuple[TrackedFrame, FrameResult] | None
"""A frame's tracks and what the window gives for it; None where there are images and no front end."""


@dataclass(frozen=True, slots=True, eq=False)
class FrameJob:
    """A frame, and what the filter knows of it.

    Attributes:
        frame: images or tracks.
        T_world_previous: pose of the body at the last frame, (4, 4), None if unknown.
        T_world_expected: expected pose at this one, (4, 4).
        odometry: the filter's motion since the last keyframe.
        evidence: the filter's on the poses of that keyframe and this frame.
        start: the window starts anew with this frame, from this pose; None: it goes on.
    """

    frame: StereoFrame | StereoTracks
    T_world_previous: Array | None
    T_world_expected: Array
    odometry: OdometryDelta | None = None
    evidence: PoseEvidence | None = None
    start: PoseMarginal | None = None


class VisionStages:
    """Front end and smoother, which process one frame after the other."""

    def __init__(self, chain: VisionChain, smoother: Smoother) -> None:
        """Take fresh ones; the smoother without an IMU."""
        self.chain, self._smoother = chain, smoother

    @property
    def counts(self) -> Mapping[str, int]:
        """What was counted by front end and smoother."""
        return {**self.chain.counts, **prefixed("smoother", self._smoother.counts)}

    def process(self, job: FrameJob) -> Processed:
        """Track a frame and give the tracks to the window.

        Raises:
            CocloError: the frame cannot be processed.
        """
        if job.start is not None:
            self._smoother.start_from(job.start)
        tracked = self.chain.track(job.frame, job.T_world_previous, job.T_world_expected)
        if tracked is None:
            return None
        return tracked, self._smoother.push_tracks(tracked.tracks, job.odometry, job.evidence)


class FrameProcessor(Protocol):
    """Whoever processes the frames of ``combined``: ``FramesInTurn``, ``fusion.vision_process.VisionProcess``."""

    def submit(self, job: FrameJob) -> Future[Processed]:
        """Begin to process a frame, after the one before is done."""

    def close(self) -> None:
        """End what was begun for it: a thread, a process."""

    @property
    def counts(self) -> Mapping[str, int]:
        """What was counted by front end and smoother."""


class FramesInTurn:
    """Frames processed by this process: at once, or by a thread until their results are due."""

    def __init__(self, stages: VisionStages, threads: int) -> None:
        """Take the stages; ``threads``: 1 for a thread beside the caller's, 0 for none."""
        self._stages, self._worker = stages, FrameWorker(threads)

    @property
    def counts(self) -> Mapping[str, int]:
        """What was counted by front end and smoother."""
        return self._stages.counts

    def is_next(self, stamp_ns: int) -> bool:
        """Whether a frame of this stamp is later than the last one that was tracked."""
        return self._stages.chain.is_next(stamp_ns)

    def submit(self, job: FrameJob) -> Future[Processed]:
        """Begin to process a frame."""
        return self._worker.submit(lambda: self._stages.process(job))

    def close(self) -> None:
        """Wait for the thread's end."""
        self._worker.close()
