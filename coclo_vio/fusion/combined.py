# SPDX-License-Identifier: BSD-3-Clause
"""Legs and eyes together (paper section IV): the filter's motion ties the smoother's keyframes, and what the eyes
know goes back into the filter. One measurement at a time; two trajectories come out.

A frame's pose is remembered in the filter at its stamp. What the eyes make of it comes back later (the latency) and is
taken at the remembered poses; everything since follows by its correlations, nothing is replayed.
"""

from collections import Counter, deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from coclo_vio.backend.window.config import SmootherConfig
from coclo_vio.filter.feedback import Outcome
from coclo_vio.filter.odometry import LegOdometryFilter
from coclo_vio.frontend.config import FrontendConfig
from coclo_vio.fusion import bridge
from coclo_vio.fusion.bridge import BridgeConfig
from coclo_vio.fusion.image_clock import ImageClock
from coclo_vio.fusion.visual_odometry import Frontend
from coclo_vio.geometry import se3
from coclo_vio.values.arrays import Array, ByteImage
from coclo_vio.values.calibration import StereoCalibration
from coclo_vio.values.errors import SmootherError
from coclo_vio.values.estimates import StateEstimate
from coclo_vio.values.keyframes import OdometryDelta, PoseEvidence, PoseMarginal, PosePair
from coclo_vio.values.measurements import (
    FootForceSample,
    ImuSample,
    JointSample,
    Measurement,
    StereoFrame,
    StereoTracks,
)
from coclo_vio.values.outputs import Event, KeyframeHealth
from coclo_vio.values.units import NS_PER_S

BY_LEGS, BY_EYES = "combined_coclo", "combined_vins"


class TiedSmoother(Protocol):
    """A smoother that takes somebody's word of the motion, and says what it knows itself."""

    @property
    def keyframe_ns(self) -> int | None:
        """Stamp of the last keyframe."""

    @property
    def marginal(self) -> PoseMarginal | None:
        """What is known of the last keyframe."""

    @property
    def evidence(self) -> PoseEvidence | None:
        """What the eyes know of the last two keyframes."""

    @property
    def counts(self) -> Mapping[str, int]:
        """How often each thing happened."""

    def start_from(self, belief: PoseMarginal) -> None:
        """Start with the frame of this stamp."""

    def push_tracks(
        self, tracks: StereoTracks, odometry: OdometryDelta | None = None, evidence: PoseEvidence | None = None
    ) -> StateEstimate | None:
        """The estimate of a frame."""

    def take_events(self) -> tuple[Event, ...]:
        """What happened since the last call."""

    def take_health(self) -> tuple[KeyframeHealth, ...]:
        """The keyframes since the last call."""


@dataclass(frozen=True, slots=True, eq=False)
class _Due:
    """A keyframe whose result is on its way to the filter.

    Attributes:
        at_ns: when it arrives.
        evidence: what it says; None where the filter hears nothing.
        widening: of the filter's sigmas where it is taken.
        whole: all that the eyes believe of the keyframe, for a filter that gives in.
    """

    at_ns: int
    evidence: PoseEvidence | None
    widening: float = 1.0
    whole: PoseEvidence | None = None


class CombinedOdometry:
    """The estimate of the legs, corrected by the eyes, at every joint sample; that of the eyes at every frame.

    ``push`` gives the former; ``take_others`` the latter, under its own name. Whichever of the two says nothing, the
    other carries on: without sight the filter runs alone and ties the first keyframe that sees again; legs that say
    nothing leave a wide tie, and the eyes hold. Frames before the filter has started are left out.

    Invariant: the filter remembers the smoother's last keyframe, and the frame that is being looked at.
    """

    name = BY_LEGS
    other_names = (BY_EYES,)

    def __init__(
        self,
        legs: LegOdometryFilter,
        smoother: TiedSmoother,
        frontend: Frontend | None,
        config: BridgeConfig | None = None,
        *,
        time_offset_s: float = 0.0,
    ) -> None:
        """Join the two.

        Args:
            legs: a fresh filter that remembers frames.
            smoother: a fresh one without an IMU.
            frontend: a fresh one; None where a recording has tracks, not frames.
            config: policy and latency.
            time_offset_s: stamp of a frame plus this is the clock of the legs, s.
        """
        self._legs, self._smoother, self._frontend = legs, smoother, frontend
        self.config = config or BridgeConfig()
        self._clock = ImageClock(time_offset_s, waits=True)
        self._latency_ns = round(self.config.vision_latency_s * NS_PER_S)
        self._known_by_eyes: PoseMarginal | None = None  # of the last keyframe, when it was one
        self._known_by_legs: PoseMarginal | None = None  # the same, once the eyes had told what they know
        self._seen: tuple[int, Array] | None = None  # stamp and pose of the last frame, by the filter
        self._due: _Due | None = None
        self._felt: StateEstimate | None = None  # the filter's last estimate
        self._answers: deque[StateEstimate] = deque()
        self._others: list[tuple[str, StateEstimate]] = []
        self._events: list[Event] = []
        self._counts: Counter[str] = Counter()
        self._show: tuple[int, Callable[[int, ByteImage], None]] | None = None

    @property
    def counts(self) -> Mapping[str, int]:
        """What was counted here, and by filter, front end and smoother."""
        seen = {} if self._frontend is None else self._frontend.counts
        return {
            **self._counts,
            **self._clock.counts,
            **self._legs.counts,
            **{f"frontend_{name}": number for name, number in seen.items()},
            **{f"smoother_{name}": number for name, number in self._smoother.counts.items()},
        }

    def push(self, measurement: Measurement) -> StateEstimate | None:
        """Take one measurement; the filter's estimate where it completes a joint sample.

        Raises:
            FilterError: the filter cannot go on, or the samples are of another robot.
            DatasetError: images of another size than was calibrated.
        """
        for due in self._clock.push(measurement):
            self._take(due)
        return self._answers.popleft() if self._answers else None

    def take_others(self) -> tuple[tuple[str, StateEstimate], ...]:
        """The eyes' estimates since the last call, with their name."""
        others, self._others = tuple(self._others), []
        return others

    def take_events(self) -> tuple[Event, ...]:
        """What happened since the last call."""
        events, self._events = (*self._events, *self._smoother.take_events()), []
        return events

    def take_health(self) -> tuple[KeyframeHealth, ...]:
        """The keyframes since the last call."""
        return self._smoother.take_health()

    def show(self, every: int, take: Callable[[int, ByteImage], None]) -> None:
        """From now on hand on the picture of every n-th frame with its stamp (ns), as far as there are images."""
        self._show = every, take

    def _take(self, measurement: Measurement) -> None:
        match measurement:
            case JointSample() | ImuSample() | FootForceSample():
                self._feed_back(measurement.stamp_ns)
                estimate = self._legs.push(measurement)
                if estimate is not None:
                    self._felt = estimate
                    self._answers.append(estimate)
            case StereoFrame() | StereoTracks():
                self._look(measurement)

    def _look(self, sight: StereoFrame | StereoTracks) -> None:
        """A frame: remember where the legs say it was taken, and see."""
        stamp_ns = sight.stamp_ns
        self._feed_back(stamp_ns)
        if not self._legs.has_started:
            self._counts["frame_before_start"] += 1
            return
        if self._seen is not None and stamp_ns <= self._seen[0]:
            self._counts["frame_stamp_refused"] += 1
            return
        if self._due is not None:
            self._counts["frame_while_busy"] += 1
            return
        before, self._seen = self._seen, (stamp_ns, self._legs.mark_frame(stamp_ns))
        tracks = self._tracked(sight, before, self._seen)
        if tracks is None:
            return
        if self._known_by_eyes is None:
            self._begin(tracks)
        else:
            self._tie(tracks, self._known_by_eyes)

    def _tracked(
        self, sight: StereoFrame | StereoTracks, before: tuple[int, Array] | None, now: tuple[int, Array]
    ) -> StereoTracks | None:
        if isinstance(sight, StereoTracks):
            return sight
        if self._frontend is None:
            self._counts["frame_without_frontend"] += 1
            return None
        self._counts["frames"] += 1
        expected = None
        if before is not None:
            T_body_camera = self._frontend.rig.T_body_camera
            expected = np.asarray(se3.inverse(before[1] @ T_body_camera) @ now[1] @ T_body_camera)
        tracks = self._frontend.track(sight, expected)
        if self._show is not None and (self._counts["frames"] - 1) % self._show[0] == 0:
            self._show[1](sight.stamp_ns, self._frontend.overlay())
        return tracks

    def _begin(self, tracks: StereoTracks) -> None:
        """The smoother's first keyframe: the anchor, from which both count."""
        self._smoother.start_from(PoseMarginal(tracks.stamp_ns, np.eye(4), np.zeros((6, 6))))
        estimate = self._smoother.push_tracks(tracks)
        self._legs.anchor_frame()
        self._answer(estimate)
        self._known_by_eyes = self._known_by_legs = self._smoother.marginal

    def _answer(self, estimate: StateEstimate | None) -> None:
        """Put an estimate of the smoother into the filter's world; rate, velocity and biases are the filter's own."""
        if estimate is None or self._felt is None:
            return
        covariance = np.zeros((9, 9))
        T_seen, seen_covariance = estimate.nav.T_world_body, estimate.covariance[:6, :6]
        T_world_body, covariance[:6, :6] = self._legs.placed(T_seen, seen_covariance)
        covariance[6:, 6:] = self._felt.covariance[6:, 6:]
        nav = replace(self._felt.nav, T_world_body=T_world_body)
        self._others.append((BY_EYES, replace(estimate, nav=nav, covariance=covariance)))

    def _tie(self, tracks: StereoTracks, known: PoseMarginal) -> None:
        """A frame after a keyframe: the filter's motion since then goes along."""
        pair = self._legs.frame_pair()
        told = self._told(pair) if self._exchanges else None
        self._answer(self._smoother.push_tracks(tracks, _motion(pair, self.config.floor_m), told))
        believed = self._smoother.marginal
        if believed is None or believed.stamp_ns != tracks.stamp_ns:
            return
        try:
            self._due = self._result(pair, known, believed)
        except SmootherError as error:
            self._due = _Due(believed.stamp_ns + self._latency_ns, None)
            self._events.append(Event(believed.stamp_ns, "nothing_to_say", str(error)))
        self._known_by_eyes = believed

    def _told(self, pair: PosePair) -> PoseEvidence | None:
        """What the legs tell the window; None where that cannot be worked out: their motion alone goes along then."""
        try:
            return bridge.legs_evidence(pair, self._known_by_legs, self.config)
        except SmootherError as error:
            self._events.append(Event(pair.end_ns, "nothing_to_say", str(error)))
            return None

    @property
    def _exchanges(self) -> bool:
        return self.config.feedback == "decorrelated"

    def _result(self, pair: PosePair, known: PoseMarginal, believed: PoseMarginal) -> _Due:
        """What the filter is told of a new keyframe, and when."""
        at_ns = believed.stamp_ns + self._latency_ns
        seen = self._smoother.evidence
        if self.config.feedback == "off" or seen is None:
            return _Due(at_ns, None)
        start = PoseMarginal(pair.start_ns, pair.T_world_start, pair.covariance[:6, :6])
        if self.config.feedback == "decorrelated":
            news = bridge.evidence_beyond(seen, known, self.config.min_novel_share)
            return _Due(at_ns, news, whole=bridge.of_end(start, believed))
        if self.config.feedback == "paper":
            return _Due(at_ns, bridge.of_end(start, believed))
        weight = bridge.intersection_weight(pair.covariance[6:, 6:], believed.covariance)
        return _Due(at_ns, bridge.of_end(start, believed, 1.0 - weight), float(weight**-0.5))

    def _feed_back(self, now_ns: int) -> None:
        """Give the filter the result that has arrived by now; its keyframe is the one to start from then."""
        due = self._due
        if due is None or now_ns < due.at_ns:
            return
        self._due = None
        if due.evidence is not None:
            verdict = self._legs.take_evidence(due.evidence, due.widening, due.whole)
            self._seen = due.evidence.end_ns, self._legs.frame_pose
            if verdict.outcome in {Outcome.REFUSED, Outcome.GAVE_IN}:
                detail = f"what the eyes say is {verdict.squared:.0f} where {verdict.rows} is expected; " + (
                    "not believed" if verdict.outcome is Outcome.REFUSED else "they insist: the filter gives in"
                )
                self._events.append(Event(due.evidence.end_ns, f"feedback_{verdict.outcome.value}", detail))
        self._known_by_legs = self._legs.frame_pair().end
        self._legs.keep_frame()


def _motion(pair: PosePair, floor_m: float) -> OdometryDelta:
    """The motion between two poses with the covariance of its right/local error, at least the floor."""
    T_start_end = se3.inverse(pair.T_world_start) @ pair.T_world_end
    jacobian = np.concatenate((-se3.adjoint(se3.inverse(T_start_end)), np.eye(6)), axis=1)
    covariance = jacobian @ pair.covariance @ jacobian.T + np.eye(6) * floor_m**2
    return OdometryDelta(pair.start_ns, pair.end_ns, T_start_end, covariance)


def combined_odometry(
    legs: LegOdometryFilter,
    stereo: StereoCalibration,
    frontend: FrontendConfig,
    smoother: SmootherConfig,
    config: BridgeConfig,
    *,
    has_frames: bool = True,
) -> CombinedOdometry:
    """The real front end and smoother with a filter, joined; loads OpenCV and GTSAM.

    Args:
        legs: a fresh filter that remembers frames.
        stereo: the cameras.
        frontend: parameters of the front end.
        smoother: parameters of the smoother.
        config: of the bridge.
        has_frames: whether there are images; otherwise tracks of rectified ones.

    Raises:
        ConfigError: cameras that cannot be rectified.
        CalibrationMissing: tracks, and cameras that are not rectified.
    """
    from coclo_vio.backend.window.smoother import SlidingWindowSmoother  # noqa: PLC0415 -- loads GTSAM
    from coclo_vio.frontend.frontend import StereoFrontend  # noqa: PLC0415 -- loads OpenCV
    from coclo_vio.values.calibration import RectifiedStereo  # noqa: PLC0415

    eyes = StereoFrontend(stereo, frontend) if has_frames else None
    rig = RectifiedStereo.of(stereo) if eyes is None else eyes.rig
    return CombinedOdometry(
        legs,
        SlidingWindowSmoother(rig, smoother, uses_imu=False),
        eyes,
        config,
        time_offset_s=stereo.time_offset_s,
    )
