# SPDX-License-Identifier: BSD-3-Clause
"""Leg odometry and vision together (paper section IV): the filter's motion ties the smoother's keyframes, and the
window's evidence corrects the filter. One measurement at a time; two trajectories come out.

What vision finds of a frame is taken a fixed time after the frame's stamp (the latency). Until then the frame may be
processed in another thread: its outputs come with the first measurement whose stamp is past the latency, or with the
next frame, whether there is a thread or not. So outputs depend on the measurements alone, never on computing time.
"""

from collections.abc import Iterator, Mapping
from concurrent.futures import wait

from coclo_vio.backend.window.config import SmootherConfig
from coclo_vio.filter.keyframe_exchange import Keyframe, MarkedFrame
from coclo_vio.filter.odometry import LegOdometryFilter
from coclo_vio.frontend.config import FrontendConfig
from coclo_vio.fusion.config import BridgeConfig
from coclo_vio.fusion.frame_processor import FramesInTurn, VisionStages
from coclo_vio.fusion.fused_estimates import FusedEstimates
from coclo_vio.fusion.keyframe_bridge import InProcess, KeyframeBridge, Pending
from coclo_vio.fusion.rotation_check import RotationCheck
from coclo_vio.fusion.vision_chain import Frontend, Smoother, VisionChain
from coclo_vio.fusion.visual_odometry import stereo_stages
from coclo_vio.values.calibration import StereoCalibration
from coclo_vio.values.estimates import StateEstimate
from coclo_vio.values.measurements import (
    CameraImuSample,
    FootForceSample,
    ImuSample,
    JointSample,
    Measurement,
    StereoFrame,
    StereoTracks,
)
from coclo_vio.values.outputs import Output
from coclo_vio.values.units import NS_PER_S


class CombinedOdometry(KeyframeBridge[FramesInTurn]):
    """The bridge with frames processed in turn: the result of a frame is taken when its latency has passed."""

    def __init__(
        self,
        leg_filter: LegOdometryFilter,
        smoother: Smoother,
        frontend: Frontend | None,
        config: BridgeConfig | None = None,
        *,
        outputs: FusedEstimates | None = None,
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
            outputs: makes the estimates, a fresh one; with the names ``combined_coclo`` and ``combined_vins`` if None.
            check: a fresh comparison of rotations by cameras, gyroscope and legs; None for none.
            time_offset_s: stamp of a frame plus this is the clock of the joints and the body's IMU, s.
            pictures_every: draw the tracks on every n-th frame; on none if None.
        """
        config = config or BridgeConfig()
        stages = VisionStages(VisionChain(frontend, pictures_every), smoother)
        frames = FramesInTurn(stages, config.frame_threads)
        super().__init__(
            leg_filter,
            frames,
            config,
            outputs=outputs,
            check=check,
            time_offset_s=time_offset_s,
            reports_innovations=pictures_every is not None,
        )
        self._latency_ns = round(config.vision_latency_s * NS_PER_S)
        self._in_process: tuple[int, InProcess] | None = None  # and when its result is taken at the latest
        self._arriving: tuple[int, Pending] | None = None  # and when it reaches the filter

    @property
    def counts(self) -> Mapping[str, int]:
        """What was counted here, and by filter, front end and smoother, once the frame in process is done."""
        self.settle()
        return super().counts

    def settle(self) -> None:
        """Wait for the frame that is processed beside the filter, whose result is taken when it is due all the same."""
        if self._in_process is not None:
            wait([self._in_process[1].processed])

    def _end(self) -> Iterator[Output]:
        """The results of the last frame and of the last keyframe, which no later measurement fetches."""
        yield from self._take_result()
        if self._arriving is not None:
            yield from self._correct_if_due(self._arriving[0])
        self._frames.close()

    def _process(self, measurement: Measurement) -> Iterator[Output]:
        match measurement:
            case StereoFrame() | StereoTracks():
                yield from self._take_what_is_due(measurement.stamp_ns)
                yield from self._take_result()
                yield from self._process_frame(measurement)
            case JointSample() | ImuSample() | CameraImuSample() | FootForceSample():
                yield from self._take_what_is_due(measurement.stamp_ns)
                yield from self._take_sample(measurement)

    def _process_frame(self, frame: StereoFrame | StereoTracks) -> Iterator[Output]:
        """Remember in the filter where the frame was taken, track it, and give the tracks to the window."""
        if not self._filter.has_started:
            self._counted["frame_before_start"] += 1
            return
        if not self._frames.is_next(frame.stamp_ns):
            return
        if not self._filter.reaches(frame.stamp_ns):
            self._counted["frame_late"] += 1
            return
        if self._arriving is not None:
            self._counted["frame_while_busy"] += 1
            return
        if self._keyframe is None:
            yield from self._begin(self._filter.mark_frame(frame.stamp_ns), frame)
        elif self._latest is not None:
            yield from self._tie(self._keyframe, self._latest, frame)

    def _begin(self, marked: MarkedFrame, frame: StereoFrame | StereoTracks) -> Iterator[Output]:
        """The first frame of a window."""
        processed = self._submit_first(marked, frame).result()
        if self._latest is not None:
            yield from self._anchor(marked, self._latest, processed)

    def _tie(self, keyframe: Keyframe, latest: StateEstimate, frame: StereoFrame | StereoTracks) -> Iterator[Output]:
        """A frame after a keyframe."""
        pair = keyframe.mark_frame(frame.stamp_ns)
        in_world = keyframe.in_world_of_now() if self._latency_ns else keyframe.in_world
        self._in_process = frame.stamp_ns + self._latency_ns, self._submit_pair(pair, latest, frame, in_world)
        if not self._latency_ns:
            yield from self._take_result()

    def _take_what_is_due(self, now_ns: int) -> Iterator[Output]:
        if self._in_process is not None and now_ns >= self._in_process[0]:
            yield from self._take_result()
        yield from self._correct_if_due(now_ns)

    def _take_result(self) -> Iterator[Output]:
        """The outputs of the frame in process, once it is done; where it is a keyframe, the filter gets feedback."""
        if self._in_process is None:
            return
        (at_ns, frame), self._in_process = self._in_process, None
        processed = frame.processed.result()
        if processed is None:
            return
        tracked, result = processed
        yield from self._outputs_of_frame(frame, tracked, result)
        if (yield from self._is_revised(tracked)) or result.keyframe is None:
            return
        self._arriving = at_ns, (yield from self._pending(frame, result.keyframe))

    def _correct_if_due(self, now_ns: int) -> Iterator[Output]:
        """Correct the filter by a keyframe's result that has arrived."""
        if self._arriving is None or now_ns < self._arriving[0]:
            return
        (_, pending), self._arriving = self._arriving, None
        yield from self._correct_filter(pending)


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
        SlidingWindowSmoother(rig, smoother, gives_snapshots=pictures_every is not None),
        stages,
        config,
        outputs=FusedEstimates("combined_coclo", "combined_vins", smoother),
        check=RotationCheck(rig, *leg_filter.imu_rotations),
        time_offset_s=stereo.time_offset_s,
        pictures_every=pictures_every,
    )
