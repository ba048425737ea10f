# SPDX-License-Identifier: BSD-3-Clause
"""The one stream that comes out of an estimator: estimates, events, keyframe health, calibration, status, and more.

Pictures, snapshots of the window and innovations come only where they were requested.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Protocol, runtime_checkable

import numpy as np

from coclo_vio.values.arrays import Array, ByteImage, checked, frozen, read_only
from coclo_vio.values.estimates import StateEstimate
from coclo_vio.values.measurements import Measurement


@dataclass(frozen=True, slots=True, eq=False)
class Estimate:
    """A state estimate of one of an estimator's trajectories.

    Attributes:
        name: of the trajectory, such as ``combined_coclo``.
        state: pose, velocity, biases and covariance at one time.
    """

    name: str
    state: StateEstimate


@dataclass(frozen=True, slots=True)
class Event:
    """An unusual condition that an estimator reports.

    Attributes:
        stamp_ns: when, in nanoseconds.
        kind: name of the condition, such as ``vision_lost`` or ``window_restart``.
        detail: a sentence: what was observed, and what the estimator did.
    """

    stamp_ns: int
    kind: str
    detail: str


@dataclass(frozen=True, slots=True)
class SlipEvent(Event):
    """A foot slid while its contact was in stance; ``stamp_ns`` is its beginning.

    Attributes:
        foot: name of the leg.
        duration_s: s.
        distance_m: along the ground, m.
    """

    foot: str
    duration_s: float
    distance_m: float


@dataclass(frozen=True, slots=True)
class ClockStepEvent(Event):
    """The clock of all streams has stepped; ``stamp_ns`` is the first stamp after it.

    Attributes:
        at_ns: the same moment by the clock that the estimator began with, in nanoseconds.
        step_ns: new clock less old one, in nanoseconds.
    """

    at_ns: int
    step_ns: int


@dataclass(frozen=True, slots=True)
class KeyframeHealth:
    """The state of a sliding window at one keyframe.

    Attributes:
        stamp_ns: of the keyframe, in nanoseconds.
        keyframes: in the window.
        tracks: points of the frame that were matched to landmarks.
        landmarks: in the window.
        factors: of the whole problem.
        reprojection_px: root mean square of what is left of the window's stereo residuals, px.
        iterations: of the solver.
        compute_s: processor time of this keyframe, s.
        condition: of the newest keyframe's pose covariance: longest by shortest axis, in the solver's units.
    """

    stamp_ns: int
    keyframes: int
    tracks: int
    landmarks: int
    factors: int
    reprojection_px: float
    iterations: int
    compute_s: float
    condition: float


@dataclass(frozen=True, slots=True, eq=False)
class Calibration:
    """What an estimator has learnt of the cameras, relative to their calibration in the recording.

    Attributes:
        stamp_ns: the estimate is of this time, in nanoseconds.
        rotation_body: turn of the cameras against their recorded mounting, rotation vector, rad, body frame, (3,).
        rotation_sigma: one sigma of it by axis, rad, (3,).
        stereo_scale: factor on distances measured by stereo; 1 where the baseline is as recorded.
        stereo_scale_sigma: one sigma of it.
    """

    stamp_ns: int
    rotation_body: Array
    rotation_sigma: Array
    stereo_scale: float
    stereo_scale_sigma: float

    def __post_init__(self) -> None:
        for name in ("rotation_body", "rotation_sigma"):
            frozen(self, name, checked(f"Calibration.{name}", getattr(self, name), (3,)))


@dataclass(frozen=True, slots=True, eq=False)
class Picture:
    """An image of a frame with its tracks drawn on it.

    Attributes:
        stamp_ns: of the frame, in nanoseconds.
        image: (rows, columns, 3), blue, green, red, uint8.
    """

    stamp_ns: int
    image: ByteImage

    def __post_init__(self) -> None:
        frozen(self, "image", read_only(self.image))


@dataclass(frozen=True, slots=True)
class StreamStatus:
    """What became of the samples of one stream: ``arrived == used + held + sum(refused.values())``.

    Attributes:
        name: of the stream, such as ``joints``.
        arrived: samples pushed.
        used: samples that the estimator got.
        late: of these, samples that came after a later one of another stream had been used.
        held: samples that wait for others, or are in doubt.
        refused: samples that the estimator did not get, by reason.
    """

    name: str
    arrived: int
    used: int
    late: int = 0
    held: int = 0
    refused: Mapping[str, int] = field(default_factory=dict)

    def __str__(self) -> str:
        parts = [f"{self.name}: used {self.used} of {self.arrived}"]
        parts += [f"{number} {reason}" for reason, number in (("late", self.late), ("held", self.held)) if number]
        return ", ".join([*parts, *(f"{number} refused ({reason})" for reason, number in self.refused.items())])


@dataclass(frozen=True, slots=True)
class Status:
    """What became of all samples so far.

    Attributes:
        stamp_ns: of the newest sample used, in nanoseconds, by the clock of the outputs.
        streams: one each.
    """

    stamp_ns: int
    streams: tuple[StreamStatus, ...]

    def __str__(self) -> str:
        return "; ".join(map(str, self.streams))


@dataclass(frozen=True, slots=True, eq=False)
class WindowSnapshot:
    """Keyframes and landmarks of a sliding window after a keyframe, on request.

    Attributes:
        stamp_ns: of the newest keyframe, in nanoseconds.
        T_world_keyframes: poses of the body at the keyframes, the oldest first, (K, 4, 4).
        landmarks_world: positions, m, world frame, (L, 3).
    """

    stamp_ns: int
    T_world_keyframes: Array
    landmarks_world: Array

    def __post_init__(self) -> None:
        poses = checked("WindowSnapshot.T_world_keyframes", self.T_world_keyframes, (None, 4, 4))
        frozen(self, "T_world_keyframes", poses)
        points = checked("WindowSnapshot.landmarks_world", self.landmarks_world, (None, 3))
        frozen(self, "landmarks_world", points)

    def moved(self, T_new_world: Array) -> "WindowSnapshot":
        """The same in another world frame."""
        points = self.landmarks_world @ T_new_world[:3, :3].T + T_new_world[:3, 3]
        return WindowSnapshot(self.stamp_ns, np.asarray(T_new_world @ self.T_world_keyframes), points)


@dataclass(frozen=True, slots=True)
class Innovation:
    """How far measurements were from what a filter expected of them, on request.

    Attributes:
        stamp_ns: of the measurements, in nanoseconds.
        source: of the measurements: ``legs`` (with the IMU), or ``vision``.
        squared: normalised innovation squared; of a consistent filter chi-square distributed.
        rows: its degrees of freedom.
    """

    stamp_ns: int
    source: str
    squared: float
    rows: int


Output = Estimate | Event | KeyframeHealth | Calibration | Picture | Status | WindowSnapshot | Innovation


class Estimator(Protocol):
    """Anything that turns measurements into outputs, one at a time, online.

    Outputs of ``push`` and ``finish`` have to be taken, all of them: an estimator may work them out as they are taken.
    """

    def push(self, measurement: Measurement) -> Iterable[Output]:
        """Take one measurement; the outputs that it leads to, in order.

        Raises:
            CocloError: the estimator cannot go on.
        """

    def finish(self) -> Iterable[Output]:
        """The outputs of what is still held back, once no measurement comes any more.

        Raises:
            CocloError: the estimator cannot go on.
        """

    @property
    def counts(self) -> Mapping[str, int]:
        """How often each unusual thing happened: samples refused, legs left out, gaps, rejections, standstills."""


@runtime_checkable
class Interruptible(Protocol):
    """An estimator that can go on after an interruption of unknown length."""

    def interrupt(self, gap_sigma_s: float) -> bool:
        """An unknown time passes before the next measurement; whether the estimates to come allow for it.

        Args:
            gap_sigma_s: one sigma of that time beyond what the stamps say, s.
        """


@runtime_checkable
class Settling(Protocol):
    """An estimator with work in another thread, which may change it between two measurements."""

    def settle(self) -> None:
        """Wait until nothing changes the estimator but its next measurement."""


@runtime_checkable
class Learning(Protocol):
    """An estimator that learns constants which a fresh one can take over."""

    @property
    def learnt(self) -> Mapping[str, tuple[Array, Array]]:
        """Value and one sigma of each constant, by name."""

    def start_with(self, learnt: Mapping[str, tuple[Array, Array]]) -> None:
        """Start with what an earlier estimator has learnt; before the first measurement."""
