# SPDX-License-Identifier: BSD-3-Clause
"""Flat feet in the filter, on exact trials of a biped: they hold yaw and tilt, and rocking on an edge does no harm."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from flat_biped import WALK_M, FlatTrial, Noise, flat_trial, rocked, smooth, walk, write_biped

from coclo_vio.filter.config import FilterConfig
from coclo_vio.filter.odometry import LegOdometryFilter
from coclo_vio.geometry import se3, so3
from coclo_vio.robot.model import RobotModel
from coclo_vio.values.arrays import Array
from coclo_vio.values.estimates import StateEstimate

REST_S, HEIGHT_M, STANCE_M = 1.0, 0.62, 0.09
NOISE = Noise(rate_bias_radps=0.005)
MATCHED = {
    "slip_share": 0.0,
    "slip_turn_per_m": 0.0,
    "foothold_creep": 2e-5,
    "foot_position_noise_m": 1e-5,
    "foot_velocity_noise_mps": 1e-3,
    "foot_rotation_noise_rad": 1e-5,
    "foot_rotation_memory_s": 0.0,
    "sole_creep_rad": 2e-5,
    "estimates_leg_compliance": False,
    "imu_delay_s": 0.0,
    "imu_delay_sigma_s": 0.0,
}


@pytest.fixture(scope="module")
def biped(tmp_path_factory: pytest.TempPathFactory) -> RobotModel:
    imu = {"gyroscope_noise_density": 3e-4, "gyroscope_bias": 0.005, "gyroscope_bias_walk": 1e-6}
    noise = {"encoder_noise_rad": 5e-4, "joint_velocity_noise_radps": 0.02, "imu": imu}
    return RobotModel(write_biped(tmp_path_factory.mktemp("biped"), **noise))


def sway(time_s: float) -> Array:
    """The body sways, leans and twists over both feet, after a rest."""
    ramp, phase = smooth((time_s - REST_S) / 1.0), 2.0 * np.pi * 0.3 * (time_s - REST_S)
    place = ramp * np.array([0.01 * np.sin(phase), 0.03 * np.sin(0.7 * phase), 0.01 * (np.cos(phase) - 1.0)])
    turn = ramp * np.array([0.04 * np.sin(phase), 0.06 * np.sin(0.8 * phase), 0.15 * np.sin(0.6 * phase)])
    return se3.transform(so3.exp(turn), np.add(place, [0.0, 0.0, HEIGHT_M]))


def standing(side: float, time_s: float) -> Array:
    return rocked(np.array([0.0, side * STANCE_M, 0.0]), 0.0)


def rocking(side: float, time_s: float) -> Array:
    """The left sole goes over its toe and its heel in turn, without lifting."""
    angle = 0.35 * np.sin(2.0 * np.pi * 0.5 * (time_s - 2.0)) * smooth(time_s - 2.0)
    return rocked(np.array([0.0, side * STANCE_M, 0.0]), angle)


def both_carry(time_s: float) -> Array:
    return np.array([150.0, 150.0])


@pytest.fixture(scope="module")
def swaying(biped: RobotModel) -> FlatTrial:
    return flat_trial(biped, sway, (partial(standing, 1.0), partial(standing, -1.0)), both_carry, 6.0)


def estimates(
    robot: RobotModel, trial: FlatTrial, seed: int, noise: Noise = NOISE, **robust: object
) -> Sequence[StateEstimate]:
    rest = {"gyroscope_std_radps": 0.0065, "window_s": 0.4}
    changes = {"robust": robust, "initial": {"accelerometer_bias_mps2": 0.02}, "standstill": rest}
    config = FilterConfig.of_robot(robot.description, changes)
    odometry = LegOdometryFilter(robot, config)
    return [state for each in trial.measurements(noise, seed) if (state := odometry.push(each)) is not None]


def errors(trial: FlatTrial, states: Sequence[StateEstimate]) -> Array:
    """[rotation, position] of the truth in the axes of each estimate, tied at the start, at rest, (N, 6)."""
    rows = np.searchsorted(trial.stamps_ns, [state.stamp_ns for state in states])
    first = trial.T_world_body[0]
    T_start = se3.inverse(se3.transform(so3.about_z(float(so3.yaw(first[:3, :3]))), first[:3, 3]))
    truths = T_start @ trial.T_world_body[rows]
    pairs = zip(states, truths, strict=True)
    return np.array([se3.log(se3.inverse(state.nav.T_world_body) @ truth) for state, truth in pairs])


@pytest.mark.long
def test_soles_that_rest_hold_yaw_and_make_its_covariance_small(biped: RobotModel, swaying: FlatTrial) -> None:
    drifting = Noise(rate_bias_radps=0.005, rate_drift_radps2=1e-3)
    last, sigma = {}, {}
    for holds in (True, False):
        states = estimates(biped, swaying, 1, drifting, holds_soles=holds, foot_rotation_noise_rad=5e-4)
        last[holds] = abs(errors(swaying, states)[-1, 2])
        sigma[holds] = np.sqrt(states[-1].covariance[2, 2])
    assert last[True] < 0.5 * last[False]
    assert sigma[True] < 0.5 * sigma[False]


@pytest.mark.long
def test_the_covariance_with_soles_is_honest(biped: RobotModel, swaying: FlatTrial) -> None:
    normalised = []
    for seed in range(4):
        states = estimates(biped, swaying, seed, replace(NOISE, force_bias_mps2=0.02), **MATCHED)[100::50]
        found = errors(swaying, states)
        normalised += [e @ np.linalg.solve(s.covariance[:6, :6], e) / 6.0 for e, s in zip(found, states, strict=True)]
    assert 0.5 < np.mean(normalised) < 2.0


def test_a_sole_that_rocks_on_heel_and_toe_does_no_harm(biped: RobotModel) -> None:
    soles = partial(rocking, 1.0), partial(standing, -1.0)
    trial = flat_trial(biped, sway, soles, both_carry, 5.0)
    known, ignored = (errors(trial, estimates(biped, trial, 3, rolls_feet=rocks)) for rocks in (True, False))
    assert np.abs(known[:, 3:]).max() < 0.004
    assert np.abs(ignored[:, 3:]).max() > 2.0 * np.abs(known[:, 3:]).max()


def test_a_walk_over_heels_and_toes_keeps_its_length(biped: RobotModel) -> None:
    trial = walk(biped)
    states = estimates(biped, trial, 5)
    assert np.linalg.norm(errors(trial, states)[-1, 3:]) < 0.02 * WALK_M


@pytest.mark.long
def test_frames_that_are_remembered_change_nothing(biped: RobotModel, swaying: FlatTrial) -> None:
    config = FilterConfig.of_robot(biped.description, {"robust": {"takes_slip_for_known": False}})
    plain, remembering = (LegOdometryFilter(biped, config, remembers_frames=kept) for kept in (False, True))
    keyframe, last = None, np.zeros((2, 4, 4))
    for number, measurement in enumerate(swaying.measurements(NOISE, 2)):
        states = [odometry.push(measurement) for odometry in (plain, remembering)]
        if states[0] is None or states[1] is None:
            continue
        last = np.array([state.nav.T_world_body for state in states if state is not None])
        if keyframe is None:
            keyframe = remembering.mark_frame(states[1].stamp_ns).anchor()
        elif number % 150 == 2:
            pair = keyframe.mark_frame(states[1].stamp_ns)
            covariance = pair.poses().covariance
            assert np.linalg.eigvalsh(covariance).min() > -1e-12
            keyframe = pair.keep()
    np.testing.assert_allclose(last[0], last[1], atol=1e-9)
