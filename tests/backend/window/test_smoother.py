# SPDX-License-Identifier: BSD-3-Clause
"""The whole smoother on motions known in closed form: exact data, rest, starts, odometry, reports, memory."""

from dataclasses import replace

import numpy as np
import pytest
from worlds import (
    CHEAP_IMU,
    FRAME_NS,
    IMU,
    NS_PER_S,
    RIG,
    WALK,
    frames,
    in_order,
    play,
    pose_at,
    pose_errors,
    readings,
    scattered,
    stamps_ns,
    velocity_at,
    without_tracks,
    worst,
)

from coclo_vio.backend.window.config import PixelNoiseConfig, SmootherConfig
from coclo_vio.backend.window.inertial_source import InertialSource
from coclo_vio.backend.window.smoother import SlidingWindowSmoother
from coclo_vio.geometry import se3, so3
from coclo_vio.simulation.body_motion import BodyMotionConfig
from coclo_vio.values.keyframes import OdometryDelta

IMU_NS = 5_000_000
SHARP = SmootherConfig(  # smaller than the noise of the constant-velocity model, from which the exact motion deviates
    noise=PixelNoiseConfig(track_px=0.02, disparity_px=0.02, repeated_disparity_px=0.02), tolerance=0.0, iterations=6
)
STANDING = BodyMotionConfig(walk_s=0.0)
STEADY_IMU = replace(CHEAP_IMU, gyroscope_noise_density=2e-4)
WORLD = scattered(count=700)


def stereo(config: SmootherConfig | None = None) -> SlidingWindowSmoother:
    return SlidingWindowSmoother(RIG, config, IMU)


def vins(config: SmootherConfig | None = None) -> SlidingWindowSmoother:
    return SlidingWindowSmoother(RIG, config, IMU, [InertialSource(IMU, config or SmootherConfig())])


def test_before_the_first_frame_there_is_no_pose() -> None:
    assert stereo().latest_pose is None
    assert stereo().keyframe_ns is None
    assert stereo().predicted_pose(0) is None


def test_exact_tracks_are_followed() -> None:
    """4 m along an arc with sway: the error left is that of the constant-velocity factor."""
    smoother = stereo(SHARP)
    played = play(smoother, frames(WALK, stamps_ns(0.0, 10.0, FRAME_NS), WORLD))
    estimates = played.estimates
    assert None not in estimates.values()
    rotation, position = worst(pose_errors(estimates, WALK))
    assert rotation < 1e-7
    assert position < 1e-6
    assert played.events == []


def test_exact_tracks_and_readings_are_followed_from_rest() -> None:
    """Up to the error of linear interpolation. The onset is detected two frames late, and no motion is lost."""
    smoother = vins()
    tracks = frames(WALK, stamps_ns(0.0, 8.0, FRAME_NS), WORLD)
    estimates = play(smoother, in_order(tracks, readings(WALK, stamps_ns(-0.5, 8.0, IMU_NS)))).estimates
    assert None not in estimates.values()
    errors = pose_errors(estimates, WALK)
    onset = {stamp: error for stamp, error in errors.items() if stamp < 1_300_000_000}
    moving = {stamp: error for stamp, error in errors.items() if stamp >= 1_300_000_000}
    assert max(worst(onset)) < 5e-3
    assert max(worst(moving)) < 6e-4
    velocity = [estimates[stamp].nav.velocity_world - velocity_at(WALK, stamp) for stamp in moving]
    assert np.abs(velocity).max() < 1e-3
    last = estimates[max(estimates)].nav
    np.testing.assert_allclose(last.gyroscope_bias, 0.0, atol=1e-4)
    assert smoother.counts["standstill_frames"] > 5


def test_the_world_starts_at_the_first_frame_with_its_heading_and_level() -> None:
    """A body that rolls and pitches while it stands: the accelerometer measures both, through the IMU's mounting."""
    tilted = so3.exp(np.array([0.0, 0.2, 0.0])) @ so3.exp(np.array([0.1, 0.0, 0.0]))
    up = IMU.T_body_imu[:3, :3].T @ tilted.T @ np.array([0.0, 0.0, 9.81])
    at_rest = readings(STANDING, stamps_ns(-0.5, 0.05, IMU_NS))
    tracks = frames(STANDING, [0], WORLD)
    for smoother in (vins(), stereo()):
        for each in at_rest:
            smoother.push_imu(type(each)(each.stamp_ns, each.angular_velocity, up))
        estimate = smoother.push_tracks(tracks[0]).estimate
        assert estimate is not None
        np.testing.assert_allclose(estimate.nav.T_world_body, se3.transform(tilted, np.zeros(3)), atol=1e-9)
        assert estimate.stamp_ns == smoother.keyframe_ns == 0


def test_without_an_accelerometer_the_first_frame_defines_the_world() -> None:
    estimate = stereo().push_tracks(frames(WALK, [4 * NS_PER_S], WORLD)[0]).estimate
    assert estimate is not None
    np.testing.assert_array_equal(estimate.nav.T_world_body, np.eye(4))


def test_a_start_in_motion_estimates_gravity_before_the_first_output() -> None:
    smoother = vins()
    tracks = frames(WALK, stamps_ns(3.0, 8.0, FRAME_NS), WORLD)
    played = play(smoother, in_order(tracks, readings(WALK, stamps_ns(2.5, 8.0, IMU_NS))))
    estimates = played.estimates
    without_output = [stamp for stamp, estimate in estimates.items() if estimate is None]
    start = smoother.config.start
    waited_s = (max(without_output) - min(without_output) + FRAME_NS) / NS_PER_S
    assert waited_s == pytest.approx(start.rest_timeout_s + start.alignment_s)
    for stamp, estimate in estimates.items():
        if estimate is not None:
            up, truth = estimate.nav.T_world_body[2, :3], pose_at(WALK, stamp)[2, :3]
            assert np.rad2deg(np.arccos(np.clip(up @ truth, -1.0, 1.0))) < 1.0
    assert max(worst(pose_errors(estimates, WALK))) < 0.02
    assert played.kinds == ["moving_start"]


def test_at_rest_the_pose_is_constant_and_the_gyroscope_bias_is_estimated() -> None:
    smoother = vins()
    tracks = frames(STANDING, stamps_ns(0.0, 60.0, 2 * FRAME_NS), WORLD, noise_px=0.3)
    at_rest = readings(STANDING, stamps_ns(-0.5, 60.0, 2 * IMU_NS), errors=STEADY_IMU)
    played = play(smoother, in_order(tracks, at_rest))
    estimates = played.estimates
    rotation, position = worst(pose_errors(estimates, STANDING))
    assert rotation < 1e-3
    assert position < 1e-3
    last = estimates[max(estimates)].nav
    np.testing.assert_allclose(last.gyroscope_bias, IMU.T_body_imu[:3, :3] @ STEADY_IMU.gyroscope_bias, atol=1e-3)
    np.testing.assert_allclose(last.velocity_world, 0.0, atol=1e-3)
    assert smoother.counts["standstill_frames"] > 0.95 * len(tracks)
    assert len(played.health) < 5


def test_after_a_long_rest_motion_is_followed() -> None:
    rested = WALK.model_copy(update={"rest_s": 10.0, "walk_s": 4.0})
    smoother = vins()
    tracks = frames(rested, stamps_ns(0.0, 14.0, FRAME_NS), WORLD, noise_px=0.1)
    inertial = readings(rested, stamps_ns(-0.5, 14.0, IMU_NS), errors=CHEAP_IMU)
    estimates = play(smoother, in_order(tracks, inertial)).estimates
    errors = pose_errors(estimates, rested)
    assert np.linalg.norm(pose_at(rested, max(errors))[:3, 3]) > 1.0
    assert max(np.linalg.norm(error[3:]) for error in errors.values()) < 0.03
    assert max(np.linalg.norm(error[:3]) for error in errors.values()) < np.deg2rad(2.5)


def test_the_estimate_is_consistent_with_its_covariance() -> None:
    """White noise as configured: normalised error squared over three worlds and 6 numbers each; it is conservative."""
    noise = PixelNoiseConfig(track_px=0.5, disparity_px=0.25, repeated_disparity_px=0.25)
    squares = []
    for seed in range(3):
        tracks = [
            scattered(seed, 800).observed_from(stamp, pose_at(WALK, stamp), noise_px=0.5, seed=seed)
            for stamp in stamps_ns(1.0, 5.0, FRAME_NS)
        ]
        estimates = play(stereo(SmootherConfig(noise=noise)), tracks).estimates
        last = max(estimates)
        error = pose_errors(estimates, WALK)[last]
        squares.append(error @ np.linalg.solve(estimates[last].covariance[:6, :6], error) / 6.0)
    assert 0.005 < np.mean(squares) < 1.5


def test_a_wrong_baseline_is_in_the_covariance_along_the_way_from_the_begin() -> None:
    """Cameras whose lengths are 1 % too long, twice the sigma."""
    tracks = frames(WALK, stamps_ns(1.0, 6.0, FRAME_NS), WORLD)
    stretched = [
        replace(each, right_px=each.left_px - (each.left_px - each.right_px) * np.array([1.0 / 1.01, 1.0]))
        for each in tracks
    ]
    noise = PixelNoiseConfig(ample_tracks=1)  # few tracks, all of points of the world
    exact, open_scale = (
        play(stereo(SmootherConfig(stereo_scale_sigma=sigma, noise=noise)), stretched).estimates
        for sigma in (0.0, 0.005)
    )
    first, last = min(exact), max(exact)
    T = exact[last].nav.T_world_body
    along = T[:3, :3].T @ (T[:3, 3] - exact[first].nav.T_world_body[:3, 3])
    added = (open_scale[last].covariance - exact[last].covariance)[3:6, 3:6]
    np.testing.assert_allclose(added, 0.005**2 * np.outer(along, along), atol=1e-12)
    error = pose_errors(exact, WALK)[last][3:]
    squared = [error @ np.linalg.solve(each[last].covariance[3:6, 3:6], error) for each in (exact, open_scale)]
    assert squared[1] < 0.5 * squared[0]


def test_a_prediction_is_accurate_and_changes_nothing() -> None:
    tracks = frames(WALK, stamps_ns(0.0, 5.0, FRAME_NS), WORLD)
    events = in_order(tracks, readings(WALK, stamps_ns(-0.5, 5.0, IMU_NS)))
    plain, queried = vins(), vins()
    estimates = play(plain, events).estimates
    for event in events:
        if event in tracks:
            expected = queried.predicted_pose(event.stamp_ns)
            if expected is not None and event.stamp_ns > 2 * NS_PER_S:
                off = se3.log(se3.inverse(estimates[event.stamp_ns].nav.T_world_body) @ expected)
                assert np.abs(off).max() < 1e-3
            estimate = queried.push_tracks(event).estimate
            np.testing.assert_array_equal(estimate.nav.T_world_body, estimates[event.stamp_ns].nav.T_world_body)
        else:
            queried.push_imu(event)


def walked(smoother: SlidingWindowSmoother, sigma: float, shift: float = 0.0, late_ns: int = 0) -> None:
    """Exact tracks, and odometry since the keyframe with the sigma ``sigma`` and an error ``shift`` along x."""
    for tracks in frames(WALK, stamps_ns(2.0, 6.0, FRAME_NS), WORLD):
        delta, start_ns = None, smoother.keyframe_ns
        if start_ns is not None:
            T = se3.inverse(pose_at(WALK, start_ns)) @ pose_at(WALK, tracks.stamp_ns)
            T[0, 3] += shift
            delta = OdometryDelta(start_ns - late_ns, tracks.stamp_ns, T, sigma**2 * np.eye(6))
        smoother.push_tracks(tracks, delta)


def test_odometry_is_weighted_by_its_covariance() -> None:
    """Off by 20 mm from keyframe to keyframe: a sigma of 0.1 mm spoils the estimate, one of a metre does not."""
    ends = []
    for sigma in (1e-4, 1.0):
        smoother = stereo()
        walked(smoother, sigma, shift=0.02)
        truth = se3.inverse(pose_at(WALK, 2 * NS_PER_S)) @ pose_at(WALK, 5_900_000_000)
        ends.append(np.linalg.norm((se3.inverse(truth) @ smoother.latest_pose)[:3, 3]))
    assert ends[0] > 0.1
    assert ends[1] < 1e-3


def test_odometry_that_does_not_start_at_the_keyframe_is_refused() -> None:
    smoother = stereo()
    walked(smoother, 1e-4, shift=0.5, late_ns=1)
    truth = se3.inverse(pose_at(WALK, 2 * NS_PER_S)) @ pose_at(WALK, 5_900_000_000)
    assert smoother.counts["odometry_refused"] == smoother.counts["frames"] - 1
    assert np.linalg.norm((se3.inverse(truth) @ smoother.latest_pose)[:3, 3]) < 1e-3


def test_odometry_bridges_a_time_without_vision() -> None:
    """A second without a track: the constant-velocity model misses the turn, odometry does not."""
    smoother = stereo()
    for tracks in frames(WALK, stamps_ns(2.0, 6.0, FRAME_NS), WORLD):
        delta, start_ns = None, smoother.keyframe_ns
        if start_ns is not None:
            T = se3.inverse(pose_at(WALK, start_ns)) @ pose_at(WALK, tracks.stamp_ns)
            delta = OdometryDelta(start_ns, tracks.stamp_ns, T, 1e-6 * np.eye(6))
        shown = without_tracks(tracks) if 4.0 <= tracks.stamp_ns / NS_PER_S < 5.0 else tracks
        estimate = smoother.push_tracks(shown, delta).estimate
        truth = se3.inverse(pose_at(WALK, 2 * NS_PER_S)) @ pose_at(WALK, tracks.stamp_ns)
        assert np.linalg.norm((se3.inverse(truth) @ estimate.nav.T_world_body)[:3, 3]) < 2e-3


def test_every_keyframe_has_its_health_once() -> None:
    smoother = stereo()
    tracks = frames(WALK, stamps_ns(2.0, 5.0, FRAME_NS), WORLD)
    health = play(smoother, tracks).health
    assert smoother.counts["keyframes"] == len(health)
    assert smoother.counts["frames"] == len(tracks)
    assert np.all(np.diff([each.stamp_ns for each in health]) > 0)
    for each in health:
        assert 1 <= each.keyframes <= smoother.config.keyframes
        assert each.iterations >= 1
        assert each.factors >= each.landmarks
        assert each.reprojection_px < 0.1
        assert each.compute_s >= 0.0
        assert each.condition >= 1.0
    assert max(each.tracks for each in health) > 40


def test_the_same_input_gives_the_same_bits() -> None:
    tracks = frames(WALK, stamps_ns(0.0, 4.0, FRAME_NS), WORLD, noise_px=0.5)
    events = in_order(tracks, readings(WALK, stamps_ns(-0.5, 4.0, IMU_NS), errors=CHEAP_IMU))
    first, second = play(vins(), events).estimates, play(vins(), events).estimates
    assert first.keys() == second.keys()
    for stamp, estimate in first.items():
        assert estimate is not None
        np.testing.assert_array_equal(estimate.nav.T_world_body, second[stamp].nav.T_world_body)
        np.testing.assert_array_equal(estimate.covariance, second[stamp].covariance)


def lengths(thing: object, visited: set[int], depth: int = 0) -> dict[str, int]:
    """The length of every container that can be reached from an object of this package, by its name."""
    if id(thing) in visited or depth > 7:
        return {}
    visited.add(id(thing))
    names = [*getattr(thing, "__dict__", {}), *getattr(type(thing), "__slots__", ())]
    found: dict[str, int] = {}
    for name in names:
        inside = getattr(thing, name, None)
        if hasattr(inside, "__len__") and not isinstance(inside, str | np.ndarray):
            found[f"{type(thing).__name__}.{name}"] = len(inside)
        if type(inside).__module__.startswith("coclo_vio.backend"):
            found |= lengths(inside, visited, depth + 1)
    return found


@pytest.mark.long
def test_memory_does_not_grow_over_a_thousand_frames() -> None:
    """An endless corridor: points that repeat under new identities."""
    random = np.random.default_rng(5)
    corridor = random.uniform((0.0, -3.0, -1.5), (10.0, 3.0, 1.5), (40, 3))
    smoother = stereo(SmootherConfig(keyframes=3, iterations=1))
    sizes = []
    for number in range(1000):
        start = 0.05 * number
        laps = np.floor(start / 10.0) + np.arange(2)
        points = np.concatenate([corridor + np.array([10.0 * lap, 0.0, 0.0]) for lap in laps])
        ids = np.concatenate([np.arange(40) + 40 * int(lap) for lap in laps])
        T = se3.transform(np.eye(3), np.array([start, 0.0, 0.0]))
        tracks = type(WORLD)(points).observed_from(number * FRAME_NS, T)
        smoother.push_tracks(type(tracks)(tracks.stamp_ns, ids[tracks.track_ids], tracks.left_px, tracks.right_px))
        if number % 50 == 49:
            sizes.append(lengths(smoother, set()))
    error = np.abs(smoother.latest_pose[:3, 3] - [49.95, 0.0, 0.0]).max()
    assert error < 0.5  # of 50 m travelled
    assert len(sizes[0]) > 10
    for name in sizes[-1]:
        early = max(size.get(name, 0) for size in sizes[:5])
        late = max(size.get(name, 0) for size in sizes[-5:])
        assert late <= 2 * early + 10, name
