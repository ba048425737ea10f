# SPDX-License-Identifier: BSD-3-Clause
"""From frames to tracks, the same for every estimator with cameras: order of stamps, expected motion, pictures."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from coclo_vio.geometry import se3
from coclo_vio.values.arrays import Array, ByteImage
from coclo_vio.values.calibration import RectifiedStereo
from coclo_vio.values.keyframes import FrameResult, OdometryDelta, PoseEvidence, PoseMarginal
from coclo_vio.values.measurements import BodyTwistSample, InertialReading, StereoFrame, StereoTracks
from coclo_vio.values.outputs import Picture


class Frontend(Protocol):
    """What tracks points through stereo frames; ``frontend.frontend.StereoFrontend``."""

    rig: RectifiedStereo

    def track(self, frame: StereoFrame, T_previous_current: Array | None = None) -> StereoTracks:
        """The tracks of a frame; ``T_previous_current``: expected motion of the left camera since the last frame."""

    def overlay(self) -> ByteImage:
        """The last frame with its tracks drawn on it."""

    @property
    def counts(self) -> Mapping[str, int]:
        """How often each thing happened."""


class Smoother(Protocol):
    """What turns tracks into poses; ``backend.window.smoother.SlidingWindowSmoother``."""

    @property
    def latest_pose(self) -> Array | None:
        """``T_world_body`` of the last frame, (4, 4); None before the start."""

    @property
    def keyframe_ns(self) -> int | None:
        """Stamp of the last keyframe, where an ``OdometryDelta`` has to start."""

    @property
    def counts(self) -> Mapping[str, int]:
        """How often each thing happened."""

    def start_from(self, marginal: PoseMarginal, velocity: tuple[Array, float] | None = None) -> None:
        """Start with the frame of this stamp, and at this pose; velocity in m/s with its sigma, None at rest."""

    def begin_anew(self, detail: str, late_s: float) -> None:
        """The next frame begins a window; stamps of frames before it were late by so much against its own, s."""

    def push_imu(self, sample: InertialReading) -> None:
        """Take a reading, before the tracks of the frame that it leads to."""

    def push_twist(self, sample: BodyTwistSample) -> None:
        """Take a twist of the body, before the tracks of the frame that it leads to."""

    def predicted_pose(self, stamp_ns: int) -> Array | None:
        """``T_world_body`` expected at a stamp, (4, 4); None before the start."""

    def push_tracks(
        self, tracks: StereoTracks, odometry: OdometryDelta | None = None, evidence: PoseEvidence | None = None
    ) -> FrameResult:
        """What a frame comes to, with the motion since the last keyframe by another estimator, and what it knows."""


@dataclass(frozen=True, slots=True, eq=False)
class TrackedFrame:
    """A frame's tracks, and its picture where one was due.

    Attributes:
        tracks: of the frame.
        pictures: none or one.
    """

    tracks: StereoTracks
    pictures: tuple[Picture, ...] = ()


class VisionChain:
    """Turns frames into tracks; frames whose stamp does not pass the last one's are refused and counted."""

    def __init__(self, frontend: Frontend | None, pictures_every: int | None = None) -> None:
        """Take a front end.

        Args:
            frontend: a fresh one; None where a recording has tracks, not frames.
            pictures_every: draw the tracks on every n-th frame; on none if None.
        """
        self._frontend, self._pictures_every = frontend, pictures_every
        self._frame_ns: int | None = None
        self._counted: Counter[str] = Counter()

    @property
    def gives_pictures(self) -> bool:
        """Whether pictures were requested."""
        return self._pictures_every is not None

    @property
    def counts(self) -> Mapping[str, int]:
        """What was counted here and by the front end."""
        return {**self._counted, **prefixed("frontend", {} if self._frontend is None else self._frontend.counts)}

    def is_next(self, stamp_ns: int) -> bool:
        """Whether a frame of this stamp is later than the last one that was tracked."""
        if self._frame_ns is None or stamp_ns > self._frame_ns:
            return True
        self._counted["frame_stamp_refused"] += 1
        return False

    def track(
        self, frame: StereoFrame | StereoTracks, T_world_previous: Array | None, T_world_now: Array | None
    ) -> TrackedFrame | None:
        """The tracks of a frame; None where there are images and no front end.

        Args:
            frame: the next one.
            T_world_previous: pose of the body at the last frame, (4, 4), None if unknown.
            T_world_now: expected pose at this one, (4, 4), None if unknown.
        """
        if isinstance(frame, StereoTracks):
            self._frame_ns = frame.stamp_ns
            return TrackedFrame(frame)
        if self._frontend is None:
            self._counted["frame_without_frontend"] += 1
            return None
        self._frame_ns = frame.stamp_ns
        self._counted["frames"] += 1
        expected = None
        if T_world_previous is not None and T_world_now is not None:
            T_body_camera = self._frontend.rig.T_body_camera
            expected = np.asarray(se3.inverse(T_world_previous @ T_body_camera) @ T_world_now @ T_body_camera)
        tracks = self._frontend.track(frame, expected)
        every = self._pictures_every
        if every is None or (self._counted["frames"] - 1) % every:
            return TrackedFrame(tracks)
        return TrackedFrame(tracks, (Picture(frame.stamp_ns, self._frontend.overlay()),))


def prefixed(stage: str, counts: Mapping[str, int]) -> dict[str, int]:
    """Counts under the name of the stage that counted."""
    return {f"{stage}_{name}": number for name, number in counts.items()}
