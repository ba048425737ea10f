# SPDX-License-Identifier: BSD-3-Clause
"""Frames that are processed in a thread give what they give without one: the same outputs after the same pushes."""

import gc
import pickle
import threading
import time
from collections.abc import Callable, Sequence

import pytest
from stand_ins import NotingFrontend, NotingSmoother
from stand_ins import frame as black_frame
from walk_among_points import DAISY, FRAME_NS, between, combined, stream

from coclo_vio.filter.odometry import LegOdometryFilter
from coclo_vio.fusion.combined import CombinedOdometry
from coclo_vio.fusion.config import BridgeConfig
from coclo_vio.fusion.frame_worker import THREAD_NAME, FrameWorker
from coclo_vio.values.arrays import Array
from coclo_vio.values.errors import SmootherError
from coclo_vio.values.keyframes import FrameResult, OdometryDelta, PoseEvidence
from coclo_vio.values.measurements import JointSample, Measurement, StereoFrame, StereoTracks
from coclo_vio.values.outputs import Estimate, Output

LATENCY_NS = 50_000_000


def threads() -> list[threading.Thread]:
    return [one for one in threading.enumerate() if one.name.startswith(THREAD_NAME)]


def wait_until(is_so: Callable[[], bool]) -> None:
    for _ in range(1000):
        if is_so():
            return
        time.sleep(0.01)
    pytest.fail("it did not happen within 10 s")


def pushed(odometry: CombinedOdometry, measurements: Sequence[Measurement]) -> list[list[Output]]:
    """The outputs of each push, and of the end."""
    return [*(list(odometry.push(one)) for one in measurements), list(odometry.finish())]


class HeldSmoother(NotingSmoother):
    """Processes no frame before it is allowed to."""

    def __init__(self) -> None:
        super().__init__(keyframes_every=1)
        self.allowed, self.began = threading.Event(), threading.Event()
        self.thread = ""

    def push_tracks(
        self, tracks: StereoTracks, odometry: OdometryDelta | None = None, evidence: PoseEvidence | None = None
    ) -> FrameResult:
        if odometry is not None:  # not the first frame
            self.began.set()
            assert self.allowed.wait(10.0)
        self.thread = threading.current_thread().name
        return super().push_tracks(tracks, odometry, evidence)


class FailingFrontend(NotingFrontend):
    """Fails at its third frame."""

    def track(self, frame: StereoFrame, T_previous_current: Array | None = None) -> StereoTracks:
        if len(self.stamps_ns) == 2:
            raise SmootherError("the third frame is at fault")
        return super().track(frame, T_previous_current)


def made(smoother: NotingSmoother, frontend: NotingFrontend, frame_threads: int) -> CombinedOdometry:
    leg_filter = LegOdometryFilter(DAISY, remembers_frames=True)
    return CombinedOdometry(leg_filter, smoother, frontend, BridgeConfig(frame_threads=frame_threads))


def with_images(start_s: float, end_s: float) -> list[Measurement]:
    """The walk with black images at the frames."""
    return [
        black_frame(one.stamp_ns) if isinstance(one, StereoTracks) else one for one in between(stream(), start_s, end_s)
    ]


@pytest.mark.long
@pytest.mark.parametrize("latency_s", [0.0, 0.05, 0.25])
def test_outputs_are_the_same_to_the_bit_after_every_push(latency_s: float) -> None:
    """With the real filter and smoother; with a latency shorter than a frame's period, and longer."""
    walk = between(stream(), 0.0, 2.0)
    runs = []
    for frame_threads in (0, 1):
        odometry = combined(BridgeConfig(vision_latency_s=latency_s, frame_threads=frame_threads))
        runs.append((pickle.dumps([_comparable(outputs) for outputs in pushed(odometry, walk)]), odometry.counts))
    assert runs[0] == runs[1]
    assert runs[0][1]["feedback_accepted"] > 1


def _comparable(outputs: list[Output]) -> list[object]:
    """The outputs without the time that a keyframe took."""
    return [repr(output) for output in outputs if isinstance(output, Estimate)] + [
        (type(output).__name__, getattr(output, "stamp_ns", None)) for output in outputs
    ]


def test_a_joint_sample_waits_for_a_frame_only_once_its_latency_has_passed() -> None:
    smoother = HeldSmoother()
    odometry = made(smoother, NotingFrontend(), frame_threads=1)
    walk = with_images(0.0, 2.0)
    frames = [one for one in walk if isinstance(one, StereoFrame)]
    second_ns = None
    for one in walk:
        if second_ns is None and isinstance(one, StereoFrame) and smoother.frames == 1:
            second_ns = one.stamp_ns
        if second_ns is not None and one.stamp_ns >= second_ns + LATENCY_NS:
            break
        outputs = odometry.push(one)
        if second_ns is not None and isinstance(one, JointSample):
            assert [output.name for output in outputs if isinstance(output, Estimate)] == ["combined_coclo"]
    assert second_ns is not None
    assert len(frames) > 2
    assert smoother.began.wait(10.0)
    assert smoother.frames == 1, "the second frame has not been processed yet, and no push waited for it"
    threading.Timer(0.1, smoother.allowed.set).start()
    names = [output.name for output in odometry.push(one) if isinstance(output, Estimate)]
    assert names[0] == "combined_vins"
    assert smoother.thread.startswith(THREAD_NAME)
    list(odometry.finish())


def test_counts_wait_for_the_frame_in_process() -> None:
    smoother = HeldSmoother()
    odometry = made(smoother, NotingFrontend(), frame_threads=1)
    for one in with_images(0.0, 2.0):
        odometry.push(one)
        if smoother.began.is_set():
            break
    threading.Timer(0.1, smoother.allowed.set).start()
    assert odometry.counts["frontend_detected"] == 6
    assert smoother.frames == 2
    list(odometry.finish())


@pytest.mark.parametrize("frame_threads", [0, 1])
def test_an_error_of_a_frame_comes_where_its_result_is_due_after_the_outputs_before(frame_threads: int) -> None:
    odometry = made(NotingSmoother(keyframes_every=1), FailingFrontend(), frame_threads)
    outputs: list[Output] = []
    stamps_ns: list[int] = []
    with pytest.raises(SmootherError, match="the third frame is at fault"):
        _push(odometry, with_images(0.0, 2.0), stamps_ns, outputs)
    by_vision = [one.state.stamp_ns for one in outputs if isinstance(one, Estimate) and one.name == "combined_vins"]
    assert len(by_vision) == 2
    assert LATENCY_NS <= stamps_ns[-1] - (by_vision[-1] + FRAME_NS) < LATENCY_NS + 10_000_000


def _push(
    odometry: CombinedOdometry, measurements: Sequence[Measurement], stamps_ns: list[int], outputs: list[Output]
) -> None:
    """Push until an error, and note what was pushed and what came out."""
    for one in measurements:
        stamps_ns.append(one.stamp_ns)
        outputs += odometry.push(one)


def test_no_thread_is_left_by_an_estimator_that_ends_or_is_abandoned() -> None:
    earlier = set(threads())
    ended, abandoned = (made(NotingSmoother(), NotingFrontend(), frame_threads=1) for _ in range(2))
    for odometry in (ended, abandoned):
        for one in with_images(0.0, 1.0):
            odometry.push(one)
    own = set(threads()) - earlier
    assert len(own) == 2
    list(ended.finish())
    wait_until(lambda: sum(one.is_alive() for one in own) == 1)
    del odometry, abandoned
    gc.collect()
    wait_until(lambda: not any(one.is_alive() for one in own))


def test_an_interruption_while_a_result_is_awaited_leaves_no_thread() -> None:
    earlier, worker, began = set(threads()), FrameWorker(1), threading.Event()

    def job() -> None:
        began.set()
        time.sleep(0.05)

    future = worker.submit(job)
    assert began.wait(10.0)
    with pytest.raises(KeyboardInterrupt):
        raise KeyboardInterrupt
    own = set(threads()) - earlier
    assert len(own) == 1
    del worker, future
    gc.collect()
    wait_until(lambda: not any(one.is_alive() for one in own))


def test_an_interruption_is_not_held_back_where_there_is_no_thread() -> None:
    def job() -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        FrameWorker(0).submit(job)
