# SPDX-License-Identifier: BSD-3-Clause
"""Standing feet slip while they take over the weight of one that lifts off."""

from collections.abc import Callable, Iterable
from dataclasses import replace

import numpy as np
import pytest
from state_layouts import layout_of, state_of

from coclo_vio.filter.config import InitialConfig, RobustConfig
from coclo_vio.filter.load_transfer import LoadTransfer
from coclo_vio.filter.process_model import slip_velocity
from coclo_vio.filter.stance import Footholds
from coclo_vio.filter.state import LOAD_SLIP, SLIP, SLIP_TURN, VELOCITY, StateLayout
from coclo_vio.filter.state_blocks import StateBlock, robust_blocks
from coclo_vio.robot.leg_sensing import Reading
from coclo_vio.robot.model import RobotModel
from coclo_vio.simulation.analytic import AnalyticTrial
from coclo_vio.values.arrays import Array
from coclo_vio.values.calibration import ImuCalibration
from coclo_vio.values.measurements import Measurement

Readings = Callable[[Iterable[Measurement]], list[Reading]]
LEGS, DT_S, SPEED_MPS = 6, 0.01, 0.1
STEP_S, LIFT_S = 1.0, 0.1


def weights_at(time_s: float) -> Array:
    """Each second one leg more hands its weight to the others within 0.1 s, and has it again half a second later."""
    leg, phase_s = int(time_s / STEP_S) % LEGS, time_s % STEP_S
    lifted = np.interp(phase_s, [0.0, LIFT_S, 0.5, 0.5 + LIFT_S], [0.0, 1.0, 1.0, 0.0])
    weights = np.full(LEGS, 1.0)
    weights[leg] -= lifted
    return weights / weights.sum()


def walked(transfer: LoadTransfer, seconds: float, speed_mps: float = SPEED_MPS) -> Array:
    """Speeds of the takeover, by sample."""
    speeds = []
    for time_s in np.arange(0.0, seconds, DT_S):
        weights = weights_at(time_s)
        speeds.append(transfer.push(weights, weights > 0.05, speed_mps, DT_S))
    return np.array(speeds)


def test_weight_is_taken_over_while_a_foot_lifts_off_and_at_no_other_time() -> None:
    speeds = walked(LoadTransfer(np.ones(LEGS)), 20.0).reshape(-1, round(STEP_S / DT_S))[1:]
    lift = round(LIFT_S / DT_S)
    assert (speeds[:, 4 : lift - 2] > SPEED_MPS).all()
    np.testing.assert_array_equal(speeds[:, lift + 10 :], 0.0)  # the foot that lands has not stood, the others lose


def test_its_mean_is_the_speed_of_the_body_as_soon_as_steps_are_known() -> None:
    speeds = walked(LoadTransfer(np.ones(LEGS)), 160.0)
    assert np.mean(speeds[: round(10.0 / DT_S)]) < 0.8 * np.mean(speeds[round(100.0 / DT_S) :])
    assert np.mean(speeds[round(100.0 / DT_S) :]) == pytest.approx(SPEED_MPS, rel=0.05)


def test_a_body_at_rest_takes_over_nothing() -> None:
    np.testing.assert_array_equal(walked(LoadTransfer(np.ones(LEGS)), 5.0, speed_mps=0.0), 0.0)


def test_weight_that_moves_slowly_makes_no_slip() -> None:
    transfer, every = LoadTransfer(np.ones(LEGS)), np.ones(LEGS, dtype=np.bool_)
    for time_s in np.arange(0.0, 10.0, DT_S):
        weights = np.full(LEGS, 1.0) + 0.5 * np.sin(0.5 * time_s + np.arange(LEGS))
        assert transfer.push(weights, every, SPEED_MPS, DT_S) == 0.0


def test_the_first_takeover_after_a_long_way_is_bounded() -> None:
    transfer, every = LoadTransfer(np.ones(LEGS)), np.ones(LEGS, dtype=np.bool_)
    for _ in range(3000):
        transfer.push(np.ones(LEGS), every, SPEED_MPS, DT_S)
    speeds = walked(transfer, 1.0)
    assert SPEED_MPS < speeds.max() < 31.0 * SPEED_MPS


def test_weights_that_do_not_continue_are_no_takeover() -> None:
    """After a restart the first weights count as they are, and feet have not stood; without any weight nothing is."""
    transfer, every = LoadTransfer(np.ones(LEGS)), np.ones(LEGS, dtype=np.bool_)
    walked(transfer, 3.0)
    lifted, down = weights_at(3.0 + 0.5 * LIFT_S), weights_at(3.0 + LIFT_S)
    transfer.restart(lifted)
    assert transfer.push(down, every, SPEED_MPS, DT_S) == 0.0
    for _ in range(50):
        transfer.push(down, every, SPEED_MPS, DT_S)
    assert transfer.push(np.zeros(LEGS), every, SPEED_MPS, DT_S) == 0.0
    assert transfer.push(weights_at(0.99), every, SPEED_MPS, DT_S) > 0.0


def test_standing_feet_slip_together_by_speed_and_by_the_weight_they_take_over() -> None:
    state = state_of(layout_of(LEGS), np.random.default_rng(1))
    state.vector[:] = 0.0
    state.vector[VELOCITY], state.vector[SLIP], state.vector[SLIP_TURN] = (0.1, 0.0, 0.0), (0.02, 0.0, 0.0), 0.0
    state.vector[LOAD_SLIP] = (0.0, -0.03, 0.01)
    stack = replace(state, rotation=state.rotation[None], vector=state.vector[None])
    velocity = slip_velocity(stack, np.zeros((LEGS, 3)), 0.5)
    np.testing.assert_allclose(velocity, np.tile((0.002, -0.015, 0.005), (1, LEGS, 1)), atol=1e-15)


@pytest.mark.parametrize(
    ("legs", "part", "shares"), [(6, None, None), (4, None, (0.015, 0.0)), (4, 0.36, (0.012, 0.009))]
)
def test_the_variance_of_slip_is_split(legs: int, part: float | None, shares: tuple[float, float] | None) -> None:
    config = RobustConfig(load_slip_part=part)
    blocks = {each.name: each for each in robust_blocks(legs, config, InitialConfig(), ImuCalibration())}
    sigmas = [_sigma(blocks["slip"]), _sigma(blocks["load_slip"])]
    assert np.hypot(*sigmas) == pytest.approx(config.slip_share)
    if shares is None:
        np.testing.assert_allclose(sigmas, config.slip_share * np.sqrt(0.5))
    else:
        np.testing.assert_allclose(sigmas, shares, atol=1e-9)


@pytest.mark.parametrize("part", [0.0, 1.0])
def test_what_is_known_does_not_decay(part: float) -> None:
    """A certain state that decayed without a walk would have a covariance of zero after an hour."""
    layout = StateLayout(robust_blocks(4, RobustConfig(load_slip_part=part), InitialConfig(), ImuCalibration()))
    known, other = (LOAD_SLIP, SLIP) if part == 0.0 else (SLIP, LOAD_SLIP)
    np.testing.assert_array_equal(layout.kept(3600.0)[known], 1.0)
    assert (layout.kept(3600.0)[other] < 1e-9).all()


def _sigma(block: StateBlock) -> float:
    return float(np.mean(np.asarray(block.sigma)))


def takeover_speeds(robot: RobotModel, readings: list[Reading], loads: Callable[[int, Array], Array]) -> Array:
    """Of footholds whose contact probabilities are the shares of the weight, and whose loads are as given."""
    footholds, found = Footholds(readings[0], robot.description.contact.on_force), []
    for number, reading in enumerate(readings[1:]):
        weights = weights_at(number * DT_S)
        contact = replace(
            reading.contact, probability=weights, load=loads(number, 200.0 * weights), is_stance=weights > 0.05
        )
        motion = footholds.advance(replace(reading, contact=contact), speed_mps=SPEED_MPS, is_gap=number == 140)
        found.append(motion.takeover_speed)
    return np.array(found)


def test_where_a_load_is_unknown_the_probabilities_of_contact_say_what_feet_carry(
    daisy: RobotModel, noisy_walk: AnalyticTrial, readings_of: Readings
) -> None:
    readings = readings_of(noisy_walk.measurements)[:160]
    by_loads = takeover_speeds(daisy, readings, lambda _, load: load)
    by_probability = takeover_speeds(daisy, readings, lambda _, load: np.where(np.arange(LEGS) == 2, np.nan, load))
    assert by_loads.max() > 0.0
    assert by_loads[140] == 0.0
    np.testing.assert_allclose(by_loads, by_probability, rtol=0.05)  # its first weights are those of the first reading


def test_loads_that_are_known_at_times_make_no_takeover(
    daisy: RobotModel, noisy_walk: AnalyticTrial, readings_of: Readings
) -> None:
    """Loads of another scale between feet than the probabilities."""
    readings = readings_of(noisy_walk.measurements)[:100]
    uneven = np.array([3.0, 1.0, 2.0, 1.0, 2.0, 1.0])
    speeds = takeover_speeds(
        daisy, readings, lambda number, load: np.full(LEGS, np.nan) if number % 45 == 44 else uneven
    )
    np.testing.assert_array_equal(speeds, 0.0)


def test_a_robot_without_slip_by_load_has_no_takeover(
    daisy: RobotModel, noisy_walk: AnalyticTrial, readings_of: Readings
) -> None:
    readings = readings_of(noisy_walk.measurements)[:100]
    footholds = Footholds(readings[0], daisy.description.contact.on_force, follows_takeover=False)
    assert {footholds.advance(each, speed_mps=SPEED_MPS, is_gap=False).takeover_speed for each in readings[1:]} == {0.0}
