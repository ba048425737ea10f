# SPDX-License-Identifier: BSD-3-Clause
"""Front end and smoother joined: which measurement each gets, when and in which order. The stages are stand-ins."""

from collections.abc import Iterable

import numpy as np
import pytest
from stand_ins import MS, NotingFrontend, NotingSmoother, frame, tracks

from coclo_vio.fusion.visual_odometry import VisualOdometry
from coclo_vio.values.measurements import (
    BodyTwistSample,
    CameraImuSample,
    ImuSample,
    JointSample,
    Measurement,
    StereoTracks,
)
from coclo_vio.values.outputs import Estimate, Event, KeyframeHealth, Output, Picture


def visual(
    smoother: NotingSmoother | None = None, frontend: NotingFrontend | None = None, **options: object
) -> VisualOdometry:
    return VisualOdometry("vins", smoother or NotingSmoother(), frontend or NotingFrontend(), **options)  # type: ignore[arg-type]


def estimated_ms(outputs: Iterable[Output]) -> list[int]:
    """Stamps of the estimates, ms."""
    return [output.state.stamp_ns // MS for output in outputs if isinstance(output, Estimate)]


def recording(until_ms: int) -> list[Measurement]:
    """An IMU at 200 Hz and frames at 20 Hz."""
    samples: list[Measurement] = []
    for stamp_ms in range(0, until_ms, 5):
        samples.append(ImuSample(stamp_ms * MS, np.zeros(3), np.zeros(3)))
        if stamp_ms % 50 == 0:
            samples.append(frame(stamp_ms * MS))
    return samples


def test_counts_are_those_of_all_stages() -> None:
    odometry = visual()
    odometry.push(frame(0))
    assert odometry.counts == {"frames": 1, "frontend_detected": 3, "smoother_keyframes": 1}


def test_a_frame_gives_picture_events_health_and_estimate_in_this_order() -> None:
    odometry = visual(pictures_every=1)
    first, second = odometry.push(frame(0)), odometry.push(frame(50 * MS))
    assert [type(output) for output in first] == [Picture, Event, KeyframeHealth]
    assert [type(output) for output in second] == [Picture, Event, KeyframeHealth, Estimate]
    assert isinstance(second[1], Event)
    assert (second[1].stamp_ns, second[1].kind) == (50 * MS, "vision_lost")
    assert isinstance(second[2], KeyframeHealth)
    assert second[2].iterations == 6
    assert isinstance(second[3], Estimate)
    assert second[3].name == "vins"


def test_every_frame_has_an_estimate_once_the_smoother_has_started() -> None:
    odometry = visual()
    outputs = [odometry.push(frame(50 * MS * number)) for number in range(5)]
    assert [estimated_ms(one) for one in outputs] == [[], [50], [100], [150], [200]]


def test_readings_of_the_one_imu_go_to_the_smoother_before_their_frame() -> None:
    smoother = NotingSmoother()
    odometry = visual(smoother, imu_kind=CameraImuSample)
    readings = [CameraImuSample(stamp_ns, np.zeros(3), np.zeros(3)) for stamp_ns in (0, 5 * MS, 5 * MS, 4 * MS)]
    for sample in (*readings, ImuSample(6 * MS, np.zeros(3), np.zeros(3)), frame(7 * MS)):
        odometry.push(sample)
    assert odometry.push(JointSample(8 * MS, *np.zeros((3, 12)))) == []
    assert smoother.pushed[:2] == readings[:2]
    assert isinstance(smoother.pushed[2], StereoTracks)
    assert len(smoother.pushed) == 3
    assert odometry.counts["imu_stamp_refused"] == 2


def test_a_frame_that_is_not_later_than_the_last_is_refused() -> None:
    smoother = NotingSmoother()
    odometry = visual(smoother)
    for stamp_ns in (50 * MS, 50 * MS, 40 * MS, 60 * MS):
        odometry.push(frame(stamp_ns))
    assert smoother.frames == 2
    assert odometry.counts["frame_stamp_refused"] == 2


def test_tracks_bypass_the_front_end() -> None:
    smoother = NotingSmoother()
    odometry = VisualOdometry("stereo", smoother)
    recorded = [tracks(50 * MS * number) for number in range(3)]
    outputs = [odometry.push(one) for one in recorded]
    assert smoother.pushed == recorded
    assert [estimated_ms(one) for one in outputs] == [[], [50], [100]]
    assert odometry.push(frame(200 * MS)) == []
    assert odometry.counts["frame_without_frontend"] == 1


@pytest.mark.parametrize("offset_ms", [8, -8, 60])
def test_estimates_are_stamped_by_the_clock_of_the_imu(offset_ms: int) -> None:
    smoother = NotingSmoother()
    odometry = visual(smoother, imu_kind=ImuSample, time_offset_s=offset_ms * 1e-3)
    outputs = [output for sample in recording(600) for output in odometry.push(sample)]
    stamps_ms = estimated_ms(outputs)
    assert stamps_ms == [50 * n + offset_ms for n in range(1, 1 + len(stamps_ms))]
    assert len(stamps_ms) >= 9
    in_order = [sample.stamp_ns for sample in smoother.pushed]  # type: ignore[attr-defined]
    assert in_order == sorted(in_order)


@pytest.mark.parametrize(("offset_ms", "frames", "readings"), [(200, 4, 0), (-200, 0, 40), (0, 0, 0)])
def test_what_waits_for_the_other_clock_comes_out_at_the_end(offset_ms: int, frames: int, readings: int) -> None:
    """With a camera clock 0.2 s off, no frame and no reading is lost."""
    smoother = NotingSmoother()
    odometry = visual(smoother, imu_kind=ImuSample, time_offset_s=offset_ms * 1e-3)
    recorded = recording(1000)
    pushed = [output for sample in recorded for output in odometry.push(sample)]
    passed_on = len(smoother.pushed)
    finished = list(odometry.finish())
    assert len(smoother.pushed) == len(recorded) == 220
    held = smoother.pushed[passed_on:]
    assert [isinstance(one, StereoTracks) for one in held].count(True) == frames
    assert [isinstance(one, ImuSample) for one in held].count(True) == readings
    assert len(estimated_ms(finished)) == frames
    assert estimated_ms([*pushed, *finished]) == [50 * n + offset_ms for n in range(1, 20)]
    assert list(odometry.finish()) == []
    assert odometry.counts.get("not_waited_for_clock", 0) == 0


def test_frames_that_come_due_together_each_have_an_estimate() -> None:
    """The IMU is silent while frames wait for it, and resumes."""
    odometry = visual(imu_kind=ImuSample, time_offset_s=0.2)
    for stamp_ms in (0, 50, 100, 150):
        assert odometry.push(frame(stamp_ms * MS)) == []
    outputs = [odometry.push(ImuSample((500 + n) * MS, np.zeros(3), np.zeros(3))) for n in range(2)]
    assert [estimated_ms(one) for one in outputs] == [[250, 300, 350], []]


def test_twists_go_to_the_smoother_before_the_frames_that_they_lead_to() -> None:
    """Without their kind no twists are used."""
    smoother, other = NotingSmoother(), NotingSmoother()
    odometry = VisualOdometry("stereo_twist", smoother, NotingFrontend(), twist_kind=BodyTwistSample)
    without = VisualOdometry("stereo", other, NotingFrontend())
    for number in range(4):
        for one in (odometry, without):
            one.push(BodyTwistSample(50 * MS * number, np.zeros(3), np.zeros(3)))
            one.push(frame(50 * MS * number))
    kinds = [type(each).__name__ for each in smoother.pushed]
    assert kinds == ["BodyTwistSample", "StereoTracks"] * 4
    assert {type(each).__name__ for each in other.pushed} == {"StereoTracks"}
