# SPDX-License-Identifier: BSD-3-Clause
"""Failure is a state: whatever tracks and readings hold, there are finite estimates, events, and a recovery."""

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
    frames,
    in_order,
    play,
    pose_at,
    readings,
    renamed,
    scattered,
    sources_of,
    stamps_ns,
    without_right,
    without_tracks,
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
BOTH_MODES = pytest.mark.parametrize("has_imu", [True, False], ids=["vins", "stereo"])

Estimates = dict[int, StateEstimate | None]


def run(
    tracks: Iterable[StereoTracks], inertial: Iterable[InertialReading], has_imu: bool, end_s: float = END_S
) -> tuple[Played, Estimates]:
    smoother = SlidingWindowSmoother(RIG, None, IMU, sources_of(has_imu))
    measurements = in_order(tracks, inertial if has_imu else ())
    played = play(smoother, [each for each in measurements if each.stamp_ns < end_s * NS_PER_S])
    return played, played.estimates


def changed(
    start_s: float, end_s: float, change: Callable[[StereoTracks], StereoTracks], new_identities: bool = False
) -> list[StereoTracks]:
    """The walk with some frames changed; a tracker that lost all tracks begins with new identities afterwards."""
    result = []
    for tracks in TRACKS:
        time_s = tracks.stamp_ns / NS_PER_S
        if start_s <= time_s < end_s:
            result.append(change(tracks))
        else:
            result.append(renamed(tracks, 1_000_000) if new_identities and time_s >= end_s else tracks)
    return result


def wrong_tracks(tracks: StereoTracks) -> StereoTracks:
    """The same identities anywhere in the image, at any distance."""
    random = np.random.default_rng(tracks.stamp_ns)
    left_px = random.uniform((0.0, 0.0), (640.0, 480.0), (len(tracks), 2))
    disparity = np.column_stack((random.uniform(2.0, 60.0, len(tracks)), np.zeros(len(tracks))))
    return replace(tracks, left_px=left_px, right_px=left_px - disparity)


def wrong_disparities(tracks: StereoTracks) -> StereoTracks:
    """As in frame 0 of a real recording: the left image is correct, the right one belongs to another time."""
    disparity = tracks.left_px - tracks.right_px
    return replace(tracks, right_px=tracks.left_px - 2.5 * disparity - np.array([10.0, 0.0]))


def behind(tracks: StereoTracks) -> StereoTracks:
    """Every point to the right in the right image: behind the camera."""
    return replace(tracks, right_px=tracks.left_px + np.array([8.0, 0.0]))


def assert_sound(estimates: Estimates) -> None:
    """Finite numbers, a rotation matrix, and a positive definite covariance."""
    given = [estimate for estimate in estimates.values() if estimate is not None]
    assert given
    for estimate in given:
        T = estimate.nav.T_world_body
        assert np.isfinite(T).all()
        assert np.isfinite(estimate.nav.velocity_world).all()
        np.testing.assert_allclose(T[:3, :3] @ T[:3, :3].T, np.eye(3), atol=1e-6)
        assert np.isfinite(estimate.covariance).all()
        assert np.linalg.eigvalsh(estimate.covariance[:6, :6]).min() > 0.0


def steps(estimates: Estimates, start_s: float) -> tuple[Array, Array]:
    """Errors of the motion from frame to frame from ``start_s`` on: rad, (M,), and m, (M,)."""
    given = {
        stamp: estimate for stamp, estimate in estimates.items() if estimate is not None and stamp >= start_s * NS_PER_S
    }
    stamps = sorted(given)
    errors = []
    for before, now in pairwise(stamps):
        estimated = se3.inverse(given[before].nav.T_world_body) @ given[now].nav.T_world_body
        truth = se3.inverse(pose_at(WALKING, before)) @ pose_at(WALKING, now)
        errors.append(se3.log(se3.inverse(truth) @ estimated))
    rows = np.array(errors)
    return np.linalg.norm(rows[:, :3], axis=1), np.linalg.norm(rows[:, 3:], axis=1)


def assert_follows(estimates: Estimates, start_s: float, limit_m: float = 4e-3) -> None:
    """Half of the frames to 4 mm and 3 mrad; corrections of errors from before may still move some."""
    rotation, position = steps(estimates, start_s)
    assert len(rotation) >= 10
    assert np.median(rotation) < 3e-3
    assert np.median(position) < limit_m
    assert np.percentile(rotation, 80) < 0.02
    assert np.percentile(position, 80) < 0.05


@BOTH_MODES
def test_undisturbed_it_follows_without_any_event(has_imu: bool) -> None:
    played, estimates = run(TRACKS, READINGS, has_imu)
    assert_sound(estimates)
    assert_follows(estimates, 2.0)
    assert played.kinds == []
    assert None not in estimates.values()


@pytest.mark.long
@BOTH_MODES
@pytest.mark.parametrize("dark_s", [1.0, 10.0])
def test_a_blackout_is_an_event_and_vision_recovers(dark_s: float, has_imu: bool) -> None:
    end_s = 4.0 + dark_s
    played, estimates = run(changed(4.0, end_s, without_tracks, new_identities=True), READINGS, has_imu, end_s + 4.0)
    assert_sound(estimates)
    assert None not in estimates.values()
    assert played.kinds[0] == "vision_lost"
    assert played.kinds[-1] == "vision_recovered"
    assert played.counts["frames_without_vision"] >= 10 * dark_s
    assert_follows(estimates, end_s + 1.5)


def test_the_imu_bridges_a_second_without_vision() -> None:
    _, estimates = run(changed(4.0, 5.0, without_tracks, new_identities=True), READINGS, has_imu=True)
    last, after = estimates[3_900_000_000], estimates[5_500_000_000]
    assert last is not None
    assert after is not None
    travelled = se3.inverse(last.nav.T_world_body) @ after.nav.T_world_body
    truth = se3.inverse(pose_at(WALKING, 3_900_000_000)) @ pose_at(WALKING, 5_500_000_000)
    assert np.linalg.norm(truth[:3, 3]) > 0.4
    assert np.linalg.norm((se3.inverse(truth) @ travelled)[:3, 3]) < 0.06


@BOTH_MODES
def test_the_uncertainty_grows_without_vision(has_imu: bool) -> None:
    _, estimates = run(changed(4.0, 6.0, without_tracks, new_identities=True), READINGS, has_imu)
    sizes = [np.trace(estimates[stamp].covariance[3:6, 3:6]) for stamp in stamps_ns(3.9, 6.0, 5 * FRAME_NS)]
    assert np.all(np.diff(sizes) > 0.0)
    assert sizes[-1] > 4.0 * sizes[0]


def test_the_reason_of_the_front_end_is_in_the_event() -> None:
    played, _ = run(
        changed(4.0, 5.0, lambda each: replace(without_tracks(each), reason="a hand")),
        READINGS,
        has_imu=False,
    )
    assert "a hand" in played.events[0].detail


@pytest.mark.long
@BOTH_MODES
@pytest.mark.parametrize("new_identities", [False, True])
def test_two_seconds_of_wrong_tracks_are_an_event_and_are_recovered_from(new_identities: bool, has_imu: bool) -> None:
    played, estimates = run(changed(4.0, 6.0, wrong_tracks, new_identities), READINGS, has_imu)
    assert_sound(estimates)
    assert "vision_lost" in played.kinds
    assert_follows(estimates, 6.6, 6e-3)  # points placed by wrong tracks leave the window within half a second


def test_with_an_imu_the_error_from_wrong_tracks_is_bounded() -> None:
    _, estimates = run(changed(4.0, 6.0, wrong_tracks), READINGS, has_imu=True)
    last, after = estimates[3_900_000_000], estimates[6_500_000_000]
    assert last is not None
    assert after is not None
    travelled = se3.inverse(last.nav.T_world_body) @ after.nav.T_world_body
    truth = se3.inverse(pose_at(WALKING, 3_900_000_000)) @ pose_at(WALKING, 6_500_000_000)
    assert np.linalg.norm((se3.inverse(truth) @ travelled)[:3, 3]) < 0.3


@pytest.mark.long
@BOTH_MODES
@pytest.mark.parametrize("change", [behind, without_right])
def test_without_usable_disparities_frames_are_localised_by_the_left_camera_and_known_points(
    change: Callable[[StereoTracks], StereoTracks], has_imu: bool
) -> None:
    played, estimates = run(changed(4.0, 6.0, change), READINGS, has_imu)
    assert_sound(estimates)
    assert_follows(estimates, 4.0)
    assert played.kinds == []


@pytest.mark.long
@BOTH_MODES
@pytest.mark.parametrize("change", [behind, without_right, without_tracks])
def test_without_any_disparity_from_the_start_the_loss_of_vision_is_an_event(
    change: Callable[[StereoTracks], StereoTracks], has_imu: bool
) -> None:
    played, estimates = run(changed(-1.0, 4.0, change), READINGS, has_imu)
    assert "vision_lost" in played.kinds
    given = {stamp: estimate for stamp, estimate in estimates.items() if estimate is not None}
    assert_sound(given)
    assert_follows(estimates, 6.0)  # once there are disparities


@pytest.mark.long
@BOTH_MODES
@pytest.mark.parametrize("at_s", [0.0, 4.0])
def test_one_frame_whose_disparities_are_all_wrong_is_detected(at_s: float, has_imu: bool) -> None:
    played, estimates = run(changed(at_s, at_s + 0.05, wrong_disparities), READINGS, has_imu)
    assert_sound(estimates)
    assert "vision_lost" in played.kinds
    assert_follows(estimates, at_s + 1.5)


@BOTH_MODES
def test_stamps_that_come_twice_or_too_late_are_refused_and_counted(has_imu: bool) -> None:
    plain = [each for each in TRACKS if each.stamp_ns < 3 * NS_PER_S]
    inertial = [each for each in READINGS if each.stamp_ns < 3 * NS_PER_S]
    _, expected = run(plain, inertial, has_imu)
    smoother = SlidingWindowSmoother(RIG, None, IMU, sources_of(has_imu))
    for measurement in in_order(plain, inertial if has_imu else ()):
        if isinstance(measurement, StereoTracks):
            estimate = smoother.push_tracks(measurement).estimate
            assert estimate is not None
            for stamp_ns in (measurement.stamp_ns, measurement.stamp_ns - FRAME_NS // 2):
                refused = smoother.push_tracks(replace(measurement, stamp_ns=stamp_ns))
                assert (refused.estimate, refused.keyframe, refused.events, refused.health) == (None, None, (), ())
            np.testing.assert_array_equal(estimate.nav.T_world_body, expected[measurement.stamp_ns].nav.T_world_body)
        else:
            smoother.push_imu(measurement)
            smoother.push_imu(measurement)
    assert smoother.counts["frame_stamp_refused"] == 2 * len(plain)


def test_three_seconds_without_readings_are_an_event_and_vision_continues() -> None:
    with_pause = [each for each in READINGS if not 3.0 < each.stamp_ns / NS_PER_S < 6.0]
    played, estimates = run(TRACKS, with_pause, has_imu=True)
    assert_sound(estimates)
    assert set(played.kinds) == {"imu_gap"}
    assert_follows(estimates, 2.0)
    last = estimates[max(estimates)]
    assert last is not None
    np.testing.assert_allclose(last.nav.gyroscope_bias, IMU.T_body_imu[:3, :3] @ CHEAP_IMU.gyroscope_bias, atol=5e-3)


def test_without_any_reading_vision_alone_is_used() -> None:
    played, estimates = run(TRACKS, [], has_imu=True)
    assert_sound(estimates)
    assert {"moving_start", "imu_gap"} <= set(played.kinds)
    assert_follows(estimates, 3.0)


@pytest.mark.long
@pytest.mark.parametrize("size", [1e6, 1e200])
@pytest.mark.parametrize("at_s", [-0.4, 4.0], ids=["before the start", "on the way"])
def test_impossible_readings_have_no_effect(at_s: float, size: float) -> None:
    spoilt = [
        replace(each, specific_force=np.full(3, size), angular_velocity=np.full(3, -size))
        if at_s <= each.stamp_ns / NS_PER_S < at_s + 0.1
        else each
        for each in READINGS
    ]
    _, estimates = run(TRACKS, spoilt, has_imu=True)
    assert_sound(estimates)
    assert_follows(estimates, 2.0)


@pytest.mark.parametrize("force", [0.0, 500.0], ids=["dead", "saturated"])
def test_a_defective_accelerometer_raises_nothing(force: float) -> None:
    spoilt = [replace(each, specific_force=np.full(3, force)) for each in READINGS]
    played, estimates = run(TRACKS, spoilt, has_imu=True)
    assert_sound(estimates)
    assert played.kinds


@BOTH_MODES
def test_tracks_that_jump_from_frame_to_frame_raise_nothing(has_imu: bool) -> None:
    """Identities shuffled: every point is another one in every frame."""
    shuffled = []
    for tracks in TRACKS:
        random = np.random.default_rng(tracks.stamp_ns)
        shuffled.append(replace(tracks, track_ids=random.permutation(200)[: len(tracks)]))
    played, estimates = run(shuffled, READINGS, has_imu, 5.0)
    assert_sound(estimates)
    assert "vision_lost" in played.kinds


@BOTH_MODES
def test_pixels_far_outside_any_image_raise_nothing(has_imu: bool) -> None:
    far = changed(4.0, 5.0, lambda each: replace(each, left_px=1e7 * each.left_px, right_px=-1e7 * each.right_px))
    played, estimates = run(far, READINGS, has_imu)
    assert_sound(estimates)
    assert "vision_lost" in played.kinds
    assert_follows(estimates, 6.5)
