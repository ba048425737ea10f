# SPDX-License-Identifier: BSD-3-Clause
"""The clock is found from how the body turns, and from nothing else."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from coclo_vio.evaluation.clock import ClockConfig, fit_clock
from coclo_vio.geometry import se3, so3
from coclo_vio.values.errors import EvaluationError
from coclo_vio.values.trajectory import GroundTruth, Trajectory

EVEN = ClockConfig(counts_frames=False)
SEEDS = [1, *(pytest.param(seed, marks=pytest.mark.long) for seed in (2, 3, 4))]
GO1 = Path(__file__).parents[3] / "shared" / "data" / "go1_mocap"


def turned(trajectory: Trajectory, seed: int) -> Trajectory:
    """The same motion of another body frame, seen from another world."""
    rng = np.random.default_rng(seed)
    world, body = (se3.transform(Rotation.random(rng=rng).as_matrix(), rng.uniform(-3.0, 3.0, 3)) for _ in range(2))
    return replace(trajectory, T_world_body=world @ trajectory.T_world_body @ body)


def rattled(trajectory: Trajectory, seed: int, noise_rad: float) -> Trajectory:
    noise = Rotation.from_rotvec(np.random.default_rng(seed).normal(0.0, noise_rad, (len(trajectory), 3))).as_matrix()
    return replace(trajectory, T_world_body=se3.transform(trajectory.rotations @ noise, np.array(trajectory.positions)))


@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize("clock_s", [-3.2137, 0.0, 1.7071])
def test_offset_is_found_whatever_the_frames(walk, seed, clock_s):
    estimate = rattled(walk(np.arange(0.0, 25.0, 0.005), seed), seed, 1e-3)
    truth = turned(walk(np.arange(1.0, 23.0, 0.01), seed, clock_s), seed)
    fit = fit_clock(estimate, GroundTruth(rattled(truth, seed + 50, 1e-3), True, "vicon"), ClockConfig())
    assert fit.is_estimated
    assert fit.offset_s == pytest.approx(clock_s, abs=2e-3)
    assert fit.correlation > 0.95
    assert fit.residual_deg < 0.5


def test_same_clock_gives_no_offset(walk):
    estimate = walk(np.arange(0.0, 25.0, 0.005), 4)
    fit = fit_clock(estimate, GroundTruth(estimate, True, "exact"), ClockConfig())
    assert fit.offset_s == pytest.approx(0.0, abs=1e-6)


def test_offset_survives_a_hole_in_the_ground_truth(walk):
    truth = walk(np.arange(0.0, 25.0, 0.01), 5, 0.8)
    truth = truth.select((truth.times_s < 9.0) | (truth.times_s > 12.0))
    fit = fit_clock(walk(np.arange(0.0, 25.0, 0.005), 5), GroundTruth(truth, True, "vicon"), ClockConfig())
    assert fit.offset_s == pytest.approx(0.8, abs=2e-3)


def test_positions_are_not_used(walk):
    estimate, truth = walk(np.arange(0.0, 25.0, 0.005), 6), walk(np.arange(0.0, 25.0, 0.01), 6, 0.5)
    misled = replace(truth, T_world_body=se3.transform(truth.rotations, np.roll(truth.positions, 300, axis=0)))
    fits = [fit_clock(estimate, GroundTruth(each, True, "vicon"), ClockConfig()) for each in (truth, misled)]
    assert fits[0] == fits[1]


@pytest.mark.parametrize("seed", SEEDS)
def test_rate_and_offset_of_a_ground_truth_without_stamps(walk, seed):
    rate_hz, first_s = 57.8, -1.6
    rows = first_s + np.arange(1610) / rate_hz
    truth = turned(walk(rows, seed).restamped(np.arange(1610) * 10_000_000), seed)
    fit = fit_clock(walk(np.arange(0.0, 25.4, 0.01), seed), GroundTruth(truth, False, "mocap"), ClockConfig())
    assert fit.rate_hz == pytest.approx(rate_hz, abs=0.02)
    assert fit.offset_s == pytest.approx(first_s, abs=0.01)
    assert fit.apply(truth).stamps_ns[-1] == pytest.approx(rows[-1] * 1e9, abs=2e7)


@pytest.mark.parametrize("seed", SEEDS)
def test_rate_and_offset_with_dropped_rows(walk, seed):
    rng = np.random.default_rng(seed)
    rows = -1.0 + np.arange(1620) / 60.0
    kept = rows[rng.random(len(rows)) > 0.04]
    truth = walk(kept, seed).restamped(np.arange(len(kept)) * 10_000_000)
    fit = fit_clock(walk(np.arange(0.0, 25.4, 0.01), seed), GroundTruth(truth, False, "mocap"), ClockConfig())
    errors_s = fit.apply(truth).stamps_ns * 1e-9 - kept
    is_walking = (kept > 5.0) & (kept < 22.0)
    assert fit.rate_hz == pytest.approx(60.0, abs=0.2)
    assert np.sqrt(np.mean(errors_s[is_walking] ** 2)) < 0.02
    assert fit.correlation > 0.99
    even = fit_clock(walk(np.arange(0.0, 25.4, 0.01), seed), GroundTruth(truth, False, "mocap"), EVEN)
    errors_s = even.apply(truth).stamps_ns * 1e-9 - kept
    assert even.rate_hz == pytest.approx((len(kept) - 1) / (kept[-1] - kept[0]), abs=0.6)
    assert 0.01 < np.sqrt(np.mean(errors_s[is_walking] ** 2)) < 0.08
    assert even.correlation > 0.97


@pytest.mark.long
@pytest.mark.parametrize("seed", [1, 2, 3, 4])
def test_uneven_rows_are_stamped_better_than_evenly(walk, seed):
    rows = -1.0 + np.arange(1600) / 60.0
    rows = rows + 0.25 * np.sin(2.0 * np.pi * rows / 9.0 + seed)
    numbered = turned(walk(rows, seed), seed)
    truth = GroundTruth(numbered.restamped(np.arange(1600) * 10_000_000), False, "mocap")
    estimate = walk(np.arange(0.0, 25.4, 0.01), seed)
    even = fit_clock(estimate, truth, EVEN)
    uneven = fit_clock(estimate, truth, ClockConfig(counts_frames=False, has_uneven_rows=True))
    is_turning = np.abs(np.gradient(np.unwrap(so3.yaw(walk(rows, seed).rotations)), rows)) > 0.5
    errors_s = [
        np.sqrt(np.mean((fit.apply(truth.trajectory).stamps_ns * 1e-9 - rows)[is_turning] ** 2))
        for fit in (even, uneven)
    ]
    assert errors_s[0] > 0.05
    assert errors_s[1] < 0.6 * errors_s[0]
    assert uneven.residual_deg < 0.8 * even.residual_deg
    assert (uneven.offset_s, uneven.rate_hz) == (even.offset_s, even.rate_hz)


def test_estimate_that_starts_late_has_the_same_clock(walk):
    rows = -1.6 + np.arange(1610) / 57.8
    truth = GroundTruth(walk(rows, 2).restamped(np.arange(1610) * 10_000_000), False, "mocap")
    late = walk(np.arange(0.0, 25.4, 0.01), 2).between(int(3e9), int(25e9))
    assert fit_clock(late, truth, ClockConfig()).offset_s == pytest.approx(-1.6, abs=0.02)


def test_given_clock_is_used(walk):
    estimate = walk(np.arange(0.0, 25.0, 0.01))
    fit = fit_clock(estimate, GroundTruth(estimate, True, "vicon"), ClockConfig(offset_s=0.25))
    assert (fit.offset_s, fit.is_estimated) == (0.25, False)
    assert fit.correlation < 0.99
    numbered = GroundTruth(estimate, False, "mocap")
    fit = fit_clock(estimate, numbered, ClockConfig(offset_s=0.5, rate_hz=50.0))
    assert np.diff(fit.apply(estimate).stamps_ns).tolist() == [20_000_000] * (len(estimate) - 1)
    assert fit.apply(estimate).stamps_ns[0] == 500_000_000


def test_half_a_clock_is_refused(walk):
    estimate = walk(np.arange(0.0, 25.0, 0.01))
    with pytest.raises(EvaluationError, match="set both"):
        fit_clock(estimate, GroundTruth(estimate, False, "mocap"), ClockConfig(rate_hz=60.0))
    with pytest.raises(EvaluationError, match="has stamps"):
        fit_clock(estimate, GroundTruth(estimate, True, "vicon"), ClockConfig(rate_hz=60.0))


def test_without_rotation_the_offset_is_zero_and_the_problem_is_reported(line):
    fit = fit_clock(line(5.0), GroundTruth(line(5.0), True, "vicon"), ClockConfig())
    assert (fit.offset_s, fit.is_estimated) == (0.0, False)
    assert "hardly turns" in fit.problem
    with pytest.raises(EvaluationError, match=r"hardly turns.*set clock.offset_s and clock.rate_hz"):
        fit_clock(line(5.0), GroundTruth(line(5.0), False, "mocap"), ClockConfig())


def test_another_motion_is_not_matched(walk):
    rng = np.random.default_rng(3)
    estimate = walk(np.arange(0.0, 25.0, 0.01), 1)
    wander = Rotation.from_rotvec(np.cumsum(rng.normal(0.0, 0.02, (2000, 3)), axis=0)).as_matrix()
    truth = Trajectory(np.arange(2000) * 10_000_000, se3.transform(wander, np.zeros((2000, 3))))
    fit = fit_clock(estimate, GroundTruth(truth, True, "another"), ClockConfig())
    assert not fit.is_estimated
    assert "correlate" in fit.problem


def test_clocks_far_apart_are_an_error_that_names_the_setting(walk):
    estimate = walk(np.arange(0.0, 25.0, 0.01))
    truth = walk(np.arange(0.0, 25.0, 0.01), clock_s=-1.7e9)
    with pytest.raises(EvaluationError, match=r"clock.max_offset_s"):
        fit_clock(estimate, GroundTruth(truth, True, "vicon"), ClockConfig())


@pytest.mark.skipif(not GO1.is_dir(), reason="the go1_mocap recording is not beside this repository")
@pytest.mark.parametrize("late_s", [0.0, 2.0])
def test_go1_mocap_without_stamps_against_the_integrated_gyroscope(late_s):
    log = np.genfromtxt(GO1 / "go1.csv", delimiter=",", skip_header=1)
    mocap = np.genfromtxt(GO1 / "mocap.csv", delimiter=",", skip_header=1)
    seconds, yaw_rate = log[:, 0], log[:, 10]
    yaw_rate = yaw_rate - yaw_rate[seconds < seconds[0] + 2.0].mean()
    yaw = np.append(0.0, np.cumsum(yaw_rate[1:] * np.diff(seconds)))
    attitude = Rotation.from_euler("z", yaw[:, None]).as_matrix()
    estimate = Trajectory(np.rint(seconds * 1e9).astype(np.int64), se3.transform(attitude, np.zeros((len(log), 3))))
    estimate = estimate.between(round((seconds[0] + late_s) * 1e9), int(1e15))
    truth = Trajectory(
        np.arange(len(mocap)) * 10_000_000,
        se3.transform(Rotation.from_quat(mocap[:, 3:7]).as_matrix(), mocap[:, :3]),
    )
    fit = fit_clock(estimate, GroundTruth(truth, False, "mocap.csv"), ClockConfig())
    assert fit.counts_frames
    assert fit.rate_hz == pytest.approx(118.0, abs=2.0)
    assert fit.residual_deg < 3.5
    assert fit.correlation > 0.97
    fit = fit_clock(estimate, GroundTruth(truth, False, "mocap.csv"), EVEN)
    assert fit.rate_hz == pytest.approx(57.8, abs=0.3)
    assert fit.offset_s - seconds[0] == pytest.approx(-1.634, abs=0.2)
    assert fit.residual_deg < 5.0
    assert fit.correlation > 0.95
