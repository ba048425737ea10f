# SPDX-License-Identifier: BSD-3-Clause
"""A rig, points and a motion in closed form: exact or noisy tracks and IMU readings for the smoother."""

from collections.abc import Iterable
from dataclasses import dataclass, field, replace

import numpy as np

from coclo_vio.backend.window.config import SmootherConfig
from coclo_vio.backend.window.inertial_source import InertialSource
from coclo_vio.backend.window.keyframe_source import KeyframeSource
from coclo_vio.backend.window.smoother import SlidingWindowSmoother
from coclo_vio.geometry import se3
from coclo_vio.simulation.body_motion import BodyMotion, BodyMotionConfig
from coclo_vio.values.arrays import Array
from coclo_vio.values.calibration import ImuCalibration, RectifiedStereo
from coclo_vio.values.estimates import StateEstimate
from coclo_vio.values.measurements import ImuSample, InertialReading, StereoTracks
from coclo_vio.values.outputs import Event, KeyframeHealth
from coclo_vio.values.units import NS_PER_S

_OPTICAL = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])  # R_body_camera of a camera that looks ahead
RIG = RectifiedStereo(
    focal_px=(400.0, 410.0),
    principal_point_px=(320.0, 240.0),
    baseline_m=0.1,
    T_body_camera=se3.transform(_OPTICAL, np.array([0.1, 0.02, 0.05])) @ se3.exp(np.array([0.02, -0.1, 0.05, 0, 0, 0])),
)
IMU = ImuCalibration(position_body_m=(0.08, -0.05, 0.12), rotation_body_imu_rpy_rad=(0.3, -0.2, 1.1))
WALK = BodyMotionConfig(  # rest, then an arc with enough sway to separate gravity from acceleration
    rest_s=1.0,
    walk_s=8.0,
    stop_s=1.0,
    speed_mps=0.5,
    curvature_per_m=0.15,
    sway_period_s=2.0,
    sway_height_m=0.02,
    sway_roll_rad=0.05,
    sway_pitch_rad=0.04,
)
FRAME_NS = 100_000_000


@dataclass(frozen=True)
class ImuErrors:
    """Errors of an IMU: noise densities, and biases in its own frame."""

    gyroscope_noise_density: float = 0.0
    accelerometer_noise_density: float = 0.0
    gyroscope_bias: tuple[float, float, float] = (0.0, 0.0, 0.0)
    accelerometer_bias: tuple[float, float, float] = (0.0, 0.0, 0.0)


EXACT_IMU = ImuErrors()
CHEAP_IMU = ImuErrors(1e-3, 1e-2, (0.02, -0.03, 0.01), (0.05, 0.03, -0.04))


@dataclass(frozen=True, eq=False)
class World:
    """Points (N, 3) of the world, m; the tracks of a point have its index as identity."""

    points: Array

    def observed_from(self, stamp_ns: int, T_world_body: Array, noise_px: float = 0.0, seed: int = 0) -> StereoTracks:
        """Tracks of the rig: points 1 to 7 m away inside the left image of 640 by 480."""
        in_camera = se3.apply(se3.inverse(T_world_body @ RIG.T_body_camera), self.points)
        ahead = np.flatnonzero((in_camera[:, 2] > 1.0) & (in_camera[:, 2] < 7.0))
        left_px, disparity = RIG.pixels(in_camera[ahead])
        inside = ((left_px > 0.0) & (left_px < [640.0, 480.0])).all(axis=1)
        left_px, disparity, ids = left_px[inside], disparity[inside], ahead[inside]
        random = np.random.default_rng((seed, stamp_ns))
        left_px = left_px + noise_px * random.standard_normal(left_px.shape)
        disparity = disparity + 0.5 * noise_px * random.standard_normal(len(ids))
        return StereoTracks(stamp_ns, ids, left_px, left_px - np.column_stack((disparity, np.zeros(len(ids)))))


def scattered(seed: int = 1, count: int = 2200) -> World:
    """Points all around the paths of the tests; about 80 are in view at a time."""
    random = np.random.default_rng(seed)
    return World(random.uniform((-6.0, -9.0, -3.0), (12.0, 12.0, 3.0), (count, 3)))


def pose_at(config: BodyMotionConfig, stamp_ns: int) -> Array:
    """The true ``T_world_body``, (4, 4); at rest at the beginning it is the identity."""
    state = BodyMotion(config, 0.0).at(np.array([stamp_ns / NS_PER_S]))
    return se3.transform(state.rotation[0], state.position[0])


def velocity_at(config: BodyMotionConfig, stamp_ns: int) -> Array:
    """The true velocity of the body origin, m/s, world, (3,)."""
    return BodyMotion(config, 0.0).at(np.array([stamp_ns / NS_PER_S])).velocity[0]


def frames(
    config: BodyMotionConfig, stamps_ns: Iterable[int], world: World, noise_px: float = 0.0
) -> list[StereoTracks]:
    """Tracks at each stamp."""
    return [world.observed_from(stamp_ns, pose_at(config, stamp_ns), noise_px) for stamp_ns in stamps_ns]


def readings(
    config: BodyMotionConfig,
    stamps_ns: Iterable[int],
    imu: ImuCalibration = IMU,
    errors: ImuErrors = EXACT_IMU,
    seed: int = 3,
) -> list[ImuSample]:
    """IMU readings at each stamp."""
    stamps = np.array(list(stamps_ns), dtype=np.int64)
    state = BodyMotion(config, 0.0).at(stamps / NS_PER_S)
    R_body_imu, lever = imu.T_body_imu[:3, :3], imu.T_body_imu[:3, 3]
    rate, force = state.angular_velocity @ R_body_imu, state.specific_force_at(lever) @ R_body_imu
    random = np.random.default_rng(seed)
    per_root_s = 1.0 / np.sqrt(np.diff(stamps).mean() / NS_PER_S)
    rate = rate + errors.gyroscope_bias
    rate = rate + errors.gyroscope_noise_density * per_root_s * random.standard_normal(rate.shape)
    force = force + errors.accelerometer_bias
    force = force + errors.accelerometer_noise_density * per_root_s * random.standard_normal(force.shape)
    return [ImuSample(int(stamp), w, f) for stamp, w, f in zip(stamps, rate, force, strict=True)]


def stamps_ns(start_s: float, end_s: float, step_ns: int) -> range:
    """Stamps from ``start_s`` on, before ``end_s``."""
    return range(round(start_s * NS_PER_S), round(end_s * NS_PER_S), step_ns)


def sources_of(has_imu: bool) -> list[KeyframeSource]:
    """Of ``vins``: the IMU; of ``stereo``: none."""
    return [InertialSource(IMU, SmootherConfig())] if has_imu else []


def in_order(
    tracks: Iterable[StereoTracks], inertial: Iterable[InertialReading] = ()
) -> list[StereoTracks | InertialReading]:
    """Everything by time; at one time the reading before the frame."""
    together: list[StereoTracks | InertialReading] = [*inertial, *tracks]
    return sorted(together, key=lambda event: (event.stamp_ns, isinstance(event, StereoTracks)))


@dataclass(frozen=True, eq=False)
class Played:
    """Outputs of a smoother for a recording: estimates by the stamp of the frame, events, health, counts."""

    estimates: dict[int, StateEstimate | None] = field(default_factory=dict)
    events: list[Event] = field(default_factory=list)
    health: list[KeyframeHealth] = field(default_factory=list)
    counts: dict[str, int] = field(default_factory=dict)

    @property
    def kinds(self) -> list[str]:
        """The kinds of the events."""
        return [event.kind for event in self.events]


def play(smoother: SlidingWindowSmoother, measurements: Iterable[StereoTracks | InertialReading]) -> Played:
    """Push everything."""
    played = Played()
    for measurement in measurements:
        if isinstance(measurement, StereoTracks):
            result = smoother.push_tracks(measurement)
            played.estimates[measurement.stamp_ns] = result.estimate
            played.events.extend(result.events)
            played.health.extend(result.health)
        else:
            smoother.push_imu(measurement)
    played.counts.update(smoother.counts)
    return played


def without_tracks(tracks: StereoTracks) -> StereoTracks:
    """A frame without any track."""
    nothing = np.zeros((0, 2))
    return StereoTracks(tracks.stamp_ns, np.zeros(0, dtype=np.int64), nothing, nothing)


def renamed(tracks: StereoTracks, offset: int) -> StereoTracks:
    """The same points under new identities, as after a loss of all tracks."""
    return replace(tracks, track_ids=tracks.track_ids + offset)


def without_right(tracks: StereoTracks) -> StereoTracks:
    """A frame without matches in the right image."""
    return replace(tracks, right_px=np.full_like(tracks.right_px, np.nan))


def pose_errors(estimates: dict[int, StateEstimate | None], config: BodyMotionConfig) -> dict[int, Array]:
    """[rotation rad, position m] (6,) of each estimate; the first one is aligned with the truth."""
    given = {stamp: estimate for stamp, estimate in estimates.items() if estimate is not None}
    first = next(iter(given))
    T_truth_estimate = pose_at(config, first) @ se3.inverse(given[first].nav.T_world_body)
    return {
        stamp: se3.log(se3.inverse(pose_at(config, stamp)) @ T_truth_estimate @ estimate.nav.T_world_body)
        for stamp, estimate in given.items()
    }


def worst(errors: dict[int, Array]) -> tuple[float, float]:
    """The largest rotation error, rad, and the largest position error, m."""
    rows = np.array(list(errors.values()))
    return float(np.linalg.norm(rows[:, :3], axis=1).max()), float(np.linalg.norm(rows[:, 3:], axis=1).max())
