# SPDX-License-Identifier: BSD-3-Clause
"""Leg odometry and vision together where joints never wait: frames are processed beside the filter, in a process.

A result is taken with the first measurement after it is there, and applied at the frame's stamp, where the filter
remembers the pose. So outputs depend on computing time, a little: for use online. What a result leads to in the filter
is done in pieces, one a measurement. While a frame is in process the next one waits, its pose remembered at its stamp;
where a further one comes, the one that waited is left out.
"""

import time
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from functools import partial

from coclo_vio.backend.window.config import SmootherConfig
from coclo_vio.filter.keyframe_exchange import HeldFrame, Keyframe, MarkedFrame
from coclo_vio.filter.odometry import LegOdometryFilter
from coclo_vio.frontend.config import FrontendConfig
from coclo_vio.fusion.config import BridgeConfig
from coclo_vio.fusion.frame_processor import Processed, VisionStages
from coclo_vio.fusion.fused_estimates import FusedEstimates
from coclo_vio.fusion.keyframe_bridge import InProcess, KeyframeBridge, Pending
from coclo_vio.fusion.overload import ImageOverload
from coclo_vio.fusion.rotation_check import RotationCheck
from coclo_vio.fusion.vision_chain import TrackedFrame, VisionChain
from coclo_vio.fusion.vision_process import VisionProcess
from coclo_vio.fusion.vision_warm_up import warm_up
from coclo_vio.fusion.visual_odometry import stereo_stages
from coclo_vio.values.calibration import RectifiedStereo, StereoCalibration
from coclo_vio.values.estimates import StateEstimate
from coclo_vio.values.keyframes import FrameResult
from coclo_vio.values.measurements import (
    CameraImuSample,
    FootForceSample,
    ImuSample,
    JointSample,
    Measurement,
    StereoFrame,
    StereoTracks,
)
from coclo_vio.values.outputs import Event, Output

_AGAIN_WITHIN_S = 60.0  # a process that fails again so soon is not started a second time
_AT_THE_END_S = 0.05  # how long one look for a result may wait, once no measurement comes any more

_Image = StereoFrame | StereoTracks
_Piece = Callable[[], Iterator[Output]]


class CombinedBeside(KeyframeBridge[VisionProcess]):
    """The bridge with frames processed by another process, whose results are taken as they come.

    Invariant: at most one frame is in process, and at most one waits.
    """

    _holds_joints = False  # a frame of the past is as good

    def __init__(
        self,
        leg_filter: LegOdometryFilter,
        process: VisionProcess,
        config: BridgeConfig | None = None,
        *,
        outputs: FusedEstimates | None = None,
        check: RotationCheck | None = None,
        time_offset_s: float = 0.0,
        reports_innovations: bool = False,
    ) -> None:
        """Join the two.

        Args:
            leg_filter: a fresh filter that remembers frames; with ``held_frame_block`` one frame can wait.
            process: of the vision.
            config: of the exchange.
            outputs: makes the estimates, a fresh one; with the names ``combined_coclo`` and ``combined_vins`` if None.
            check: a fresh comparison of rotations by cameras, gyroscope and legs; None for none.
            time_offset_s: stamp of a frame plus this is the clock of the joints and the body's IMU, s.
            reports_innovations: whether the innovation of each keyframe's evidence is an output.
        """
        super().__init__(
            leg_filter,
            process,
            config,
            outputs=outputs,
            check=check,
            time_offset_s=time_offset_s,
            reports_innovations=reports_innovations,
        )
        self._first: tuple[MarkedFrame, Future[Processed]] | None = None  # in process, and begins a window
        self._in_process: InProcess | None = None
        self._waiting: tuple[HeldFrame, _Image, StateEstimate] | None = None  # and the filter's last estimate then
        self._pieces: deque[_Piece] = deque()  # that a result has left to do
        self._overload = ImageOverload("images come faster than vision processes them")
        self._frame_ns: int | None = None
        self._now_ns = 0
        self._failure: str | None = None  # of the process, until an event says so
        self._restarted_s: float | None = None
        self._is_stopped = False  # vision failed too often

    @property
    def vision_pid(self) -> int | None:
        """Number of the process of vision; None where there is none."""
        return self._frames.pid

    def prepare(self, within_s: float = 120.0) -> None:
        """Wait, at most so long, until the process of vision has loaded; frames that come before are left out."""
        end_s = time.monotonic() + within_s
        while not self._frames.is_ready and not self._has_work and self._failure is None:
            left_s = end_s - time.monotonic()
            if left_s <= 0.0:
                return
            self._failure = self._frames.poll(min(left_s, 1.0))

    @property
    def _has_work(self) -> bool:
        return self._first is not None or self._in_process is not None or bool(self._pieces)

    def _process(self, measurement: Measurement) -> Iterator[Output]:
        self._now_ns = measurement.stamp_ns
        yield from self._follow_vision()
        match measurement:
            case StereoFrame() | StereoTracks():
                yield from self._take_frame(measurement)
            case JointSample() | ImuSample() | CameraImuSample() | FootForceSample():
                yield from self._take_sample(measurement)

    def _end(self) -> Iterator[Output]:
        """The results of the frames that are in process or wait."""
        while not self._is_stopped and (self._has_work or self._waiting is not None):
            yield from self._follow_vision(_AT_THE_END_S)
        self._frames.close()

    def _follow_vision(self, wait_s: float = 0.0) -> Iterator[Output]:
        """Take the next piece of what vision gives."""
        if self._pieces:
            yield from self._pieces.popleft()()
            return
        failure, self._failure = self._failure or self._frames.poll(wait_s), None
        if failure is not None:
            yield from self._start_anew(failure)
        elif self._first is not None and self._first[1].done():
            (marked, future), self._first = self._first, None
            if self._latest is not None:
                yield from self._anchor(marked, self._latest, future.result())
        elif self._in_process is not None and self._in_process.processed.done():
            frame, self._in_process = self._in_process, None
            yield from self._take_result(frame, frame.processed.result())
        elif self._waiting is not None and not self._has_work:
            self._submit_waiting()

    def _take_result(self, frame: InProcess, processed: Processed) -> Iterator[Output]:
        """The outputs of a frame; what it leads to in the filter is left to the next measurements."""
        if processed is None:
            return
        tracked, result = processed
        yield from self._outputs_of_frame(frame, tracked, result)
        self._pieces.append(lambda: self._compare(frame, tracked, result))

    def _compare(self, frame: InProcess, tracked: TrackedFrame, result: FrameResult) -> Iterator[Output]:
        if (yield from self._is_revised(tracked)):
            self._waiting = self._frame_ns = None  # stamps of images may have been moved back
            return
        keyframe = result.keyframe
        if keyframe is not None:
            pending = yield from self._pending(frame, keyframe)
            self._pieces.append(lambda: self._correct(pending))

    def _correct(self, pending: Pending) -> Iterator[Output]:
        yield from self._correct_filter(pending)

    def _take_frame(self, frame: _Image) -> Iterator[Output]:
        """Have a frame processed, now or once the one before it is done."""
        reason = self._reason_to_refuse(frame)
        if reason is not None:
            self._counted[reason] += 1
            return
        self._frame_ns = frame.stamp_ns
        if not self._has_work and self._waiting is None:
            if not self._frames.is_ready:
                self._counted["frame_before_vision"] += 1
                return
            self._submit_now(frame)
            yield from self._overload.take(frame.stamp_ns)
            return
        if self._keyframe is None or self._latest is None or not self._keyframe.can_hold:
            yield from self._leave_out(frame.stamp_ns)
            return
        if self._waiting is None:
            yield from self._overload.take(frame.stamp_ns)
        else:
            yield from self._leave_out(self._waiting[1].stamp_ns)
        self._waiting = self._keyframe.hold_frame(frame.stamp_ns), frame, self._latest

    def _reason_to_refuse(self, frame: _Image) -> str | None:
        """Under what a frame is counted that is not processed; None for one that is."""
        if not self._filter.has_started:
            return "frame_before_start"
        if self._frame_ns is not None and frame.stamp_ns <= self._frame_ns:
            return "frame_stamp_refused"
        if not self._filter.reaches(frame.stamp_ns):
            return "frame_late"
        return "frame_without_vision" if self._is_stopped else None

    def _leave_out(self, stamp_ns: int) -> Iterator[Event]:
        self._counted["frame_left_out"] += 1
        yield from self._overload.leave_out(stamp_ns)

    def _submit_now(self, frame: _Image) -> None:
        if self._keyframe is None:
            marked = self._filter.mark_frame(frame.stamp_ns)
            self._first = marked, self._submit_first(marked, frame)
        elif self._latest is not None:
            pair = self._keyframe.mark_frame(frame.stamp_ns)
            in_world = self._keyframe.in_world_of_now()
            self._in_process = self._submit_pair(pair, self._latest, frame, in_world)

    def _submit_waiting(self) -> None:
        """The frame that waited, relative to the keyframe of now."""
        waiting, self._waiting = self._waiting, None
        keyframe: Keyframe | None = self._keyframe
        if waiting is None or keyframe is None:
            return
        held, frame, latest = waiting
        pair = keyframe.mark_held(held)
        self._in_process = self._submit_pair(pair, latest, frame, keyframe.in_world_of_now())

    def _start_anew(self, failure: str) -> Iterator[Event]:
        """The process has failed: another one begins a window, unless one has been started just before."""
        self._first = self._in_process = self._waiting = self._keyframe = None
        self._pieces.clear()
        self._counted["vision_failures"] += 1
        now_s = time.monotonic()
        if self._restarted_s is not None and now_s - self._restarted_s < _AGAIN_WITHIN_S:
            self._is_stopped = True
            detail = f"the process of vision {failure} again; leg odometry goes on alone: start the estimator anew"
            yield Event(self._now_ns, "vision_stopped", detail)
            return
        self._restarted_s = now_s
        self._frames.start()
        detail = f"the process of vision {failure}; it is started anew, and leg odometry goes on alone until then"
        yield Event(self._now_ns, "vision_restarted", detail)


def combined_beside(
    leg_filter: LegOdometryFilter,
    stereo: StereoCalibration,
    frontend: FrontendConfig,
    smoother: SmootherConfig,
    config: BridgeConfig,
    *,
    has_frames: bool = True,
    pictures_every: int | None = None,
) -> CombinedBeside:
    """The real front end and smoother in a process beside a filter, joined; arguments as of ``combined_odometry``.

    Raises:
        ConfigError: cameras that cannot be rectified.
        CalibrationMissing: tracks, and cameras that are not rectified.
        CocloError: the system starts no process.
    """
    _, rig = stereo_stages(stereo, frontend, has_frames=has_frames)
    recipe = partial(_stages, stereo, frontend, smoother, has_frames=has_frames, pictures_every=pictures_every)
    size = max(camera.width_px * camera.height_px for camera in (stereo.left, stereo.right))
    return CombinedBeside(
        leg_filter,
        VisionProcess(recipe, size if has_frames else 0, config.vision_timeout_s),
        config,
        outputs=FusedEstimates("combined_coclo", "combined_vins", smoother),
        check=RotationCheck(rig, *leg_filter.imu_rotations),
        time_offset_s=stereo.time_offset_s,
        reports_innovations=pictures_every is not None,
    )


def _stages(
    stereo: StereoCalibration,
    config: FrontendConfig,
    smoother: SmootherConfig,
    *,
    has_frames: bool,
    pictures_every: int | None,
) -> VisionStages:
    """Fresh stages, made in the process once others like them have been tried."""
    from coclo_vio.backend.window.smoother import SlidingWindowSmoother  # noqa: PLC0415 -- loads GTSAM

    def make() -> tuple[VisionStages, RectifiedStereo]:
        frontend, rig = stereo_stages(stereo, config, has_frames=has_frames)
        window = SlidingWindowSmoother(rig, smoother, gives_snapshots=pictures_every is not None)
        return VisionStages(VisionChain(frontend, pictures_every), window), rig

    warm_up(*make(), stereo.left.width_px, stereo.left.height_px, has_frames=has_frames)
    return make()[0]
