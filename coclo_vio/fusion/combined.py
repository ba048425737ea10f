# SPDX-License-Identifier: BSD-3-Clause
"""Leg odometry and vision together (paper section IV): the filter's motion ties the smoother's keyframes, and the
window's evidence corrects the filter. One measurement at a time; two trajectories come out.

A frame's pose is remembered in the filter at its stamp. What vision finds comes back later (the latency) and is taken
at the remembered poses; everything since follows by its correlations, nothing is replayed. Until then the frame may be
processed in another thread: its outputs come with the first measurement whose stamp is past the latency, or with the
next frame, whether there is a thread or not.
"""

from collections.abc import Callable, Generator, Iterator, Mapping
from concurrent.futures import Future, wait
from dataclasses import dataclass, replace

import numpy as np

from coclo_vio.backend.window.config import SmootherConfig
from coclo_vio.filter.evidence_gate import GateOutcome, GateResult
from coclo_vio.filter.keyframe_exchange import FramePair, Keyframe, MarkedFrame
from coclo_vio.filter.odometry import LegOdometryFilter
from coclo_vio.frontend.config import FrontendConfig
from coclo_vio.fusion.config import BridgeConfig
from coclo_vio.fusion.feedback import Feedback, make_feedback_policy
from coclo_vio.fusion.frame_worker import FrameWorker
from coclo_vio.fusion.image_clock import ImageClock
from coclo_vio.fusion.rotation_check import RotationCheck
from coclo_vio.fusion.rotation_monitor import RotationMonitor
from coclo_vio.fusion.streaming import StreamingEstimator
from coclo_vio.fusion.vision_chain import Frontend, Smoother, TrackedFrame, VisionChain, prefixed
from coclo_vio.fusion.visual_odometry import stereo_stages
from coclo_vio.values.arrays import Array
from coclo_vio.values.calibration import StereoCalibration
from coclo_vio.values.errors import SmootherError
from coclo_vio.values.estimates import StateEstimate
from coclo_vio.values.keyframes import (
    FrameResult,
    KeyframeResult,
    OdometryDelta,
    PoseEvidence,
    PoseMarginal,
    PosePair,
    relative_motion,
)
from coclo_vio.values.measurements import (
    CameraImuSample,
    FootForceSample,
    ImuSample,
    JointSample,
    Measurement,
    StereoFrame,
    StereoTracks,
)
from coclo_vio.values.outputs import Estimate, Event, Output
from coclo_vio.values.units import NS_PER_S

_InWorld = Callable[[Array, Array], tuple[Array, Array]]
_Processed = tuple[TrackedFrame, FrameResult] | None  # None where there is no front end


@dataclass(frozen=True, slots=True, eq=False)
class _InProcess:
    """A frame whose result has not been taken yet.

    Attributes:
        at_ns: when it is taken at the latest.
        pair: the keyframe before and this frame, as the filter remembers them.
        poses: of the two when the frame came.
        latest: the filter's last estimate then.
        in_world: from the anchor to the filter's world as it was then.
        events: what happened before the frame was processed.
        processed: the result.
    """

    at_ns: int
    pair: FramePair
    poses: PosePair
    latest: StateEstimate
    in_world: _InWorld
    events: tuple[Event, ...]
    processed: Future[_Processed]


@dataclass(frozen=True, slots=True, eq=False)
class _Pending:
    """A new keyframe whose result has not reached the filter yet.

    Attributes:
        at_ns: when it arrives.
        pair: the keyframe before and this one, as the filter remembers them.
        feedback: what the filter gets; None for nothing.
    """

    at_ns: int
    pair: FramePair
    feedback: Feedback | None


class CombinedOdometry(StreamingEstimator):
    """The filter's estimate, corrected by vision, at every joint sample, and the smoother's at every frame.

    Where one of the two has no data, the other carries on: without vision the filter runs alone and ties the first
    keyframe that has landmarks again; without joint samples the tie is loose, and vision holds the pose. Frames before
    the filter has started are left out.

    Invariant: the filter remembers the window's last keyframe, and the frame that is being processed.
    """

    def __init__(
        self,
        leg_filter: LegOdometryFilter,
        smoother: Smoother,
        frontend: Frontend | None,
        config: BridgeConfig | None = None,
        *,
        names: tuple[str, str] = ("combined_coclo", "combined_vins"),
        check: RotationCheck | None = None,
        time_offset_s: float = 0.0,
        pictures_every: int | None = None,
    ) -> None:
        """Join the two.

        Args:
            leg_filter: a fresh filter that remembers frames.
            smoother: a fresh one without an IMU.
            frontend: a fresh one; None where a recording has tracks, not frames.
            config: policy and latency.
            names: of the filter's trajectory and of the smoother's.
            check: a fresh comparison of rotations by cameras, gyroscope and legs; None for none.
            time_offset_s: stamp of a frame plus this is the clock of the joints and the body's IMU, s.
            pictures_every: draw the tracks on every n-th frame; on none if None.
        """
        super().__init__(ImageClock(time_offset_s, waits=True))
        self.config = config or BridgeConfig()
        self._filter_name, self._smoother_name = names
        self._filter, self._smoother = leg_filter, smoother
        self._vision = VisionChain(frontend, pictures_every)
        self._policy = make_feedback_policy(self.config.feedback, self.config.policy_parameters)
        self._latency_ns = round(self.config.vision_latency_s * NS_PER_S)
        self._keyframe: Keyframe | None = None
        self._known_to_window: PoseMarginal | None = None  # of the last keyframe, once the window was solved
        self._known_to_both: PoseMarginal | None = None  # the same in the filter, once it had the window's evidence
        self._last_pose: Array | None = None  # of the last frame, in the filter's world
        self._worker = FrameWorker(self.config.frame_threads)
        self._in_process: _InProcess | None = None
        self._pending: _Pending | None = None
        self._latest: StateEstimate | None = None  # of the filter
        self._monitor = None if check is None else RotationMonitor(check, leg_filter)

    @property
    def counts(self) -> Mapping[str, int]:
        """What was counted here, and by filter, front end and smoother, once the frame in process is done."""
        self.settle()
        return {
            **super().counts,
            **self._vision.counts,
            **self._filter.counts,
            **prefixed("smoother", self._smoother.counts),
        }

    def settle(self) -> None:
        """Wait for the frame that is processed beside the filter, whose result is taken when it is due all the same."""
        if self._in_process is not None:
            wait([self._in_process.processed])

    def _end(self) -> Iterator[Output]:
        """The results of the last frame and of the last keyframe, which no later measurement fetches."""
        yield from self._take_result()
        if self._pending is not None:
            yield from self._correct_filter(self._pending.at_ns)
        self._worker.close()

    def _process(self, measurement: Measurement) -> Iterator[Output]:
        match measurement:
            case JointSample() | ImuSample() | CameraImuSample() | FootForceSample():
                yield from self._take_what_is_due(measurement.stamp_ns)
                state = self._filter.push(measurement)
                if self._monitor is not None:
                    self._monitor.take(measurement)
                if state is not None:
                    self._latest = state
                    if self._monitor is not None:
                        self._monitor.follow(state)
                    yield Estimate(self._filter_name, state)
                    yield from self._filter.take_events()
            case StereoFrame() | StereoTracks():
                yield from self._take_what_is_due(measurement.stamp_ns)
                yield from self._take_result()
                yield from self._process_frame(measurement)

    def _process_frame(self, frame: StereoFrame | StereoTracks) -> Iterator[Output]:
        """Remember in the filter where the frame was taken, track it, and give the tracks to the window."""
        if not self._filter.has_started:
            self._counted["frame_before_start"] += 1
            return
        if not self._vision.is_next(frame.stamp_ns):
            return
        if self._is_too_late(frame.stamp_ns):
            self._counted["frame_late"] += 1
            return
        if self._pending is not None:
            self._counted["frame_while_busy"] += 1
            return
        if self._keyframe is None:
            yield from self._begin(self._filter.mark_frame(frame.stamp_ns), frame)
        elif self._latest is not None:
            yield from self._tie(self._keyframe, self._latest, frame)

    def _is_too_late(self, stamp_ns: int) -> bool:
        """Whether the filter has passed the frame's stamp by more than constant velocity reaches back."""
        if self._latest is None:
            return False
        return (self._latest.stamp_ns - stamp_ns) / NS_PER_S > self._filter.config.max_gap_s

    def _begin(self, marked: MarkedFrame, frame: StereoFrame | StereoTracks) -> Iterator[Output]:
        """The first frame: keyframe of the window, and anchor from which both count poses."""
        self._smoother.start_from(PoseMarginal(frame.stamp_ns, np.eye(4), np.zeros((6, 6))))
        processed = self._submit(frame, marked.T_world_body).result()
        if processed is None or self._latest is None:
            return
        tracked, result = processed
        yield from tracked.pictures
        self._keyframe = marked.anchor()
        self._known_to_both = None if result.keyframe is None else result.keyframe.marginal
        self._known_to_window = self._known_to_both
        yield from self._outputs_of(result, self._latest, self._keyframe.in_world)

    def _submit(
        self,
        frame: StereoFrame | StereoTracks,
        T_world_body: Array,
        odometry: OdometryDelta | None = None,
        evidence: PoseEvidence | None = None,
    ) -> Future[_Processed]:
        """Track a frame, whose pose is expected at ``T_world_body``, and give the tracks to the window."""
        before, self._last_pose = self._last_pose, T_world_body

        def process() -> _Processed:
            tracked = self._vision.track(frame, before, T_world_body)
            return (
                None if tracked is None else (tracked, self._smoother.push_tracks(tracked.tracks, odometry, evidence))
            )

        return self._worker.submit(process)

    def _tie(self, keyframe: Keyframe, latest: StateEstimate, frame: StereoFrame | StereoTracks) -> Iterator[Output]:
        """A frame after a keyframe: the filter's motion since then goes to the window with the tracks."""
        pair = keyframe.mark_frame(frame.stamp_ns)
        poses = pair.poses()
        events: tuple[Event, ...] = ()
        evidence: PoseEvidence | None = None
        try:
            evidence = self._policy.evidence_for_window(poses, self._known_to_both)
        except SmootherError as error:
            events = (Event(poses.end_ns, "evidence_unavailable", str(error)),)
        motion = relative_motion(poses, self.config.floor_m)
        in_world = keyframe.in_world_of_now() if self._latency_ns else keyframe.in_world
        processed = self._submit(frame, pair.T_world_body, motion, evidence)
        at_ns = frame.stamp_ns + self._latency_ns
        self._in_process = _InProcess(at_ns, pair, poses, latest, in_world, events, processed)
        if not self._latency_ns:
            yield from self._take_result()

    def _take_what_is_due(self, now_ns: int) -> Iterator[Output]:
        if self._in_process is not None and now_ns >= self._in_process.at_ns:
            yield from self._take_result()
        yield from self._correct_filter(now_ns)

    def _take_result(self) -> Iterator[Output]:
        """The outputs of the frame in process, once it is done; where it is a keyframe, the filter gets feedback."""
        frame, self._in_process = self._in_process, None
        if frame is None:
            return
        processed = frame.processed.result()
        if processed is None:
            return
        tracked, result = processed
        yield from tracked.pictures
        yield from frame.events
        yield from self._outputs_of(result, frame.latest, frame.in_world)
        if (yield from self._is_revised(tracked)) or result.keyframe is None:
            return
        feedback = None
        try:
            feedback = self._feedback(frame.poses, result.keyframe)
        except SmootherError as error:
            yield Event(frame.pair.stamp_ns, "evidence_unavailable", str(error))
        self._pending = _Pending(frame.at_ns, frame.pair, feedback)
        self._known_to_window = result.keyframe.marginal

    def _is_revised(self, tracked: TrackedFrame) -> Generator[Event, None, bool]:
        """Compare rotations by the frame, and act on what is found; whether the next frame starts a window anew."""
        revision = None if self._monitor is None else self._monitor.compare(tracked.tracks)
        if revision is None:
            return False
        yield revision.event
        if revision.mounting is not None:
            self._filter.revise_mounting(revision.mounting)
        self._clock.shift(-revision.delay_s)
        if revision.is_anew:
            self._keyframe = None
        return revision.is_anew

    def _feedback(self, poses: PosePair, result: KeyframeResult) -> Feedback | None:
        known = self._known_to_window
        if result.evidence is None or known is None:
            return None
        return self._policy.feedback_for_filter(poses, known, result)

    def _correct_filter(self, now_ns: int) -> Iterator[Output]:
        """Correct the filter by a keyframe's result that has arrived; motion is relative to that keyframe then."""
        pending = self._pending
        if pending is None or now_ns < pending.at_ns:
            return
        self._pending = None
        pair, feedback = pending.pair, pending.feedback
        outcome = None
        if feedback is not None:
            gate = pair.correct(feedback.evidence, feedback.inflation, feedback.fallback)
            outcome = gate.outcome
            self._last_pose = pair.T_world_body
            if outcome in {GateOutcome.REJECTED, GateOutcome.FORCED}:
                yield Event(pair.stamp_ns, f"feedback_{outcome.value}", _gate_sentence(gate))
        self._known_to_both = pair.poses().end
        self._keyframe = pair.keep()
        if outcome in {GateOutcome.ACCEPTED, GateOutcome.FORCED}:
            self._filter.learn_levels()
            yield self._filter.camera_calibration(pair.stamp_ns)

    def _outputs_of(self, result: FrameResult, latest: StateEstimate, in_world: _InWorld) -> Iterator[Output]:
        """What the window gives for a frame, its pose moved to the filter's world.

        Angular velocity, velocity and biases of the estimate are the filter's.
        """
        yield from result.events
        yield from result.health
        if result.estimate is None:
            return
        covariance = np.zeros((9, 9))
        T_world_body, covariance[:6, :6] = in_world(
            result.estimate.nav.T_world_body, result.estimate.covariance[:6, :6]
        )
        covariance[6:, 6:] = latest.covariance[6:, 6:]
        nav = replace(latest.nav, T_world_body=T_world_body)
        yield Estimate(self._smoother_name, replace(result.estimate, nav=nav, covariance=covariance))


def _gate_sentence(gate: GateResult) -> str:
    """What the gate measured, and what it did."""
    squared, rows = gate.innovation_squared, gate.rows
    measured = f"the evidence of vision has a squared innovation of {squared:.0f} where {rows} is expected"
    if gate.outcome is GateOutcome.REJECTED:
        return f"{measured}; it was rejected"
    return f"{measured}, after rejections in a row; the filter's covariance was inflated and the evidence accepted"


def combined_odometry(
    leg_filter: LegOdometryFilter,
    stereo: StereoCalibration,
    frontend: FrontendConfig,
    smoother: SmootherConfig,
    config: BridgeConfig,
    *,
    has_frames: bool = True,
    pictures_every: int | None = None,
) -> CombinedOdometry:
    """The real front end and smoother with a filter, joined; loads OpenCV and GTSAM.

    Args:
        leg_filter: a fresh filter that remembers frames.
        stereo: the cameras.
        frontend: parameters of the front end.
        smoother: parameters of the smoother.
        config: of the bridge.
        has_frames: whether there are images; otherwise tracks of rectified ones.
        pictures_every: draw the tracks on every n-th frame; on none if None.

    Raises:
        ConfigError: cameras that cannot be rectified.
        CalibrationMissing: tracks, and cameras that are not rectified.
    """
    from coclo_vio.backend.window.smoother import SlidingWindowSmoother  # noqa: PLC0415 -- loads GTSAM

    stages, rig = stereo_stages(stereo, frontend, has_frames=has_frames)
    return CombinedOdometry(
        leg_filter,
        SlidingWindowSmoother(rig, smoother),
        stages,
        config,
        check=RotationCheck(rig, leg_filter.imu_rotation),
        time_offset_s=stereo.time_offset_s,
        pictures_every=pictures_every,
    )
