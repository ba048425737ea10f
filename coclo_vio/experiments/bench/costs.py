# SPDX-License-Identifier: BSD-3-Clause
"""What each stage costs, in processor time: legs, front end, window, vision, and all of it at a quadruped's rates.

Of one core where ``OPENBLAS_NUM_THREADS=1`` is set before Python starts. Every walk comes from a seed; what is drawn
and what is compiled is prepared before the clock starts.
"""

import heapq
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields
from time import process_time

import numpy as np

from coclo_vio.datasets.dataset import open_dataset
from coclo_vio.datasets.sample import sample_path
from coclo_vio.experiments.bench.point_world import imu, rig, tracked_walk
from coclo_vio.experiments.bench.rectified_pair import LOOKS_LEFT, rectified_pair
from coclo_vio.filter.odometry import LegOdometryFilter
from coclo_vio.frontend.frontend import StereoFrontend
from coclo_vio.robot.description import RobotDescription, load_robot
from coclo_vio.robot.model import RobotModel
from coclo_vio.runs.equipment import Equipment
from coclo_vio.runs.modes.registry import mode_of
from coclo_vio.runs.run_config import RunConfig, resolve
from coclo_vio.simulation.analytic import AnalyticTrial, AnalyticTrialConfig, generate
from coclo_vio.simulation.body_motion import BodyMotionConfig, BodyStates
from coclo_vio.simulation.gait import GaitConfig
from coclo_vio.simulation.visuals.wall_images import frames_along_wall
from coclo_vio.values.errors import CocloError
from coclo_vio.values.measurements import CameraImuSample, JointSample, Measurement, StereoFrame, StereoTracks
from coclo_vio.values.outputs import Estimate, Estimator, KeyframeHealth
from coclo_vio.values.units import MS_PER_S, NS_PER_S

_WARM_UP = 10  # units of a stage that are not counted: caches fill, kernels load
_FRAMES = 120
_WALL_PAIR = rectified_pair(LOOKS_LEFT, baseline_m=0.06)


@dataclass(frozen=True, slots=True)
class WalkKind:
    """An analytic walk: one cost depends on its legs and rate only.

    Attributes:
        rate_hz: of all sensors.
        walk_s: length after a second at rest, s.
        standing_rad: joint angles of a stand; None for a known robot's.
        speed_mps: of the body.
    """

    rate_hz: float
    walk_s: float = 4.0
    standing_rad: tuple[float, ...] | None = None
    speed_mps: float = 0.18

    def trial(self, robot: RobotModel, seed: int = 1) -> AnalyticTrial:
        """The walk, one leg after another."""
        body = BodyMotionConfig(rest_s=1.0, walk_s=self.walk_s, stop_s=0.0, speed_mps=self.speed_mps)
        duty = 0.7 if len(robot.leg_names) < 4 else 0.8
        config = AnalyticTrialConfig(
            rate_hz=self.rate_hz,
            body=body,
            gait=GaitConfig(order="wave", duty=duty),
            standing_rad=self.standing_rad,
        )
        return generate(config, robot, seed)


def leg_sample_ms(robot: RobotDescription, walk: WalkKind) -> float:
    """Leg odometry by ``LegOdometryFilter``, from a joint sample to its estimate, ms a joint sample, mean."""
    model = RobotModel(robot)
    odometry, pushes = LegOdometryFilter(model), iter(walk.trial(model).measurements)
    estimates = 0
    while estimates < _WARM_UP:
        estimates += odometry.push(next(pushes)) is not None
    rest = list(pushes)
    started_s = process_time()
    for each in rest:
        odometry.push(each)
    return MS_PER_S * (process_time() - started_s) / sum(isinstance(each, JointSample) for each in rest)


def front_end_ms(tracks: int) -> tuple[float, float]:
    """The front end on the bundled sample's first images, decoded before, ms a frame, median.

    Args:
        tracks: number of points to track.

    Returns:
        The cost, and how many tracks there were, median.
    """
    config = resolve(settings=[f"frontend.detection.tracks={tracks}"])
    dataset = open_dataset(sample_path(), None)
    equipment = Equipment.of(dataset, config, frozenset({StereoFrame}))
    frontend = StereoFrontend(equipment.require_cameras(), config.frontend)
    frames = [each for each in dataset.measurements(frozenset({StereoFrame})) if isinstance(each, StereoFrame)]
    taken_ms, found = [], []
    for frame in frames[:_FRAMES]:
        started_s = process_time()
        tracked = frontend.track(frame)
        taken_ms.append(MS_PER_S * (process_time() - started_s))
        found.append(len(tracked.track_ids))
    return float(np.median(taken_ms[_WARM_UP:])), float(np.median(found[_WARM_UP:]))


def keyframe_ms(tracks: int = 150, keyframes: int = 10, frames: int = _FRAMES) -> float:
    """The window with an IMU, readings since the frame before included, ms a keyframe, median.

    Args:
        tracks: in a frame.
        keyframes: in the window.
        frames: at 10 Hz, until the end; the window is full before the clock counts.
    """
    odometry = window_of_tracks(keyframes)
    taken_ms: list[float] = []
    for measurement in tracked_walk(tracks, frames + 3 * keyframes):
        if isinstance(measurement, StereoTracks):
            started_s = process_time()
            outputs = odometry.push(measurement)
            if any(isinstance(output, KeyframeHealth) for output in outputs):
                taken_ms.append(MS_PER_S * (process_time() - started_s))
        else:
            odometry.push(measurement)
    return float(np.median(taken_ms[keyframes:]))


def window_of_tracks(keyframes: int = 10) -> Estimator:
    """``vins`` on tracks of the point world, without a front end."""
    sensors = frozenset({CameraImuSample, StereoTracks})
    config = RunConfig.parse({"smoother": {"keyframes": keyframes}}, "benchmark")
    return mode_of("vins").make(Equipment(camera_imu=imu(), stereo=rig(), sensors=sensors), config)


@dataclass(frozen=True, slots=True)
class CombinedLoad:
    """Legs at a quadruped's rate and stereo images of a wall, both together.

    Attributes:
        measurements: in time order.
        recorded_s: their length.
        robot: the quadruped.
    """

    measurements: Sequence[Measurement]
    recorded_s: float
    robot: RobotDescription


def quadruped_with_stereo(joint_hz: float = 500.0, frame_hz: float = 15.0, walk_s: float = 9.0) -> CombinedLoad:
    """Four legs and stereo frames of 640 x 480."""
    robot = load_robot("go1")
    trial = WalkKind(joint_hz, walk_s, speed_mps=0.3).trial(RobotModel(robot))
    stamps_ns = trial.truth.stamps_ns
    chosen = np.searchsorted(stamps_ns, np.arange(0.0, stamps_ns[-1], NS_PER_S / frame_hz))
    at_frames = BodyStates(**{each.name: getattr(trial.body, each.name)[chosen] for each in fields(BodyStates)})
    frames = frames_along_wall(_WALL_PAIR, stamps_ns[chosen], at_frames)
    merged = tuple(heapq.merge(trial.measurements, frames, key=lambda measurement: measurement.stamp_ns))
    return CombinedLoad(merged, float(stamps_ns[-1] - stamps_ns[0]) / NS_PER_S, robot)


def combined_realtime_factor(load: CombinedLoad) -> float:
    """Seconds of recording per second of processor time through ``combined``.

    Raises:
        CocloError: the estimator cannot go on, or gave no estimate.
    """
    equipment = Equipment(RobotModel(load.robot), load.robot.imu, stereo=_WALL_PAIR)
    odometry = mode_of("combined").make(equipment, resolve(load.robot))
    started_s = process_time()
    estimates = sum(_estimates(odometry.push(each)) for each in load.measurements) + _estimates(odometry.finish())
    taken_s = process_time() - started_s
    if not estimates:
        raise CocloError("combined gave no estimate on the benchmark's own walk; look at its events")
    return load.recorded_s / taken_s


def _estimates(outputs: Iterable[object]) -> int:
    return sum(isinstance(output, Estimate) for output in outputs)
