# SPDX-License-Identifier: BSD-3-Clause
"""Speed of the filter of six legs on an analytic trial beside filterpy's, and of vision.

Sees the filter, the robot and the simulation, as the pipeline does; prints nothing. Rates are in cycles per second of
processor time: that of one core if ``OPENBLAS_NUM_THREADS=1`` is set before Python starts.
"""

import math
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import pairwise
from time import perf_counter, process_time
from typing import Literal

import numpy as np

from coclo_vio.experiments.filterpy_rival import FilterpyRival, has_filterpy
from coclo_vio.experiments.resident_memory import peak_rss_mb, resident_mb
from coclo_vio.experiments.vision_benchmark import vision_figures
from coclo_vio.filter.config import FilterConfig
from coclo_vio.filter.initialisation import initial_filter
from coclo_vio.filter.odometry import LegOdometryFilter
from coclo_vio.filter.paper_profile import PaperProfile
from coclo_vio.filter.robust_profile import RobustProfile
from coclo_vio.filter.square_root_filter import SquareRootFilter
from coclo_vio.filter.stance import Reading
from coclo_vio.robot.description import load_robot
from coclo_vio.robot.leg_sensing import LegSensing
from coclo_vio.robot.model import RobotModel
from coclo_vio.simulation.analytic import AnalyticTrial, AnalyticTrialConfig, generate
from coclo_vio.simulation.body_motion import BodyMotionConfig
from coclo_vio.values.measurements import JointSample, Measurement
from coclo_vio.values.units import NS_PER_S

ProfileName = Literal["robust", "paper"]
_FILTERPY_READINGS = 120


def run_benchmark(walk_s: float = 8.0, rounds: int = 3, vision_s: float = 15.0) -> dict[str, float | None]:
    """The figures of the filter and of vision, by name; None without filterpy, or without keyframes.

    ``filter_cycles_per_s`` and ``paper_cycles_per_s`` count predict and update alone, from a reading of the joints to
    the new state; ``filter_pushes_per_s`` counts whole joint samples, kinematics, contact and the estimate included;
    ``filter_vs_filterpy`` is the ratio to filterpy's ``UnscentedKalmanFilter`` with the same state, models and
    measurements; ``realtime_factor`` is seconds of recording per second, with samples at 100 Hz.

    Args:
        walk_s: length of the trial's walk, s.
        rounds: repetitions; the best of each figure counts.
        vision_s: how much of the bundled sample is used, s; see ``vision_figures``.
    """
    robot = RobotModel(load_robot("daisy"))
    trial = benchmark_trial(robot, walk_s)
    readings = moving_readings(robot, trial.measurements)
    _compile_kernels(robot, readings, trial.measurements)
    best: dict[str, float] = {}
    for _ in range(rounds):  # in turns, the best of each: other work on the machine can only slow it down
        rates = {
            "filter_cycles_per_s": filter_cycles_per_s(robot, readings, "robust"),
            "paper_cycles_per_s": filter_cycles_per_s(robot, readings, "paper"),
            "filterpy_cycles_per_s": filterpy_cycles_per_s(robot, readings[:_FILTERPY_READINGS]),
        }
        rates["filter_pushes_per_s"], rates["realtime_factor"] = push_rates(robot, trial.measurements)
        best = {name: max(rate or 0.0, best.get(name, 0.0)) for name, rate in rates.items()}
    theirs = best.pop("filterpy_cycles_per_s") or None
    return {
        **best,
        "filterpy_cycles_per_s": theirs,
        "filter_vs_filterpy": None if theirs is None else best["filter_cycles_per_s"] / theirs,
        **vision_figures(vision_s, rounds),
        "peak_rss_mb": peak_rss_mb(),
    }


def benchmark_trial(robot: RobotModel, walk_s: float, seed: int = 1) -> AnalyticTrial:
    """A noisy walk at 100 Hz after a second at rest."""
    body = BodyMotionConfig(rest_s=1.0, walk_s=walk_s, stop_s=0.0)
    return generate(AnalyticTrialConfig(body=body), robot, seed)


def moving_readings(robot: RobotModel, measurements: Iterable[Measurement]) -> list[Reading]:
    """The filter's readings at the joint samples, from the last one at rest on."""
    config = FilterConfig()
    timeout_s = config.force_timeout_s
    sensing = LegSensing(robot, robot.description.contact, config.standstill, force_timeout_s=timeout_s)
    up_body = np.array([0.0, 0.0, 1.0])
    pushed = (sensing.push(measurement, up_body) for measurement in measurements)
    readings = [reading for reading in pushed if reading is not None]
    at_rest = [number for number, reading in enumerate(readings) if reading.is_stationary]
    return readings[at_rest[-1] if at_rest else 0 :]


def _compile_kernels(robot: RobotModel, readings: Sequence[Reading], measurements: Sequence[Measurement]) -> None:
    """Take every step once, so that no figure contains the time in which numba compiles."""
    for profile in ("robust", "paper"):
        run_filter(robot, readings, profile)
    push_rates(robot, measurements)


def filter_cycles_per_s(robot: RobotModel, readings: Sequence[Reading], profile: ProfileName) -> float:
    """Predict and update of a profile over the readings after the first, per second of processor time."""
    _, taken_s = run_filter(robot, readings, profile)
    return (len(readings) - 1) / taken_s


def run_filter(robot: RobotModel, readings: Sequence[Reading], profile: ProfileName) -> tuple[SquareRootFilter, float]:
    """The filter after the readings, and the seconds of processor time spent in predict and update."""
    steps, core = _started(robot, readings[0], profile)
    density = robot.description.imu.gyroscope_noise_density
    started_s = process_time()
    for before, reading in pairwise(readings):
        dt_s = (reading.stamp_ns - before.stamp_ns) / NS_PER_S
        steps.step(core, reading, dt_s, density / math.sqrt(dt_s), is_gap=False)
    return core, process_time() - started_s


def _started(
    robot: RobotModel, reading: Reading, profile: ProfileName
) -> tuple[RobustProfile | PaperProfile, SquareRootFilter]:
    config, counts = FilterConfig(), Counter[str]()
    steps = (
        RobustProfile(robot, config.robust, counts)
        if profile == "robust"
        else PaperProfile(robot, config.paper, counts)
    )
    core = initial_filter(
        steps.layout,
        config.initial,
        reading,
        None,
        moving_force=reading.specific_force,
        foot_prior=steps.foot_prior(reading),
        is_wide=steps.is_wide,
    )
    steps.start(reading)
    return steps, core


def filterpy_cycles_per_s(robot: RobotModel, readings: Sequence[Reading]) -> float | None:
    """filterpy's predict and update over the readings, per second of processor time; None without filterpy."""
    if not has_filterpy():
        return None
    _, core = _started(robot, readings[0], "robust")
    rival = FilterpyRival(robot, FilterConfig().robust, core.mean, core.factor)
    taken_s = rival.run(readings, robot.description.imu.gyroscope_noise_density)
    return (len(readings) - 1) / taken_s


def push_rates(robot: RobotModel, measurements: Sequence[Measurement]) -> tuple[float, float]:
    """Joint samples per second of processor time through the whole filter, and seconds of recording per second."""
    odometry = LegOdometryFilter(robot)
    joint_samples = sum(isinstance(measurement, JointSample) for measurement in measurements)
    recorded_s = (measurements[-1].stamp_ns - measurements[0].stamp_ns) / NS_PER_S
    started_s, started_wall_s = process_time(), perf_counter()
    for measurement in measurements:
        odometry.push(measurement)
    taken_s, taken_wall_s = process_time() - started_s, perf_counter() - started_wall_s
    return joint_samples / taken_s, recorded_s / taken_wall_s


def filter_resident_mb(cycles: int, samples: int = 10) -> tuple[float, ...]:
    """Memory of this process (MiB) at even distances over so many cycles of the whole filter, the first at their start.

    A short noisy walk is pushed over and over with stamps that go on, a pause of a second between two.

    Raises:
        CocloError: the system does not report the memory of a process (Linux does, in /proc).
    """
    robot = RobotModel(load_robot("daisy"))
    measurements = benchmark_trial(robot, walk_s=4.0).measurements
    odometry = LegOdometryFilter(robot)
    due = [round(cycles * number / samples) for number in range(samples + 1)]
    held: list[float] = []
    estimates, shift_ns = 0, 0
    while len(held) <= samples:
        for measurement in measurements:
            estimates += odometry.push(replace(measurement, stamp_ns=measurement.stamp_ns + shift_ns)) is not None
            if len(held) <= samples and estimates > due[len(held)]:
                held.append(resident_mb())
        shift_ns += measurements[-1].stamp_ns + NS_PER_S
    return tuple(held)
