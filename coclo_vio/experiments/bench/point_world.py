# SPDX-License-Identifier: BSD-3-Clause
"""Stereo tracks and IMU readings of a rectified rig that moves among points: vision without images, of any size."""

from collections.abc import Iterator

import numpy as np

from coclo_vio.experiments.bench.rectified_pair import (
    FOCAL_PX,
    HEIGHT_PX,
    LOOKS_AHEAD,
    PRINCIPAL_POINT_PX,
    WIDTH_PX,
    rectified_pair,
)
from coclo_vio.geometry import se3
from coclo_vio.simulation.body_motion import BodyMotion, BodyMotionConfig
from coclo_vio.values.arrays import Array
from coclo_vio.values.calibration import ImuCalibration, StereoCalibration
from coclo_vio.values.measurements import CameraImuSample, Measurement, StereoTracks
from coclo_vio.values.units import NS_PER_S

_BASELINE_M = 0.1
_NEAREST_M, _FARTHEST_M = 1.0, 7.0
_HALF_SIDE_M = 11.0
_NOISE_PX, _DISPARITY_NOISE_PX = 0.3, 0.15
_POINTS_PER_TRACK = 90.0  # in the world, for one in view
_FRAME_NS = NS_PER_S // 10
_READINGS_PER_FRAME = 20
_CIRCLE = BodyMotionConfig(
    rest_s=1.0, walk_s=3600.0, speed_mps=0.5, curvature_per_m=0.2, sway_period_s=2.0, sway_roll_rad=0.03
)


def rig() -> StereoCalibration:
    """The rectified pair, looking ahead."""
    return rectified_pair(LOOKS_AHEAD, _BASELINE_M)


def imu() -> ImuCalibration:
    """The camera's IMU, at the body's origin."""
    return ImuCalibration()


def tracked_walk(tracks: int, frames: int, seed: int = 1) -> Iterator[Measurement]:
    """Readings of the camera's IMU and tracks at 10 Hz, in order: a rest of a second, then circles.

    Args:
        tracks: most tracks in a frame; about as many are in view.
        frames: number of frames.
        seed: of the points and of all noise.
    """
    random = np.random.default_rng(seed)
    corner = np.array([_HALF_SIDE_M, _HALF_SIDE_M, 3.0])
    centre = np.array([0.0, 1.0 / _CIRCLE.curvature_per_m, 0.0])
    points = centre + random.uniform(-corner, corner, (round(_POINTS_PER_TRACK * tracks), 3))
    motion, calibration = BodyMotion(_CIRCLE, 0.0), imu()
    density = np.sqrt(_READINGS_PER_FRAME * NS_PER_S / _FRAME_NS)
    step_ns = _FRAME_NS // _READINGS_PER_FRAME
    for frame in range(frames):
        stamps_ns = (frame - 1) * _FRAME_NS + step_ns * np.arange(1, _READINGS_PER_FRAME + 1)
        body = motion.at(stamps_ns / NS_PER_S)
        force = body.specific_force_at(np.zeros(3))
        rate_noise, force_noise = (
            density * sigma * random.standard_normal((len(stamps_ns), 3))
            for sigma in (calibration.gyroscope_noise_density, calibration.accelerometer_noise_density)
        )
        for index, stamp_ns in enumerate(stamps_ns):
            if stamp_ns >= 0:
                rate = body.angular_velocity[index] + rate_noise[index]
                yield CameraImuSample(int(stamp_ns), rate, force[index] + force_noise[index])
        T_world_body = se3.transform(body.rotation[-1], body.position[-1])
        yield _observed(int(stamps_ns[-1]), points, T_world_body, tracks, random)


def _observed(
    stamp_ns: int, points: Array, T_world_body: Array, most: int, random: np.random.Generator
) -> StereoTracks:
    """Tracks of the points in view; where there are too many, those of the smallest identities, so that they last."""
    calibration = rig()
    in_camera = se3.apply(se3.inverse(T_world_body @ calibration.T_body_left_camera), points)
    ids = np.flatnonzero((in_camera[:, 2] > _NEAREST_M) & (in_camera[:, 2] < _FARTHEST_M))
    depth = in_camera[ids, 2]
    left_px = FOCAL_PX * in_camera[ids, :2] / depth[:, None] + PRINCIPAL_POINT_PX
    is_inside = ((left_px > 0.0) & (left_px < (WIDTH_PX, HEIGHT_PX))).all(axis=1)
    ids, left_px, depth = ids[is_inside][:most], left_px[is_inside][:most], depth[is_inside][:most]
    left_px = left_px + _NOISE_PX * random.standard_normal(left_px.shape)
    disparity = FOCAL_PX * _BASELINE_M / depth + _DISPARITY_NOISE_PX * random.standard_normal(len(ids))
    return StereoTracks(stamp_ns, ids, left_px, left_px - np.column_stack((disparity, np.zeros(len(ids)))))
