# SPDX-License-Identifier: BSD-3-Clause
"""Frames processed beside the filter: joints never wait, results come late at their own stamp, failures end nothing."""

import gc
import os
import re
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from scripted_stages import Delayed, Echo, Scripted, dies, fails, real_stages
from stand_ins import frame as black_frame
from walk_among_points import DAISY, between, combined, error_m, states, stream

from coclo_vio.filter.odometry import LegOdometryFilter
from coclo_vio.filter.state_blocks import held_frame_block
from coclo_vio.fusion.combined_beside import CombinedBeside
from coclo_vio.fusion.config import BridgeConfig
from coclo_vio.fusion.frame_processor import FrameJob, VisionStages
from coclo_vio.fusion.vision_process import VisionProcess
from coclo_vio.values.errors import SmootherError
from coclo_vio.values.measurements import JointSample, Measurement, StereoFrame, StereoTracks
from coclo_vio.values.outputs import Estimate, Event, Output

IMAGE_BYTES = 48


@contextmanager
def made(recipe: Callable[[], VisionStages], timeout_s: float = 20.0) -> Iterator[tuple[CombinedBeside, VisionProcess]]:
    leg_filter = LegOdometryFilter(DAISY, remembers_frames=True, extra_blocks=(held_frame_block(),))
    process = VisionProcess(recipe, IMAGE_BYTES, timeout_s)
    odometry = CombinedBeside(leg_filter, process, BridgeConfig(vision="beside"))
    odometry.prepare()
    try:
        yield odometry, process
    finally:
        process.close()


def with_images(start_s: float, end_s: float) -> list[Measurement]:
    """The walk with black images at the frames."""
    return [
        black_frame(one.stamp_ns) if isinstance(one, StereoTracks) else one for one in between(stream(), start_s, end_s)
    ]


def events(outputs: Sequence[Output]) -> list[str]:
    return [one.kind for one in outputs if isinstance(one, Event) and one.kind != "vision_lost"]


def pushed_as_vision_follows(odometry: CombinedBeside, measurements: Sequence[Measurement]) -> list[Output]:
    """The outputs where each joint sample comes once the frame before it is done."""
    outputs: list[Output] = []
    for one in measurements:
        outputs += odometry.push(one)
        while odometry._in_process is not None or odometry._first is not None:
            outputs += odometry._follow_vision(0.01)
    return [*outputs, *odometry.finish()]


@pytest.mark.long
def test_results_that_come_at_once_are_those_of_a_run_in_turn_without_latency() -> None:
    walk = between(stream(), 0.0, 3.0)
    expected = combined(BridgeConfig(vision_latency_s=0.0))
    in_turn = [*(output for one in walk for output in expected.push(one)), *expected.finish()]
    with made(real_stages) as (odometry, _):
        beside = pushed_as_vision_follows(odometry, walk)
    for name in ("combined_coclo", "combined_vins"):
        one, other = states(in_turn, name), states(beside, name)
        assert [each.stamp_ns for each in one] == [each.stamp_ns for each in other]
        apart = [np.abs(a.nav.T_world_body - b.nav.T_world_body)[:3, 3].max() for a, b in zip(one, other, strict=True)]
        assert max(apart) < 2e-3  # a correction comes a sample later
    assert odometry.counts["feedback_accepted"] == expected.counts["feedback_accepted"] > 5


@pytest.mark.long
def test_a_late_result_is_applied_at_its_own_stamp() -> None:
    """Frames that wait keep the pose of their own time, so that the estimate stays where the truth is."""
    walk = between(stream(), 0.0, 4.5)
    with made(partial(Delayed, 0.15)) as (odometry, _):
        outputs: list[Output] = []
        begin_s = time.monotonic()
        for one in walk:
            time.sleep(max(0.0, begin_s + one.stamp_ns * 1e-9 - time.monotonic()))
            outputs += odometry.push(one)
        outputs += odometry.finish()
    counts = odometry.counts
    assert counts["frame_left_out"] > 10, "vision takes two frame periods and more"
    assert counts["feedback_accepted"] > 5
    assert max(error_m(state) for state in states(outputs, "combined_coclo")) < 0.02
    assert max(error_m(state) for state in states(outputs, "combined_vins")) < 0.02
    assert events(outputs).count("images_left_out") == 1, "one event an episode"


def test_no_joint_sample_waits_for_a_frame() -> None:
    """However long a frame takes, every joint sample gives its estimate at once, and the images go first."""
    with made(partial(Scripted, 2, partial(time.sleep, 0.7))) as (odometry, _):
        longest_s, estimates, joints = 0.0, 0, 0
        for one in with_images(0.0, 3.0):
            began_s = time.thread_time()
            outputs = odometry.push(one)
            longest_s = max(longest_s, time.thread_time() - began_s)
            if isinstance(one, JointSample):
                joints += 1
                estimates += sum(isinstance(each, Estimate) and each.name == "combined_coclo" for each in outputs)
                time.sleep(0.001)
        assert longest_s < 0.5
        assert estimates > 0.8 * joints
        assert odometry.counts["frame_left_out"] > 3


@pytest.mark.long
@pytest.mark.parametrize("times", [1, 2])
def test_a_process_that_dies_is_started_anew_once(times: int, tmp_path: Path) -> None:
    marker = tmp_path / "died" if times == 1 else None
    with made(partial(Scripted, 3, dies, marker)) as (odometry, process):
        first = process.pid
        outputs: list[Output] = []
        _push_all(odometry, process, with_images(0.0, 4.0), outputs)
        outputs += odometry.finish()
    kinds = events(outputs)
    assert kinds.count("vision_restarted") == 1
    assert kinds.count("vision_stopped") == times - 1
    assert odometry.counts["vision_failures"] == times
    assert "status -9" in next(
        one.detail for one in outputs if isinstance(one, Event) and one.kind.startswith("vision_r")
    )
    by_legs = states(outputs, "combined_coclo")
    assert by_legs[-1].stamp_ns == 3_990_000_000
    after = [state.stamp_ns for state in states(outputs, "combined_vins")][-1]
    assert (after > 3_500_000_000) == (times == 1)
    assert first is not None
    with pytest.raises(ProcessLookupError):
        os.kill(first, 0)


def _push_all(
    odometry: CombinedBeside, process: VisionProcess, measurements: Sequence[Measurement], outputs: list[Output]
) -> None:
    """Push until an error, with time for vision at every frame, and note what came out."""
    for one in measurements:
        outputs += odometry.push(one)
        if isinstance(one, StereoFrame):
            _follow(odometry, process, outputs)


def _follow(odometry: CombinedBeside, process: VisionProcess, outputs: list[Output]) -> None:
    """Let vision do all that it has; a process that was started anew becomes ready."""
    for _ in range(2000):
        has_work = odometry._has_work
        outputs += odometry._follow_vision(0.01)
        if not has_work and (process.is_ready or process.pid is None):
            return
    pytest.fail("vision did not come to an end within 20 s")


@pytest.mark.long
def test_a_process_that_hangs_is_killed_and_started_anew(tmp_path: Path) -> None:
    recipe = partial(Scripted, 3, partial(time.sleep, 3600.0), tmp_path / "hung")
    with made(recipe, timeout_s=0.3) as (odometry, process):
        outputs: list[Output] = []
        _push_all(odometry, process, with_images(0.0, 3.0), outputs)
        outputs += odometry.finish()
    said = next(one.detail for one in outputs if isinstance(one, Event) and one.kind == "vision_restarted")
    assert "did not answer in time" in said
    assert "vision_stopped" not in events(outputs)


def test_an_error_of_a_frame_comes_out_of_a_push() -> None:
    with made(partial(Scripted, 3, fails)) as (odometry, process):
        outputs: list[Output] = []
        with pytest.raises(SmootherError, match="the third frame is at fault"):
            _push_all(odometry, process, with_images(0.0, 3.0), outputs)
        assert len(states(outputs, "combined_vins")) == 2


def test_images_arrive_as_they_were_sent_and_larger_ones_too() -> None:
    with made(Echo) as (_, process):
        for shape in ((6, 8), (60, 80)):
            image = np.random.default_rng(3).integers(0, 255, shape, dtype=np.uint8)
            future = process.submit(FrameJob(StereoFrame(7, image, image.T.copy().T), None, np.eye(4)))
            for _ in range(100):
                process.poll(0.1)
                if future.done():
                    break
            with pytest.raises(SmootherError, match=re.escape(f"{shape} {int(image.sum())} {int(image.sum())}")):
                future.result()


def _shared_memory() -> set[Path]:
    """Shared memory that has a name; not the semaphores of tests beside this one."""
    return {each for each in Path("/dev/shm").iterdir() if not each.name.startswith("sem.")}


@pytest.mark.long
def test_nothing_is_left_of_an_estimator_that_ends_or_is_abandoned() -> None:
    gc.collect()
    files_before, shared_before = len(list(Path("/proc/self/fd").iterdir())), _shared_memory()
    pids = []
    for finishes in (True, False):
        with made(partial(Scripted, 10**6, fails)) as (odometry, process):
            pids.append(process.pid)
            for one in with_images(0.0, 1.3):
                odometry.push(one)
            if finishes:
                list(odometry.finish())
                assert process.pid is None
        del odometry, process
    for pid in pids:
        assert pid is not None
        with pytest.raises(ProcessLookupError):
            os.kill(pid, 0)
    gc.collect()
    assert len(list(Path("/proc/self/fd").iterdir())) <= files_before
    assert _shared_memory() == shared_before
