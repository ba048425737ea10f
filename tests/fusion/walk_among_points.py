# SPDX-License-Identifier: BSD-3-Clause
"""An analytic walk of a Daisy among points whose pixels are known up to noise, and combined odometry on it."""

from collections.abc import Iterable
from dataclasses import replace
from functools import cache

import numpy as np

from coclo_vio.backend.window.config import SmootherConfig
from coclo_vio.backend.window.smoother import SlidingWindowSmoother
from coclo_vio.filter.config import FilterConfig
from coclo_vio.filter.odometry import LegOdometryFilter
from coclo_vio.fusion.combined import CombinedOdometry
from coclo_vio.fusion.config import BridgeConfig
from coclo_vio.fusion.streaming import StreamingEstimator
from coclo_vio.geometry import se3, so3
from coclo_vio.robot.description import load_robot
from coclo_vio.robot.model import RobotModel
from coclo_vio.simulation.analytic import AnalyticTrial, AnalyticTrialConfig, generate
from coclo_vio.simulation.body_motion import BodyMotionConfig
from coclo_vio.values.arrays import Array
from coclo_vio.values.calibration import RectifiedStereo
from coclo_vio.values.estimates import StateEstimate
from coclo_vio.values.measurements import Measurement, StereoTracks
from coclo_vio.values.outputs import Estimate, Output
from coclo_vio.values.units import NS_PER_S

DAISY = RobotModel(load_robot("daisy"))
WALK = BodyMotionConfig(rest_s=1.0, walk_s=3.5, stop_s=0.0, ramp_s=0.6, speed_mps=0.18, curvature_per_m=0.3)
FORWARD = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
RIG = RectifiedStereo((380.0, 380.0), (320.0, 240.0), 0.1, se3.transform(FORWARD, np.array([0.2, 0.05, 0.1])))
FIRST_FRAME_NS, FRAME_NS = 3_000_000, 66_666_667  # between joint samples
JOINT_NS = 10_000_000
NOISE_PX = 0.3
_POINTS = np.random.default_rng(1).uniform((-3.0, -4.0, -1.0), (6.0, 4.0, 3.0), (1500, 3))


@cache
def trial() -> AnalyticTrial:
    return generate(AnalyticTrialConfig(body=WALK), DAISY, seed=5)


@cache
def stream() -> tuple[Measurement, ...]:
    """All measurements in time order."""
    frames = [_tracks(stamp_ns) for stamp_ns in range(FIRST_FRAME_NS, int(trial().truth.stamps_ns[-1]), FRAME_NS)]
    return in_order([*trial().measurements, *frames])


def in_order(measurements: Iterable[Measurement]) -> tuple[Measurement, ...]:
    return tuple(sorted(measurements, key=lambda one: one.stamp_ns))


def with_late_clock(measurements: Iterable[Measurement], offset_s: float) -> tuple[Measurement, ...]:
    """The same recording by cameras whose clock plus ``offset_s`` is that of the other sensors."""
    offset_ns = round(offset_s * NS_PER_S)
    return in_order(
        replace(one, stamp_ns=one.stamp_ns - offset_ns) if isinstance(one, StereoTracks) else one
        for one in measurements
    )


def between(measurements: Iterable[Measurement], start_s: float, end_s: float) -> list[Measurement]:
    return [one for one in measurements if start_s <= one.stamp_ns / NS_PER_S < end_s]


def without(measurements: Iterable[Measurement], kind: type, start_s: float, end_s: float) -> list[Measurement]:
    """Without the samples of a kind in an interval."""
    return [one for one in measurements if not (isinstance(one, kind) and start_s <= one.stamp_ns / NS_PER_S < end_s)]


def without_tracks(tracks: StereoTracks) -> StereoTracks:
    nothing = np.zeros((0, 2))
    return StereoTracks(tracks.stamp_ns, np.zeros(0, dtype=np.int64), nothing, nothing)


def combined(
    config: BridgeConfig | None = None, legs: FilterConfig | None = None, *, time_offset_s: float = 0.0
) -> CombinedOdometry:
    """Combined odometry of tracks, with the real filter and smoother."""
    smoother = SmootherConfig.parse({"noise": {"track_px": NOISE_PX, "disparity_px": NOISE_PX}}, "test")
    return CombinedOdometry(
        LegOdometryFilter(DAISY, legs, remembers_frames=True),
        SlidingWindowSmoother(RIG, smoother),
        None,
        config,
        time_offset_s=time_offset_s,
    )


def outputs_of(odometry: StreamingEstimator, measurements: Iterable[Measurement]) -> list[Output]:
    """All outputs of a recording."""
    return [*(output for one in measurements for output in odometry.push(one)), *odometry.finish()]


def states(outputs: Iterable[Output], name: str) -> list[StateEstimate]:
    """The estimates of one trajectory."""
    return [output.state for output in outputs if isinstance(output, Estimate) and output.name == name]


def error_m(estimate: StateEstimate) -> float:
    """Distance from the truth, whose heading and position at the start are those of the estimate's world."""
    start = trial().truth.T_world_body[0]
    T_start = se3.transform(so3.about_z(float(so3.yaw(start[:3, :3]))), start[:3, 3])
    T_true = se3.inverse(T_start) @ _true_pose(estimate.stamp_ns)
    return float(np.linalg.norm(estimate.nav.T_world_body[:3, 3] - T_true[:3, 3]))


def _true_pose(stamp_ns: int) -> Array:
    """Between samples on the geodesic."""
    stamps, poses = trial().truth.stamps_ns, trial().truth.T_world_body
    row = int(np.clip(np.searchsorted(stamps, stamp_ns), 1, len(stamps) - 1))
    share = (stamp_ns - stamps[row - 1]) / (stamps[row] - stamps[row - 1])
    return np.asarray(poses[row - 1] @ se3.exp(share * se3.log(se3.inverse(poses[row - 1]) @ poses[row])))


def _tracks(stamp_ns: int) -> StereoTracks:
    """Pixels of the points between 0.8 and 5 m in front of the cameras."""
    in_camera = se3.apply(se3.inverse(_true_pose(stamp_ns) @ RIG.T_body_camera), _POINTS)
    ahead = np.flatnonzero((in_camera[:, 2] > 0.8) & (in_camera[:, 2] < 5.0))
    left, disparity = RIG.pixels(in_camera[ahead])
    inside = ((left > 0.0) & (left < [640.0, 480.0])).all(axis=1)
    left, disparity, ids = left[inside][:60], disparity[inside][:60], ahead[inside][:60]
    random = np.random.default_rng(stamp_ns)
    left = left + NOISE_PX * random.standard_normal(left.shape)
    disparity = disparity + NOISE_PX * random.standard_normal(len(ids))
    return StereoTracks(stamp_ns, ids, left, left - np.column_stack((disparity, np.zeros(len(ids)))))
