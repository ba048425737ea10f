# SPDX-License-Identifier: BSD-3-Clause
"""The robust profile's models against the exact motion of the analytic generator."""

from dataclasses import replace

import numpy as np
import pytest
from measurement_blocks import blocks_of
from state_layouts import layout_of

from coclo_vio.filter import process_model
from coclo_vio.filter.stance import Footholds, Reading
from coclo_vio.filter.state import GYROSCOPE_BIAS, POSITION, RATE, VELOCITY, State
from coclo_vio.geometry import so3
from coclo_vio.robot.contact import ContactState
from coclo_vio.robot.model import RobotModel
from coclo_vio.simulation.analytic import AnalyticTrial, AnalyticTrialConfig, SensorNoiseConfig, generate
from coclo_vio.simulation.body_motion import BodyMotionConfig
from coclo_vio.values.units import GRAVITY_MPS2

LAYOUT = layout_of(6)


def true_reading(robot: RobotModel, trial: AnalyticTrial, row: int) -> Reading:
    feet = robot.feet(trial.joint_position[row], trial.joint_velocity[row])
    stance = trial.stance[row]
    contact = ContactState(stance.astype(float), stance, trial.load_n[row])
    rate, force = trial.body.angular_velocity[row], np.array([0.0, 0.0, GRAVITY_MPS2])
    return Reading(int(trial.truth.stamps_ns[row]), feet, contact, rate, (), force @ trial.body.rotation[row], False)


def true_state(trial: AnalyticTrial, row: int) -> State:
    vector = np.zeros(LAYOUT.dimension)
    vector[RATE], vector[VELOCITY] = trial.body.angular_velocity[row], trial.body.velocity[row]
    vector[POSITION], vector[LAYOUT.feet] = trial.body.position[row], trial.feet_world[row].ravel()
    return State(LAYOUT, trial.body.rotation[row], vector)


def stack_of(state: State) -> State:
    return replace(state, rotation=state.rotation[None], vector=state.vector[None])


def foot_errors_m(robot: RobotModel, rate_hz: float) -> tuple[float, float]:
    """Largest error of one step of a rolling foot and of a carried one, given the true motion of the body."""
    body = BodyMotionConfig(rest_s=0.2, walk_s=1.6, stop_s=0.0, ramp_s=0.6, curvature_per_m=0.4)
    config = AnalyticTrialConfig(rate_hz=rate_hz, substeps=6, body=body, sensors=SensorNoiseConfig(noise_scale=0.0))
    trial = generate(config, robot, seed=3)
    footholds, dt_s = Footholds(true_reading(robot, trial, 0), robot.description.contact.on_force), 1.0 / rate_hz
    rolling, carried = [0.0], [0.0]
    for row in range(1, len(trial.truth)):
        motion = footholds.advance(true_reading(robot, trial, row), speed_mps=0.0, is_gap=False)
        state = true_state(trial, row - 1)
        turn = trial.body.rotation[row - 1].T @ trial.body.rotation[row]
        state.vector[RATE] = so3.log(turn) / dt_s
        state.vector[VELOCITY] = (trial.body.position[row] - trial.body.position[row - 1]) / dt_s
        moved = process_model.predict(stack_of(state), dt_s, motion, robot.foot_radii_m, robot.hip_position_body)
        np.testing.assert_allclose(moved.rotation[0], trial.body.rotation[row], atol=1e-12)
        errors = np.linalg.norm(moved.feet[0] - trial.feet_world[row], axis=1)
        rolling.extend(errors[motion.holds])
        carried.extend(errors[~motion.holds])
    return max(rolling), max(carried)


def test_a_rolling_foot_is_exact_to_third_order_in_the_step(daisy: RobotModel) -> None:
    coarse, carried = foot_errors_m(daisy, 25.0)
    fine, _ = foot_errors_m(daisy, 50.0)
    assert carried < 1e-9
    assert coarse < 5e-6
    assert 6.0 < coarse / fine < 12.0


def test_measurements_without_noise_are_those_of_the_true_state(daisy: RobotModel, clean_walk: AnalyticTrial) -> None:
    footholds = Footholds(true_reading(daisy, clean_walk, 0), daisy.description.contact.on_force)
    row_counts = set()
    for row in range(1, len(clean_walk.truth), 1):
        reading = true_reading(daisy, clean_walk, row)
        motion = footholds.advance(reading, speed_mps=0.0, is_gap=False)
        state = true_state(clean_walk, row)
        state.vector[GYROSCOPE_BIAS] = 0.0
        blocks = blocks_of(daisy, reading, motion, state)
        rows = sum(len(block.measured) for block in blocks)
        holding = int(np.count_nonzero(motion.holds))
        assert rows == 3 + 3 * int(reading.is_stance.sum()) + 3 * holding
        row_counts.add(rows)
        for block in blocks:
            np.testing.assert_allclose(block.model(stack_of(state))[0], block.measured, rtol=0, atol=1e-8)
    assert len(row_counts) > 2


def test_a_velocity_that_is_not_the_bodys_leaves_a_residual(daisy: RobotModel, clean_walk: AnalyticTrial) -> None:
    reading = true_reading(daisy, clean_walk, 200)
    legs = np.flatnonzero(reading.is_stance)
    state = true_state(clean_walk, 200)
    state.vector[VELOCITY] += (0.1, 0.0, 0.0)
    motion = Footholds(true_reading(daisy, clean_walk, 199), 20.0).advance(reading, speed_mps=0.0, is_gap=False)
    blocks = blocks_of(daisy, reading, motion, state)
    velocity = next(block for block in blocks if len(block.measured) == 3 * len(legs) and block.legs[0] >= 0)
    residual = (velocity.model(stack_of(state))[0] - velocity.measured).reshape(-1, 3)
    np.testing.assert_allclose(np.linalg.norm(residual, axis=1), 0.1, atol=1e-8)
    assert residual[0] @ (state.rotation.T @ np.array([1.0, 0.0, 0.0])) == pytest.approx(0.1)
