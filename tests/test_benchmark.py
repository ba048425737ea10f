# SPDX-License-Identifier: BSD-3-Clause
"""The benchmark measures what it says: our filter and filterpy's on the same readings, with the same answer."""

from collections import Counter

import numpy as np
import pytest

from coclo_vio import benchmark
from coclo_vio.filter.config import InitialConfig, RobustConfig
from coclo_vio.filter.initialisation import initial_filter
from coclo_vio.filter.robust import RobustProfile
from coclo_vio.filterpy_rival import FilterpyRival
from coclo_vio.robot.description import load_robot
from coclo_vio.robot.model import RobotModel


def test_figures_have_the_names_that_the_command_line_promises() -> None:
    figures = benchmark.run_benchmark(walk_s=2.0, rounds=1)
    assert {"filter_cycles_per_s", "filter_vs_filterpy", "realtime_factor", "peak_rss_mb"} <= set(figures)
    ours, ratio = figures["filter_cycles_per_s"], figures["filter_vs_filterpy"]
    assert ours is not None
    assert ours > 100.0
    assert ratio is None or ratio > 1.5


def test_filterpy_runs_the_same_models() -> None:
    """Both filters end in the same place, with the same uncertainty, from the same start."""
    pytest.importorskip("filterpy")
    robot = RobotModel(load_robot("daisy"))
    readings = benchmark.moving_readings(robot, benchmark.benchmark_trial(robot, walk_s=2.0).measurements)
    config = RobustConfig()
    profile = RobustProfile(robot, config, Counter())
    core = initial_filter(
        profile.layout,
        InitialConfig(),
        readings[0],
        None,
        moving_force=readings[0].specific_force,
        foot_noise_m=profile.foot_sigma_m(readings[0]),
        legs=profile.leg_sigmas,
        is_wide=profile.is_wide,
    )
    rival = FilterpyRival(robot, config, core.mean, core.factor @ core.factor.T)
    rival.run(readings, robot.description.imu.gyroscope_noise_density)
    ours, _ = benchmark.run_filter(robot, readings, "robust")
    position = slice(16, 19)
    travelled = np.linalg.norm(ours.mean.vector[position])
    assert travelled > 0.1
    assert np.linalg.norm(ours.mean.vector[position] - rival.position) < 0.03 * travelled
    sigmas = np.linalg.norm(ours.factor[position], axis=1)
    np.testing.assert_allclose(np.sqrt(np.diag(rival.ukf.P))[position], sigmas, rtol=0.2)


def test_memory_is_flat() -> None:
    held = benchmark.resident_mb(cycles=900, samples=3)
    assert len(held) == 4
    assert held[-1] - held[1] < 8.0
