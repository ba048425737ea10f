# SPDX-License-Identifier: BSD-3-Clause
"""What leg odometry and vision exchange at frames and keyframes, whoever processes the frames and whenever.

A frame's pose is remembered in the filter at its stamp. What vision finds comes back later and is taken at the
remembered poses; everything since follows by its correlations, nothing is replayed. ``CombinedOdometry`` decides by
stamps when a result is taken, ``CombinedBeside`` takes it once it is there.
"""

from collections.abc import Callable, Generator, Iterator, Mapping
from concurrent.futures import Future
from dataclasses import dataclass, replace
from typing import Generic, TypeVar

import numpy as np

from coclo_vio.filter.evidence_gate import GateOutcome, GateResult
from coclo_vio.filter.keyframe_exchange import FramePair, Keyframe, MarkedFrame
from coclo_vio.filter.odometry import LegOdometryFilter
from coclo_vio.fusion.config import BridgeConfig
from coclo_vio.fusion.continuation import Continuing
from coclo_vio.fusion.feedback import Feedback, make_feedback_policy
from coclo_vio.fusion.frame_processor import FrameJob, FrameProcessor, Processed
from coclo_vio.fusion.fused_estimates import FusedEstimates
from coclo_vio.fusion.image_clock import ImageClock
from coclo_vio.fusion.rotation_check import RotationCheck
from coclo_vio.fusion.rotation_monitor import RotationMonitor
from coclo_vio.fusion.streaming import StreamingEstimator
from coclo_vio.fusion.vision_chain import TrackedFrame
from coclo_vio.geometry import se3
from coclo_vio.values.arrays import Array
from coclo_vio.values.errors import SmootherError
from coclo_vio.values.estimates import StateEstimate
from coclo_vio.values.keyframes import (
    FrameResult,
    KeyframeResult,
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
    StereoFrame,
    StereoTracks,
)
from coclo_vio.values.outputs import Event, Innovation, Output

InWorld = Callable[[Array, Array], tuple[Array, Array]]
Frames = TypeVar("Frames", bound=FrameProcessor)


@dataclass(frozen=True, slots=True, eq=False)
class InProcess:
    """A frame after a keyframe, whose result has not been taken yet.

    Attributes:
        pair: the keyframe before and this frame, as the filter remembers them.
        poses: of the two when it was begun.
        latest: the filter's last estimate then.
        in_world: from the anchor to the filter's world as it was then.
        events: what happened before the frame was processed.
        processed: the result.
    """

    pair: FramePair
    poses: PosePair
    latest: StateEstimate
    in_world: InWorld
    events: tuple[Event, ...]
    processed: Future[Processed]


@dataclass(frozen=True, slots=True, eq=False)
class Pending:
    """A new keyframe whose result has not reached the filter yet.

    Attributes:
        pair: the keyframe before and this one, as the filter remembers them.
        feedback: what the filter gets; None for nothing.
    """

    pair: FramePair
    feedback: Feedback | None


class KeyframeBridge(Continuing, StreamingEstimator, Generic[Frames]):
    """The filter's estimate, corrected by vision, at every joint sample, and the smoother's at every frame.

    Where one of the two has no data, the other carries on: without vision the filter runs alone and ties the first
    keyframe that has landmarks again; without joint samples the tie is loose, and vision holds the pose. Frames before
    the filter has started are left out.

    Invariant: the filter remembers the window's last keyframe, and the frame that is being processed.
    """

    _holds_joints = True  # for frames that are stamped late, so that outputs depend on stamps alone

    def __init__(
        self,
        leg_filter: LegOdometryFilter,
        frames: Frames,
        config: BridgeConfig | None = None,
        *,
        outputs: FusedEstimates | None = None,
        check: RotationCheck | None = None,
        time_offset_s: float = 0.0,
        reports_innovations: bool = False,
    ) -> None:
        """Join the two.

        Args:
            leg_filter: a fresh filter that remembers frames.
            frames: processes frames; its smoother is a fresh one without an IMU.
            config: of the exchange.
            outputs: makes the estimates, a fresh one; with the names ``combined_coclo`` and ``combined_vins`` if None.
            check: a fresh comparison of rotations by cameras, gyroscope and legs; None for none.
            time_offset_s: stamp of a frame plus this is the clock of the joints and the body's IMU, s.
            reports_innovations: whether the innovation of each keyframe's evidence is an output.
        """
        super().__init__(ImageClock(time_offset_s, waits=True, holds_others=self._holds_joints))
        self.config = config or BridgeConfig()
        self._made = outputs or FusedEstimates("combined_coclo", "combined_vins")
        self._filter, self._frames = leg_filter, frames
        self._reports_innovations = reports_innovations
        self._policy = make_feedback_policy(self.config.feedback, self.config.policy_parameters)
        self._keyframe: Keyframe | None = None
        self._known_to_window: PoseMarginal | None = None  # of the last keyframe, once the window was solved
        self._known_to_both: PoseMarginal | None = None  # the same in the filter, once it had the window's evidence
        self._last_pose: Array | None = None  # of the last frame, in the filter's world
        self._latest: StateEstimate | None = None  # of the filter
        self._monitor = None if check is None else RotationMonitor(check, leg_filter)

    @property
    def counts(self) -> Mapping[str, int]:
        """What was counted here, and by filter, front end and smoother."""
        return {**super().counts, **self._frames.counts, **self._filter.counts}

    def _take_sample(self, sample: JointSample | ImuSample | CameraImuSample | FootForceSample) -> Iterator[Output]:
        """A sample of legs or IMUs goes to the filter."""
        if self._monitor is not None and not self._monitor.take(sample):
            self._counted["imu_set_aside"] += 1
            return
        state = self._filter.push(sample)
        if state is not None:
            self._latest = state
            if self._monitor is not None:
                self._monitor.follow(state)
            yield self._made.of_joints(state)
            yield from self._filter.take_events()

    def _submit_first(self, marked: MarkedFrame, frame: StereoFrame | StereoTracks) -> Future[Processed]:
        """The first frame: keyframe of the window, and anchor from which both count poses."""
        start = PoseMarginal(frame.stamp_ns, np.eye(4), np.zeros((6, 6)))
        return self._submit(frame, marked.T_world_body, start=start)

    def _anchor(self, marked: MarkedFrame, latest: StateEstimate, processed: Processed) -> Iterator[Output]:
        """The outputs of the first frame, once it is done."""
        if processed is None:
            return
        tracked, result = processed
        yield from tracked.pictures
        self._keyframe = marked.anchor()
        self._known_to_both = None if result.keyframe is None else result.keyframe.marginal
        self._known_to_window = self._known_to_both
        yield from self._outputs_of(result, latest, self._keyframe.in_world)

    def _submit(
        self,
        frame: StereoFrame | StereoTracks,
        T_world_body: Array,
        *,
        pair: tuple[PosePair, PoseEvidence | None] | None = None,
        start: PoseMarginal | None = None,
    ) -> Future[Processed]:
        """Have a frame processed whose pose is expected at ``T_world_body``, with its poses and the filter's evidence.

        ``start``: the window starts anew from there.
        """
        before, self._last_pose = self._last_pose, T_world_body
        motion = None if pair is None else relative_motion(pair[0], self.config.floor_m)
        evidence = None if pair is None else pair[1]
        return self._frames.submit(FrameJob(frame, before, T_world_body, motion, evidence, start))

    def _submit_pair(
        self, pair: FramePair, latest: StateEstimate, frame: StereoFrame | StereoTracks, in_world: InWorld
    ) -> InProcess:
        """A frame after a keyframe: the filter's motion since then goes to the window with the tracks."""
        poses = pair.poses()
        events: tuple[Event, ...] = ()
        evidence: PoseEvidence | None = None
        try:
            evidence = self._policy.evidence_for_window(poses, self._known_to_both)
        except SmootherError as error:
            events = (Event(poses.end_ns, "evidence_unavailable", str(error)),)
        processed = self._submit(frame, pair.T_world_body, pair=(poses, evidence))
        return InProcess(pair, poses, latest, in_world, events, processed)

    def _outputs_of_frame(self, frame: InProcess, tracked: TrackedFrame, result: FrameResult) -> Iterator[Output]:
        yield from tracked.pictures
        yield from frame.events
        yield from self._outputs_of(result, frame.latest, frame.in_world)

    def _pending(self, frame: InProcess, result: KeyframeResult) -> Generator[Event, None, Pending]:
        """The feedback of a new keyframe, before it reaches the filter."""
        feedback = None
        try:
            feedback = self._feedback(frame.poses, result)
        except SmootherError as error:
            yield Event(frame.pair.stamp_ns, "evidence_unavailable", str(error))
        self._known_to_window = result.marginal
        return Pending(frame.pair, feedback)

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

    def _correct_filter(self, pending: Pending) -> Iterator[Output]:
        """Correct the filter by a keyframe's result; motion is relative to that keyframe then."""
        pair, feedback = pending.pair, pending.feedback
        outcome = None
        if feedback is not None:
            may_force = self._monitor is None or self._monitor.is_for_vision
            gate = pair.correct(feedback.evidence, feedback.inflation, feedback.fallback, may_force=may_force)
            outcome = gate.outcome
            if self._reports_innovations:
                yield Innovation(pair.stamp_ns, "vision", gate.innovation_squared, gate.rows)
            self._last_pose = pair.T_world_body
            if outcome in {GateOutcome.REJECTED, GateOutcome.FORCED}:
                yield Event(pair.stamp_ns, f"feedback_{outcome.value}", _gate_sentence(gate, may_force))
        self._known_to_both = pair.poses().end
        self._keyframe = pair.keep()
        if outcome in {GateOutcome.ACCEPTED, GateOutcome.FORCED}:
            self._filter.learn_levels()
            yield self._filter.camera_calibration(pair.stamp_ns)

    def _outputs_of(self, result: FrameResult, latest: StateEstimate, in_world: InWorld) -> Iterator[Output]:
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
        in_window = se3.inverse(result.estimate.nav.T_world_body)
        yield from (snapshot.moved(T_world_body @ in_window) for snapshot in result.snapshots)
        covariance[6:, 6:] = latest.covariance[6:, 6:]
        nav = replace(latest.nav, T_world_body=T_world_body)
        yield self._made.of_frame(replace(result.estimate, nav=nav, covariance=covariance))


def _gate_sentence(gate: GateResult, may_force: bool) -> str:
    """What the gate measured, and what it did."""
    squared, rows = gate.innovation_squared, gate.rows
    measured = f"the evidence of vision has a squared innovation of {squared:.0f} where {rows} is expected"
    if gate.outcome is GateOutcome.REJECTED:
        against = "" if may_force else "; it is not forced, as no other sensor has confirmed vision"
        return f"{measured}; it was rejected{against}"
    return f"{measured}, after rejections in a row; the filter's covariance was inflated and the evidence accepted"
