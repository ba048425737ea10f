# SPDX-License-Identifier: BSD-3-Clause
"""Failure is a state: whatever tracks and readings hold, there are finite answers, a word of it, and a way back."""

from collections.abc import Callable, Iterable
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from worlds import (
    CHEAP_IMU,
    FRAME_NS,
    IMU,
    NS_PER_S,
    RIG,
    WALK,
    Played,
    blind,
    frames,
    in_order,
    play,
    pose_at,
    readings,
    renamed,
    scattered,
    stamps_ns,
    without_right,
)

from coclo_vio.backend.window.smoother import SlidingWindowSmoother
from coclo_vio.geometry import se3
from coclo_vio.values.arrays import Array
from coclo_vio.values.estimates import StateEstimate
from coclo_vio.values.measurements import InertialReading, StereoTracks

WALKING = WALK.model_copy(update={"walk_s": 30.0, "speed_mps": 0.3})
END_S, LONG_END_S = 8.0, 18.0
IMU_NS = 5_000_000
WORLD = scattered(count=600)
TRACKS = frames(WALKING, stamps_ns(0.0, LONG_END_S, FRAME_NS), WORLD, noise_px=0.2)
READINGS = readings(WALKING, stamps_ns(-0.5, LONG_END_S, IMU_NS), errors=CHEAP_IMU)
BOTH_MODES = pytest.mark.parametrize("uses_imu", [True, False], ids=["vins", "stereo"])

Answers = dict[int, StateEstimate | None]


def run(
    tracks: Iterable[StereoTracks], inertial: Iterable[InertialReading], uses_imu: bool, end_s: float = END_S
) -> tuple[Played, Answers]:
    smoother = SlidingWindowSmoother(RIG, None, IMU, uses_imu=uses_imu)
    measurements = in_order(tracks, inertial if uses_imu else ())
    played = play(smoother, [each for each in measurements if each.stamp_ns < end_s * NS_PER_S])
    return played, played.estimates


def changed(
    start_s: float, end_s: float, change: Callable[[StereoTracks], StereoTracks], new_identities: bool = False
) -> list[StereoTracks]:
    """The walk with some frames changed; a tracker that lost everything begins with new identities afterwards."""
    result = []
    for tracks in TRACKS:
        time_s = tracks.stamp_ns / NS_PER_S
        if start_s <= time_s < end_s:
            result.append(change(tracks))
        else:
            result.append(renamed(tracks, 1_000_000) if new_identities and time_s >= end_s else tracks)
    return result


def garbage(tracks: StereoTracks) -> StereoTracks:
    """The same identities anywhere in the image, at any distance."""
    random = np.random.default_rng(tracks.stamp_ns)
    left_px = random.uniform((0.0, 0.0), (640.0, 480.0), (len(tracks), 2))
    disparity = np.column_stack((random.uniform(2.0, 60.0, len(tracks)), np.zeros(len(tracks))))
    return replace(tracks, left_px=left_px, right_px=left_px - disparity)


def wrong_disparities(tracks: StereoTracks) -> StereoTracks:
    """As frame 0 of a real recording has them: the left image is right, the right one belongs to another time."""
    disparity = tracks.left_px - tracks.right_px
    return replace(tracks, right_px=tracks.left_px - 2.5 * disparity - np.array([10.0, 0.0]))


def behind(tracks: StereoTracks) -> StereoTracks:
    """Every point to the right in the right image: behind the camera."""
    return replace(tracks, right_px=tracks.left_px + np.array([8.0, 0.0]))


def assert_sound(answers: Answers) -> None:
    """Finite, a rotation, and a covariance that is one."""
    given = [answer for answer in answers.values() if answer is not None]
    assert given
    for answer in given:
        T = answer.nav.T_world_body
        assert np.isfinite(T).all()
        assert np.isfinite(answer.nav.velocity_world).all()
        np.testing.assert_allclose(T[:3, :3] @ T[:3, :3].T, np.eye(3), atol=1e-6)
        assert np.isfinite(answer.covariance).all()
        assert np.linalg.eigvalsh(answer.covariance[:6, :6]).min() > 0.0


def steps(answers: Answers, start_s: float) -> tuple[Array, Array]:
    """How far the motion from frame to frame is off from ``start_s`` on: rad, (M,), and m, (M,)."""
    given = {stamp: answer for stamp, answer in answers.items() if answer is not None and stamp >= start_s * NS_PER_S}
    stamps = sorted(given)
    errors = []
    for before, now in pairwise(stamps):
        estimated = se3.inverse(given[before].nav.T_world_body) @ given[now].nav.T_world_body
        truth = se3.inverse(pose_at(WALKING, before)) @ pose_at(WALKING, now)
        errors.append(se3.log(se3.inverse(truth) @ estimated))
    rows = np.array(errors)
    return np.linalg.norm(rows[:, :3], axis=1), np.linalg.norm(rows[:, 3:], axis=1)


def assert_follows(answers: Answers, start_s: float) -> None:
    """Half of the frames to 4 mm and 3 mrad; corrections of what went wrong before may still move some."""
    rotation, position = steps(answers, start_s)
    assert len(rotation) >= 10
    assert np.median(rotation) < 3e-3
    assert np.median(position) < 4e-3
    assert np.percentile(rotation, 80) < 0.02
    assert np.percentile(position, 80) < 0.05


@BOTH_MODES
def test_undisturbed_it_follows_and_has_nothing_to_tell(uses_imu: bool) -> None:
    played, answers = run(TRACKS, READINGS, uses_imu)
    assert_sound(answers)
    assert_follows(answers, 2.0)
    assert played.kinds == []
    assert None not in answers.values()


@BOTH_MODES
@pytest.mark.parametrize("dark_s", [1.0, 10.0])
def test_a_blackout_is_told_and_lived_through(dark_s: float, uses_imu: bool) -> None:
    end_s = 4.0 + dark_s
    played, answers = run(changed(4.0, end_s, blind, new_identities=True), READINGS, uses_imu, end_s + 4.0)
    assert_sound(answers)
    assert None not in answers.values()
    told = played.kinds
    assert told[0] == "blind"
    assert told[-1] == "sight"
    assert_follows(answers, end_s + 1.5)


def test_through_a_second_of_darkness_the_imu_carries_the_way() -> None:
    _, answers = run(changed(4.0, 5.0, blind, new_identities=True), READINGS, uses_imu=True)
    seen, after = answers[3_900_000_000], answers[5_500_000_000]
    assert seen is not None
    assert after is not None
    travelled = se3.inverse(seen.nav.T_world_body) @ after.nav.T_world_body
    truth = se3.inverse(pose_at(WALKING, 3_900_000_000)) @ pose_at(WALKING, 5_500_000_000)
    assert np.linalg.norm(truth[:3, 3]) > 0.4
    assert np.linalg.norm((se3.inverse(truth) @ travelled)[:3, 3]) < 0.06


@BOTH_MODES
def test_doubt_grows_in_the_dark(uses_imu: bool) -> None:
    _, answers = run(changed(4.0, 6.0, blind, new_identities=True), READINGS, uses_imu)
    sizes = [np.trace(answers[stamp].covariance[3:6, 3:6]) for stamp in stamps_ns(3.9, 6.0, 5 * FRAME_NS)]
    assert np.all(np.diff(sizes) > 0.0)
    assert sizes[-1] > 4.0 * sizes[0]


def test_a_reason_that_the_front_end_gives_is_passed_on() -> None:
    played, _ = run(changed(4.0, 5.0, lambda each: replace(blind(each), reason="a hand")), READINGS, uses_imu=False)
    assert "a hand" in played.events[0].detail


@BOTH_MODES
@pytest.mark.parametrize("new_identities", [False, True])
def test_two_seconds_of_garbage_are_told_and_left_behind(new_identities: bool, uses_imu: bool) -> None:
    played, answers = run(changed(4.0, 6.0, garbage, new_identities), READINGS, uses_imu)
    assert_sound(answers)
    assert "blind" in played.kinds
    assert_follows(answers, 6.6)


def test_with_an_imu_garbage_does_not_lead_far_astray() -> None:
    _, answers = run(changed(4.0, 6.0, garbage), READINGS, uses_imu=True)
    seen, after = answers[3_900_000_000], answers[6_500_000_000]
    assert seen is not None
    assert after is not None
    travelled = se3.inverse(seen.nav.T_world_body) @ after.nav.T_world_body
    truth = se3.inverse(pose_at(WALKING, 3_900_000_000)) @ pose_at(WALKING, 6_500_000_000)
    assert np.linalg.norm((se3.inverse(truth) @ travelled)[:3, 3]) < 0.3


@BOTH_MODES
@pytest.mark.parametrize("change", [behind, without_right])
def test_while_disparities_are_useless_the_left_camera_goes_on_with_the_points_that_are_known(
    change: Callable[[StereoTracks], StereoTracks], uses_imu: bool
) -> None:
    played, answers = run(changed(4.0, 6.0, change), READINGS, uses_imu)
    assert_sound(answers)
    assert_follows(answers, 4.0)
    assert played.kinds == []


@BOTH_MODES
@pytest.mark.parametrize("change", [behind, without_right, blind])
def test_without_any_disparity_from_the_start_nothing_is_raised_and_blindness_is_told(
    change: Callable[[StereoTracks], StereoTracks], uses_imu: bool
) -> None:
    played, answers = run(changed(-1.0, 4.0, change), READINGS, uses_imu)
    assert "blind" in played.kinds
    given = {stamp: answer for stamp, answer in answers.items() if answer is not None}
    assert_sound(given)
    assert_follows(answers, 6.0)  # once it can see, it does


@BOTH_MODES
@pytest.mark.parametrize("at_s", [0.0, 4.0])
def test_one_frame_whose_disparities_are_all_wrong_is_found_out(at_s: float, uses_imu: bool) -> None:
    played, answers = run(changed(at_s, at_s + 0.05, wrong_disparities), READINGS, uses_imu)
    assert_sound(answers)
    assert "blind" in played.kinds
    assert_follows(answers, at_s + 1.5)


@BOTH_MODES
def test_stamps_that_come_twice_or_too_late_are_refused_and_counted(uses_imu: bool) -> None:
    plain = [each for each in TRACKS if each.stamp_ns < 3 * NS_PER_S]
    inertial = [each for each in READINGS if each.stamp_ns < 3 * NS_PER_S]
    _, expected = run(plain, inertial, uses_imu)
    smoother = SlidingWindowSmoother(RIG, None, IMU, uses_imu=uses_imu)
    for event in in_order(plain, inertial if uses_imu else ()):
        if isinstance(event, StereoTracks):
            answer = smoother.push_tracks(event).estimate
            assert answer is not None
            for stamp_ns in (event.stamp_ns, event.stamp_ns - FRAME_NS // 2):
                refused = smoother.push_tracks(replace(event, stamp_ns=stamp_ns))
                assert (refused.estimate, refused.keyframe, refused.events, refused.health) == (None, None, (), ())
            np.testing.assert_array_equal(answer.nav.T_world_body, expected[event.stamp_ns].nav.T_world_body)
        else:
            smoother.push_imu(event)
            smoother.push_imu(event)
    assert smoother.counts["frame_stamp_refused"] == 2 * len(plain)


def test_three_seconds_without_readings_are_told_and_the_eyes_carry_on() -> None:
    silent = [each for each in READINGS if not 3.0 < each.stamp_ns / NS_PER_S < 6.0]
    played, answers = run(TRACKS, silent, uses_imu=True)
    assert_sound(answers)
    assert set(played.kinds) == {"imu_gap"}
    assert_follows(answers, 2.0)
    last = answers[max(answers)]
    assert last is not None
    np.testing.assert_allclose(last.nav.gyroscope_bias, IMU.T_body_imu[:3, :3] @ CHEAP_IMU.gyroscope_bias, atol=5e-3)


def test_an_imu_that_never_speaks_leaves_it_to_the_eyes() -> None:
    played, answers = run(TRACKS, [], uses_imu=True)
    assert_sound(answers)
    assert {"moving_start", "imu_gap"} <= set(played.kinds)
    assert_follows(answers, 3.0)


@pytest.mark.parametrize("size", [1e6, 1e200])
@pytest.mark.parametrize("at_s", [-0.4, 4.0], ids=["before the start", "on the way"])
def test_readings_of_absurd_size_do_not_matter(at_s: float, size: float) -> None:
    spoilt = [
        replace(each, specific_force=np.full(3, size), angular_velocity=np.full(3, -size))
        if at_s <= each.stamp_ns / NS_PER_S < at_s + 0.1
        else each
        for each in READINGS
    ]
    _, answers = run(TRACKS, spoilt, uses_imu=True)
    assert_sound(answers)
    assert_follows(answers, 2.0)


@pytest.mark.parametrize("force", [0.0, 500.0], ids=["dead", "stuck at its end"])
def test_an_accelerometer_that_lies_raises_nothing(force: float) -> None:
    spoilt = [replace(each, specific_force=np.full(3, force)) for each in READINGS]
    played, answers = run(TRACKS, spoilt, uses_imu=True)
    assert_sound(answers)
    assert played.kinds


@BOTH_MODES
def test_tracks_that_jump_from_frame_to_frame_raise_nothing(uses_imu: bool) -> None:
    """Identities shuffled: every point is another one in every frame."""
    shuffled = []
    for tracks in TRACKS:
        random = np.random.default_rng(tracks.stamp_ns)
        shuffled.append(replace(tracks, track_ids=random.permutation(200)[: len(tracks)]))
    played, answers = run(shuffled, READINGS, uses_imu, 5.0)
    assert_sound(answers)
    assert "blind" in played.kinds


@BOTH_MODES
def test_pixels_far_outside_any_image_raise_nothing(uses_imu: bool) -> None:
    far = changed(4.0, 5.0, lambda each: replace(each, left_px=1e7 * each.left_px, right_px=-1e7 * each.right_px))
    played, answers = run(far, READINGS, uses_imu)
    assert_sound(answers)
    assert "blind" in played.kinds
    assert_follows(answers, 6.5)
