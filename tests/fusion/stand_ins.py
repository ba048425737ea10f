# SPDX-License-Identifier: BSD-3-Clause
"""Stages that note what they get: a front end, a smoother."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from coclo_vio.geometry import se3, so3
from coclo_vio.values.arrays import Array, ByteImage
from coclo_vio.values.calibration import RectifiedStereo
from coclo_vio.values.estimates import NavState, StateEstimate
from coclo_vio.values.keyframes import FrameResult, KeyframeResult, OdometryDelta, PoseEvidence, PoseMarginal
from coclo_vio.values.measurements import BodyTwistSample, InertialReading, StereoFrame, StereoTracks
from coclo_vio.values.outputs import Event, KeyframeHealth

MS = 1_000_000
T_BODY_CAMERA = se3.transform(so3.exp(np.array([0.3, -0.2, 0.5])), np.array([0.2, 0.0, 0.1]))
RIG = RectifiedStereo((400.0, 400.0), (320.0, 240.0), 0.05, T_BODY_CAMERA)


def tracks(stamp_ns: int) -> StereoTracks:
    return StereoTracks(stamp_ns, np.arange(3), np.ones((3, 2)), np.ones((3, 2)))


def frame(stamp_ns: int) -> StereoFrame:
    image = np.zeros((6, 8), dtype=np.uint8)
    return StereoFrame(stamp_ns, image, image)


def pose_at(stamp_ns: int) -> Array:
    """A body that turns and moves."""
    return se3.exp(stamp_ns * 1e-9 * np.array([0.3, 0.1, -0.5, 1.0, 2.0, 0.5]))


def state_at(stamp_ns: int) -> StateEstimate:
    return StateEstimate(stamp_ns, NavState(pose_at(stamp_ns), *(np.zeros(3) for _ in range(4))), np.eye(9))


@dataclass
class NotingFrontend:
    """Notes the expected motion that it gets; its picture of the n-th frame is n everywhere."""

    rig: RectifiedStereo = RIG
    expected: list[Array | None] = field(default_factory=list)
    stamps_ns: list[int] = field(default_factory=list)

    def track(self, frame: StereoFrame, T_previous_current: Array | None = None) -> StereoTracks:
        self.expected.append(T_previous_current)
        self.stamps_ns.append(frame.stamp_ns)
        return tracks(frame.stamp_ns)

    def overlay(self) -> ByteImage:
        return np.full((6, 16, 3), len(self.expected), dtype=np.uint8)

    @property
    def counts(self) -> Mapping[str, int]:
        return {"detected": 3 * len(self.expected)}


@dataclass
class NotingSmoother:
    """Knows the poses of ``pose_at``; gives estimates from its second frame on, and a keyframe at every third.

    Attributes:
        keyframes_every: 1 makes every frame a keyframe.
        result: of a keyframe, from its stamp and that of the keyframe before, where results are given.
    """

    keyframes_every: int = 3
    result: Callable[[int, int | None], KeyframeResult] | None = None
    pushed: list[object] = field(default_factory=list)
    frames: int = 0
    latest_pose: Array | None = None
    keyframe_ns: int | None = None
    odometry: list[OdometryDelta | None] = field(default_factory=list)
    evidence: list[PoseEvidence | None] = field(default_factory=list)
    start: PoseMarginal | None = None
    begun_anew: list[tuple[str, float]] = field(default_factory=list)

    @property
    def counts(self) -> Mapping[str, int]:
        return {"keyframes": 1}

    def start_from(self, marginal: PoseMarginal, velocity: tuple[Array, float] | None = None) -> None:
        self.start = marginal

    def begin_anew(self, detail: str, late_s: float) -> None:
        self.begun_anew.append((detail, late_s))

    def push_imu(self, sample: InertialReading) -> None:
        self.pushed.append(sample)

    def push_twist(self, sample: BodyTwistSample) -> None:
        self.pushed.append(sample)

    def predicted_pose(self, stamp_ns: int) -> Array | None:
        return None if self.latest_pose is None else pose_at(stamp_ns)

    def push_tracks(
        self, tracks: StereoTracks, odometry: OdometryDelta | None = None, evidence: PoseEvidence | None = None
    ) -> FrameResult:
        self.pushed.append(tracks)
        self.odometry.append(odometry)
        self.evidence.append(evidence)
        self.frames += 1
        event = Event(tracks.stamp_ns, "vision_lost", "the image is dark")
        health = KeyframeHealth(tracks.stamp_ns, 1, 2, 3, 4, 0.5, 6, 0.007, 8.0)
        result = None
        if (self.frames - 1) % self.keyframes_every == 0:
            before_ns, self.keyframe_ns = self.keyframe_ns, tracks.stamp_ns
            result = None if self.result is None else self.result(tracks.stamp_ns, before_ns)
        if self.frames < 2 and self.start is None:
            return FrameResult(None, result, (event,), (health,))
        self.latest_pose = pose_at(tracks.stamp_ns)
        return FrameResult(state_at(tracks.stamp_ns), result, (event,), (health,))
