# SPDX-License-Identifier: BSD-3-Clause
"""The exchange of keyframes with whoever processes camera frames, as objects that lead from one call to the next.

``LegOdometryFilter.mark_frame`` remembers the first frame; ``MarkedFrame.anchor`` makes it the keyframe from which
poses are counted; ``Keyframe.mark_frame`` pairs the keyframe with a later frame; ``FramePair`` gives their poses, takes
evidence on them, however late, and makes the frame the next keyframe. The filter remembers one keyframe and one frame:
an object that a later call replaced is void, and its methods raise FilterError. Where the state has a block for it
(``state_blocks.held_frame_block``), ``Keyframe.hold_frame`` remembers one frame more, which waits until the one before
it is processed, and ``Keyframe.mark_held`` pairs it.
"""

from collections.abc import Callable
from copy import deepcopy
from dataclasses import dataclass
from functools import partial

from coclo_vio.filter import remembered_poses
from coclo_vio.filter.evidence_gate import EvidenceGate, GateResult
from coclo_vio.filter.frame_motion import FrameMotion
from coclo_vio.filter.square_root_filter import SquareRootFilter
from coclo_vio.filter.state_blocks import ANCHOR, FRAME, HELD, KEYFRAME
from coclo_vio.values.arrays import Array
from coclo_vio.values.errors import FilterError
from coclo_vio.values.keyframes import PoseEvidence, PosePair


class KeyframeExchange:
    """The filter, and which objects stand for the keyframe and the frame that it remembers now.

    Args:
        core: the filter that has started.
        gate: of the evidence.
        motion_to: from a frame's stamp in nanoseconds to the motion from the last sample to it.
    """

    def __init__(self, core: SquareRootFilter, gate: EvidenceGate, motion_to: Callable[[int], FrameMotion]) -> None:
        self.core, self.gate = core, gate
        self._motion_to = motion_to
        self._keyframe: Keyframe | None = None
        self._frame: MarkedFrame | FramePair | None = None
        self._held: HeldFrame | None = None

    def first_frame(self, stamp_ns: int) -> "MarkedFrame":
        """Remember a frame without a keyframe; every earlier object is void."""
        self._remember(stamp_ns)
        self._keyframe = self._held = None
        self._frame = frame = MarkedFrame(self, stamp_ns)
        return frame

    def later_frame(self, keyframe: "Keyframe", stamp_ns: int) -> "FramePair":
        """Remember a frame after the keyframe; the earlier pair is void."""
        self._remember(stamp_ns)
        self._frame = pair = FramePair(self, keyframe.stamp_ns, stamp_ns)
        return pair

    def hold_frame(self, stamp_ns: int) -> "HeldFrame":
        """Remember a frame that waits; the earlier one that waited is void."""
        self._remember(stamp_ns, HELD)
        self._held = held = HeldFrame(stamp_ns)
        return held

    def held_frame(self, keyframe: "Keyframe", held: "HeldFrame") -> "FramePair":
        """The frame that waited becomes the frame after the keyframe; it and the earlier pair are void."""
        if held is not self._held:
            raise FilterError(
                f"the HeldFrame of {held.stamp_ns} ns is void: a later hold_frame(), mark_held() or mark_frame() "
                "replaced it; go on with the object that the later call returned"
            )
        self.core.copy_pose(HELD, FRAME)
        self._held = None
        self._frame = pair = FramePair(self, keyframe.stamp_ns, held.stamp_ns)
        return pair

    def keep_frame(self, stamp_ns: int) -> "Keyframe":
        """The frame becomes the keyframe; the objects of the frame and of the earlier keyframe are void."""
        self.core.copy_pose(FRAME, KEYFRAME)
        self._frame = None
        self._keyframe = keyframe = Keyframe(self, stamp_ns)
        return keyframe

    def core_of(self, handle: "MarkedFrame | Keyframe | FramePair") -> SquareRootFilter:
        """The filter, for an object that is not void.

        Raises:
            FilterError: a later call made the object void.
        """
        if handle is not self._keyframe and handle is not self._frame:
            raise FilterError(
                f"this {type(handle).__name__} of {handle.stamp_ns} ns is void: a later mark_frame(), anchor() or "
                "keep() replaced it; go on with the object that the later call returned"
            )
        return self.core

    def _remember(self, stamp_ns: int, name: str = FRAME) -> None:
        motion = self._motion_to(stamp_ns)
        self.core.mark_frame(motion.dt_s, motion.noise, motion.T_now_frame, name)


@dataclass(frozen=True, slots=True, eq=False)
class HeldFrame:
    """A frame whose pose is remembered while the one before it is processed.

    Attributes:
        stamp_ns: of the frame, in nanoseconds.
    """

    stamp_ns: int


class MarkedFrame:
    """The first frame, as long as there is no keyframe.

    Attributes:
        stamp_ns: of the frame, in nanoseconds.
    """

    def __init__(self, exchange: KeyframeExchange, stamp_ns: int) -> None:
        self._exchange = exchange
        self.stamp_ns = stamp_ns

    @property
    def T_world_body(self) -> Array:
        """Pose of the body at the frame as estimated now, (4, 4).

        Raises:
            FilterError: the object is void.
        """
        return remembered_poses.frame_pose(self._exchange.core_of(self).mean)

    def anchor(self) -> "Keyframe":
        """Make the frame the keyframe and the anchor: poses of pairs and evidence are relative to it.

        This object is void then.

        Raises:
            FilterError: the object is void.
        """
        self._exchange.core_of(self).copy_pose(FRAME, ANCHOR)
        return self._exchange.keep_frame(self.stamp_ns)


class Keyframe:
    """The keyframe that the filter remembers.

    Attributes:
        stamp_ns: of the keyframe, in nanoseconds.
    """

    def __init__(self, exchange: KeyframeExchange, stamp_ns: int) -> None:
        self._exchange = exchange
        self.stamp_ns = stamp_ns

    def mark_frame(self, stamp_ns: int) -> "FramePair":
        """Remember a later frame, at its own stamp between samples; the earlier pair of this keyframe is void.

        From the last sample on the body is predicted with constant rate and velocity.

        Raises:
            FilterError: the object is void.
        """
        self._exchange.core_of(self)
        return self._exchange.later_frame(self, stamp_ns)

    @property
    def can_hold(self) -> bool:
        """Whether the state has a block for a frame that waits."""
        return HELD in self._exchange.core.mean.layout.poses

    def hold_frame(self, stamp_ns: int) -> HeldFrame:
        """Remember a frame that waits while the one before it is processed, at its own stamp between samples.

        A frame that waited before is void.

        Raises:
            FilterError: the object is void, or the state has no block for such a frame.
        """
        self._exchange.core_of(self)
        return self._exchange.hold_frame(stamp_ns)

    def mark_held(self, held: HeldFrame) -> "FramePair":
        """The frame that waited, paired with this keyframe; the earlier pair of this keyframe is void.

        Raises:
            FilterError: the object or the frame is void.
        """
        self._exchange.core_of(self)
        return self._exchange.held_frame(self, held)

    def in_world(self, T_anchor_body: Array, covariance: Array) -> tuple[Array, Array]:
        """A pose that the cameras measure relative to the anchor, in the world of the filter.

        Args:
            T_anchor_body: the pose as measured, with the errors of the cameras' mounting and stereo scale, (4, 4).
            covariance: of its right/local error [rotation rad, position m], (6, 6).

        Returns:
            ``T_world_body``, (4, 4), and the covariance of its right/local error, (6, 6).

        Raises:
            FilterError: the object is void.
        """
        return remembered_poses.in_world(self._exchange.core_of(self), T_anchor_body, covariance)

    def in_world_of_now(self) -> Callable[[Array, Array], tuple[Array, Array]]:
        """``in_world`` as it is now, for a pose that is known later.

        Raises:
            FilterError: the object is void.
        """
        return partial(remembered_poses.in_world, deepcopy(self._exchange.core_of(self)))


class FramePair:
    """The keyframe and a later frame.

    Attributes:
        stamp_ns: of the frame, in nanoseconds.
        keyframe_ns: of the keyframe.
    """

    def __init__(self, exchange: KeyframeExchange, keyframe_ns: int, stamp_ns: int) -> None:
        self._exchange = exchange
        self.keyframe_ns = keyframe_ns
        self.stamp_ns = stamp_ns

    @property
    def T_world_body(self) -> Array:
        """Pose of the body at the frame as estimated now, (4, 4).

        Raises:
            FilterError: the object is void.
        """
        return remembered_poses.frame_pose(self._exchange.core_of(self).mean)

    def poses(self) -> PosePair:
        """Poses of keyframe and frame relative to the anchor as estimated now, as the cameras measure them.

        Raises:
            FilterError: the object is void.
        """
        return remembered_poses.frame_pair(self._exchange.core_of(self), self.keyframe_ns, self.stamp_ns)

    def correct(
        self,
        evidence: PoseEvidence,
        inflation: float = 1.0,
        fallback: PoseEvidence | None = None,
        *,
        may_force: bool = True,
    ) -> GateResult:
        """Correct the filter by evidence on the two poses, however late it comes, if its innovation passes the gate.

        Args:
            evidence: on the poses of keyframe and frame relative to the anchor.
            inflation: the filter's sigmas of rotation and positions are multiplied by this before the gate.
            fallback: all information of the other side, used instead where the correction is forced.
            may_force: whether evidence that was rejected several times in a row is accepted by force.

        Raises:
            FilterError: the object is void, or the evidence is of other stamps.
        """
        core = self._exchange.core_of(self)
        stamps_ns = (evidence.start_ns, evidence.end_ns)
        if stamps_ns != (self.keyframe_ns, self.stamp_ns):
            raise FilterError(
                f"evidence on {stamps_ns} ns does not belong to the pair of {(self.keyframe_ns, self.stamp_ns)} ns; "
                "take start_ns and end_ns from poses() of this pair"
            )
        core.inflate_poses(inflation)
        return self._exchange.gate.correct(core, evidence, fallback, may_force=may_force)

    def keep(self) -> Keyframe:
        """Make the frame the keyframe. This pair and its keyframe are void then.

        Raises:
            FilterError: the object is void.
        """
        self._exchange.core_of(self)
        return self._exchange.keep_frame(self.stamp_ns)
