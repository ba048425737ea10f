# SPDX-License-Identifier: BSD-3-Clause
"""An analytic walk that is long enough to compare rotations, with sensors that can be made wrong."""

from collections.abc import Iterable
from dataclasses import replace
from functools import cache

import numpy as np
from walk_among_points import DAISY, NOISE_PX, RIG

from coclo_vio.geometry import se3, so3
from coclo_vio.simulation.analytic import AnalyticTrial, AnalyticTrialConfig, generate
from coclo_vio.simulation.body_motion import BodyMotionConfig
from coclo_vio.values.arrays import Array
from coclo_vio.values.calibration import RectifiedStereo
from coclo_vio.values.measurements import ImuSample, Measurement, StereoTracks
from coclo_vio.values.units import NS_PER_S

WALK = BodyMotionConfig(
    rest_s=1.0,
    walk_s=10.0,
    stop_s=0.0,
    ramp_s=0.6,
    speed_mps=0.2,
    curvature_per_m=1.0,
    sway_roll_rad=0.06,
    sway_pitch_rad=0.05,
    sway_period_s=1.2,
)
FRAME_NS = 100_000_000
_POINTS = np.random.default_rng(2).uniform((-6.0, -6.0, -1.0), (6.0, 6.0, 3.0), (3000, 3))


@cache
def trial() -> AnalyticTrial:
    return generate(AnalyticTrialConfig(body=WALK), DAISY, seed=6)


@cache
def stream() -> tuple[Measurement, ...]:
    """All measurements in time order, frames at 10 Hz."""
    stamps = range(3_000_000, int(trial().truth.stamps_ns[-1]), FRAME_NS)
    return in_order([*trial().measurements, *(_tracks(stamp_ns) for stamp_ns in stamps)])


def in_order(measurements: Iterable[Measurement]) -> tuple[Measurement, ...]:
    return tuple(sorted(measurements, key=lambda one: one.stamp_ns))


def turned_rig(turn: Array) -> RectifiedStereo:
    """Cameras whose calibration is turned by a rotation vector (3,) against the truth."""
    return RIG.moved(se3.transform(so3.exp(turn), np.zeros(3)))


def with_late_images(measurements: Iterable[Measurement], delay_s: float) -> tuple[Measurement, ...]:
    delay_ns = round(delay_s * NS_PER_S)
    return in_order(
        replace(one, stamp_ns=one.stamp_ns + delay_ns) if isinstance(one, StereoTracks) else one for one in measurements
    )


def with_offset_gyroscope(measurements: Iterable[Measurement], start_s: float, offset: Array) -> list[Measurement]:
    return [
        ImuSample(one.stamp_ns, one.angular_velocity + offset, one.specific_force)
        if isinstance(one, ImuSample) and one.stamp_ns > start_s * NS_PER_S
        else one
        for one in measurements
    ]


def with_reversed_gyroscope(measurements: Iterable[Measurement], start_s: float, end_s: float) -> list[Measurement]:
    """All axes of the IMU have the wrong sign for a time."""
    return [
        ImuSample(one.stamp_ns, -one.angular_velocity, -one.specific_force)
        if isinstance(one, ImuSample) and start_s * NS_PER_S < one.stamp_ns < end_s * NS_PER_S
        else one
        for one in measurements
    ]


def with_moving_scene(measurements: Iterable[Measurement], start_s: float, rate: float) -> list[Measurement]:
    """All that the cameras see turns about them, at a rate in rad/s about the vertical."""

    def moved(one: Measurement) -> Measurement:
        after_s = one.stamp_ns / NS_PER_S - start_s
        if not isinstance(one, StereoTracks) or after_s < 0.0:
            return one
        points = RIG.points(one.left_px, one.left_px[:, 0] - one.right_px[:, 0])
        left, disparity = RIG.pixels(points @ so3.exp(np.array([0.0, rate * after_s, 0.0])).T)
        return replace(one, left_px=left, right_px=left - np.column_stack((disparity, np.zeros(len(left)))))

    return [moved(one) for one in measurements]


def _tracks(stamp_ns: int) -> StereoTracks:
    """Pixels of the points between 0.8 and 5 m in front of the cameras."""
    stamps, poses = trial().truth.stamps_ns, trial().truth.T_world_body
    row = int(np.clip(np.searchsorted(stamps, stamp_ns), 1, len(stamps) - 1))
    share = (stamp_ns - stamps[row - 1]) / (stamps[row] - stamps[row - 1])
    pose = poses[row - 1] @ se3.exp(share * se3.log(se3.inverse(poses[row - 1]) @ poses[row]))
    in_camera = se3.apply(se3.inverse(pose @ RIG.T_body_camera), _POINTS)
    ahead = np.flatnonzero((in_camera[:, 2] > 0.8) & (in_camera[:, 2] < 5.0))
    left, disparity = RIG.pixels(in_camera[ahead])
    inside = ((left > 0.0) & (left < [640.0, 480.0])).all(axis=1)
    left, disparity, ids = left[inside][:80], disparity[inside][:80], ahead[inside][:80]
    random = np.random.default_rng(stamp_ns)
    left = left + NOISE_PX * random.standard_normal(left.shape)
    disparity = disparity + NOISE_PX * random.standard_normal(len(ids))
    return StereoTracks(stamp_ns, ids, left, left - np.column_stack((disparity, np.zeros(len(ids)))))
