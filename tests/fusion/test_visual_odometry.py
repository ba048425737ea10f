# SPDX-License-Identifier: BSD-3-Clause
"""Front end and smoother joined: who is told what, when, and in which order. The stages are stand-ins."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import pytest

from coclo_vio.fusion.visual_odometry import VisualOdometry
from coclo_vio.geometry import se3, so3
from coclo_vio.values.arrays import Array, ByteImage
from coclo_vio.values.calibration import RectifiedStereo
from coclo_vio.values.estimates import NavState, SelfReporting, StateEstimate
from coclo_vio.values.keyframes import OdometryDelta
from coclo_vio.values.measurements import (
    BodyTwistSample,
    CameraImuSample,
    ImuSample,
    InertialReading,
    JointSample,
    StereoFrame,
    StereoTracks,
)
from coclo_vio.values.outputs import Event, KeyframeHealth

MS = 1_000_000
T_BODY_CAMERA = se3.transform(so3.exp(np.array([0.3, -0.2, 0.5])), np.array([0.2, 0.0, 0.1]))
RIG = RectifiedStereo((400.0, 400.0), (320.0, 240.0), 0.05, T_BODY_CAMERA)


def tracks(stamp_ns: int) -> StereoTracks:
    return StereoTracks(stamp_ns, np.arange(3), np.ones((3, 2)), np.ones((3, 2)))


def frame(stamp_ns: int) -> StereoFrame:
    image = np.zeros((6, 8), dtype=np.uint8)
    return StereoFrame(stamp_ns, image, image)


def pose_at(stamp_ns: int) -> Array:
    """Something that turns and moves."""
    seconds = stamp_ns * 1e-9
    return se3.exp(seconds * np.array([0.3, 0.1, -0.5, 1.0, 2.0, 0.5]))


@dataclass
class Eyes:
    """A front end that notes how it was told the camera moves."""

    rig: RectifiedStereo = RIG
    told: list[Array | None] = field(default_factory=list)
    stamps_ns: list[int] = field(default_factory=list)

    def track(self, frame: StereoFrame, T_previous_current: Array | None = None) -> StereoTracks:
        self.told.append(T_previous_current)
        self.stamps_ns.append(frame.stamp_ns)
        return tracks(frame.stamp_ns)

    def overlay(self) -> ByteImage:
        return np.full((6, 16, 3), len(self.told), dtype=np.uint8)

    @property
    def counts(self) -> Mapping[str, int]:
        return {"detected": 3 * len(self.told)}


@dataclass
class Window:
    """A smoother that knows where the body is, starts at its second frame and makes every third frame a keyframe."""

    pushed: list[object] = field(default_factory=list)
    frames: int = 0
    latest_pose: Array | None = None
    keyframe_ns: int | None = None
    odometry: list[OdometryDelta | None] = field(default_factory=list)

    @property
    def counts(self) -> Mapping[str, int]:
        return {"keyframes": 1}

    def push_imu(self, sample: InertialReading) -> None:
        self.pushed.append(sample)

    def predicted_pose(self, stamp_ns: int) -> Array | None:
        return None if self.latest_pose is None else pose_at(stamp_ns)

    def push_tracks(self, tracks: StereoTracks, odometry: OdometryDelta | None = None) -> StateEstimate | None:
        self.pushed.append(tracks)
        self.odometry.append(odometry)
        self.frames += 1
        if self.frames % 3 == 1:
            self.keyframe_ns = tracks.stamp_ns
        if self.frames < 2:
            return None
        self.latest_pose = pose_at(tracks.stamp_ns)
        nav = NavState(self.latest_pose, *(np.zeros(3) for _ in range(4)))
        return StateEstimate(tracks.stamp_ns, nav, np.eye(9))

    def take_events(self) -> tuple[Event, ...]:
        return (Event(0, "blind", "dark"),)

    def take_health(self) -> tuple[KeyframeHealth, ...]:
        return (KeyframeHealth(0, 1, 2, 3, 4, 0.5, 6, 0.007, 8.0),)


@dataclass
class Integrator:
    """Notes where it was restarted."""

    restarts_ns: list[int] = field(default_factory=list)
    samples: int = 0

    def push(self, sample: BodyTwistSample) -> None:
        self.samples += 1

    def restart(self, stamp_ns: int) -> None:
        self.restarts_ns.append(stamp_ns)

    def delta_until(self, stamp_ns: int) -> OdometryDelta | None:
        return OdometryDelta(self.restarts_ns[-1], stamp_ns, np.eye(4), np.eye(6)) if self.restarts_ns else None


def test_it_keeps_a_diary_and_counts_for_its_stages() -> None:
    odometry = VisualOdometry(Window(), Eyes())
    odometry.push(frame(0))
    assert isinstance(odometry, SelfReporting)
    assert [event.kind for event in odometry.take_events()] == ["blind"]
    assert odometry.take_health()[0].iterations == 6
    assert odometry.counts == {"frames": 1, "frontend_detected": 3, "smoother_keyframes": 1}


def test_every_frame_is_answered_once_the_smoother_has_started() -> None:
    odometry = VisualOdometry(Window(), Eyes())
    answers = [odometry.push(frame(50 * MS * number)) for number in range(5)]
    assert answers[0] is None
    assert [answer.stamp_ns for answer in answers[1:] if answer is not None] == [50 * MS * n for n in range(1, 5)]


def test_the_front_end_is_told_how_the_left_camera_will_have_moved() -> None:
    eyes = Eyes()
    odometry = VisualOdometry(Window(), eyes)
    for number in range(4):
        odometry.push(frame(50 * MS * number))
    assert eyes.told[:2] == [None, None]
    for number, told in enumerate(eyes.told[2:], start=2):
        assert told is not None
        before, now = (pose_at(50 * MS * n) @ T_BODY_CAMERA for n in (number - 1, number))
        np.testing.assert_allclose(before @ told, now, atol=1e-12)


def test_readings_of_the_one_imu_go_to_the_smoother_before_their_frame() -> None:
    window = Window()
    odometry = VisualOdometry(window, Eyes(), imu_kind=CameraImuSample)
    readings = [CameraImuSample(stamp_ns, np.zeros(3), np.zeros(3)) for stamp_ns in (0, 5 * MS, 5 * MS, 4 * MS)]
    for sample in (*readings, ImuSample(6 * MS, np.zeros(3), np.zeros(3)), frame(7 * MS)):
        odometry.push(sample)
    odometry.push(JointSample(8 * MS, *np.zeros((3, 12))))
    assert window.pushed[:2] == readings[:2]
    assert isinstance(window.pushed[2], StereoTracks)
    assert len(window.pushed) == 3
    assert odometry.counts["imu_stamp_refused"] == 2


def test_a_frame_that_is_not_later_than_the_last_is_refused() -> None:
    window = Window()
    odometry = VisualOdometry(window, Eyes())
    for stamp_ns in (50 * MS, 50 * MS, 40 * MS, 60 * MS):
        odometry.push(frame(stamp_ns))
    assert window.frames == 2
    assert odometry.counts["frame_stamp_refused"] == 2


def test_tracks_go_past_the_front_end() -> None:
    window = Window()
    odometry = VisualOdometry(window)
    seen = [tracks(50 * MS * number) for number in range(3)]
    answers = [odometry.push(one) for one in seen]
    assert window.pushed == seen
    assert [answer is not None for answer in answers] == [False, True, True]
    assert odometry.push(frame(200 * MS)) is None
    assert odometry.counts["frame_without_frontend"] == 1


@pytest.mark.parametrize("offset_ms", [8, -8, 60])
def test_estimates_are_stamped_by_the_clock_of_the_imu(offset_ms: int) -> None:
    window = Window()
    odometry = VisualOdometry(window, Eyes(), imu_kind=ImuSample, time_offset_s=offset_ms * 1e-3)
    answers = []
    for stamp_ms in range(0, 600, 5):
        answers.append(odometry.push(ImuSample(stamp_ms * MS, np.zeros(3), np.zeros(3))))
        if stamp_ms % 50 == 0:
            answers.append(odometry.push(frame(stamp_ms * MS)))
    stamps_ns = [answer.stamp_ns for answer in answers if answer is not None]
    assert stamps_ns == [(50 * n + offset_ms) * MS for n in range(1, 1 + len(stamps_ns))]
    assert len(stamps_ns) >= 9
    in_order = [sample.stamp_ns for sample in window.pushed]
    assert in_order == sorted(in_order)


def test_frames_that_come_due_together_are_all_answered() -> None:
    """The IMU falls silent while three frames wait for it, and comes back."""
    odometry = VisualOdometry(Window(), Eyes(), imu_kind=ImuSample, time_offset_s=0.2)
    for stamp_ms in (0, 50, 100, 150):
        assert odometry.push(frame(stamp_ms * MS)) is None
    answers = [odometry.push(ImuSample((500 + n) * MS, np.zeros(3), np.zeros(3))) for n in range(4)]
    assert [answer.stamp_ns // MS for answer in answers if answer is not None] == [250, 300, 350]
    assert answers[3] is None


def test_a_twist_is_summed_up_from_keyframe_to_frame() -> None:
    window, integrator = Window(), Integrator()
    odometry = VisualOdometry(window, Eyes(), integrator)
    for number in range(7):
        odometry.push(BodyTwistSample(50 * MS * number, np.zeros(3), np.zeros(3)))
        odometry.push(frame(50 * MS * number))
    assert integrator.samples == 7
    assert integrator.restarts_ns == [0, 150 * MS, 300 * MS]
    assert window.odometry[0] is None
    spans = [(one.start_ns // MS, one.end_ns // MS) for one in window.odometry[1:] if one is not None]
    assert spans == [(0, 50), (0, 100), (0, 150), (150, 200), (150, 250), (150, 300)]


def test_pictures_are_of_every_nth_frame() -> None:
    shown: list[tuple[int, int]] = []
    odometry = VisualOdometry(Window(), Eyes())
    odometry.show(3, lambda stamp_ns, picture: shown.append((stamp_ns // MS, int(picture.flat[0]))))
    for number in range(7):
        odometry.push(frame(50 * MS * number))
    assert shown == [(0, 1), (150, 4), (300, 7)]
