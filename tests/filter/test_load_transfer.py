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
from coclo_vio.filter.state import LOAD_SLIP, SLIP, SLIP_TURN, VELOCITY
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
    speeds = walked(LoadTransfer(LEGS), 20.0).reshape(-1, round(STEP_S / DT_S))[1:]
    lift = round(LIFT_S / DT_S)
    assert (speeds[:, 4 : lift - 2] > SPEED_MPS).all()
    np.testing.assert_array_equal(speeds[:, lift + 10 :], 0.0)  # the foot that lands has not stood, the others lose


def test_its_mean_is_the_speed_of_the_body_as_soon_as_steps_are_known() -> None:
    speeds = walked(LoadTransfer(LEGS), 90.0)
    assert np.mean(speeds[: round(10.0 / DT_S)]) < np.mean(speeds[round(60.0 / DT_S) :])
    assert np.mean(speeds[round(60.0 / DT_S) :]) == pytest.approx(SPEED_MPS, rel=0.3)


def test_a_body_at_rest_takes_over_nothing() -> None:
    np.testing.assert_array_equal(walked(LoadTransfer(LEGS), 5.0, speed_mps=0.0), 0.0)


def test_weight_that_moves_slowly_makes_no_slip() -> None:
    transfer, every = LoadTransfer(LEGS), np.ones(LEGS, dtype=np.bool_)
    for time_s in np.arange(0.0, 10.0, DT_S):
        weights = np.full(LEGS, 1.0) + 0.5 * np.sin(0.5 * time_s + np.arange(LEGS))
        assert transfer.push(weights, every, SPEED_MPS, DT_S) == 0.0


def test_after_a_gap_no_foot_has_stood_and_without_weight_nothing_is_taken_over() -> None:
    transfer = LoadTransfer(LEGS)
    walked(transfer, 3.0)
    transfer.clear()
    weights = weights_at(3.0 + 0.5 * LIFT_S)
    assert transfer.push(weights, weights > 0.05, SPEED_MPS, DT_S) == 0.0
    assert transfer.push(np.zeros(LEGS), np.zeros(LEGS, dtype=np.bool_), SPEED_MPS, DT_S) == 0.0


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
        assert min(sigmas) > 0.3 * config.slip_share
    else:
        np.testing.assert_allclose(sigmas, shares, atol=1e-9)


def _sigma(block: StateBlock) -> float:
    return float(np.mean(np.asarray(block.sigma)))


def test_where_a_load_is_unknown_the_probabilities_of_contact_say_what_feet_carry(
    daisy: RobotModel, noisy_walk: AnalyticTrial, readings_of: Readings
) -> None:
    """A leg that lifts off by its probability, with no load known, is taken over as by loads."""

    readings = readings_of(noisy_walk.measurements)[:160]

    def speeds(*, is_known: bool) -> list[float]:
        footholds = Footholds(readings[0], daisy.description.contact.on_force)
        found = []
        for number, reading in enumerate(readings[1:]):
            weights = weights_at(number * DT_S)
            load = weights * 200.0 if is_known else np.full(LEGS, np.nan)
            contact = replace(reading.contact, probability=weights, load=load, is_stance=weights > 0.05)
            changed = replace(reading, contact=contact)
            found.append(footholds.advance(changed, speed_mps=SPEED_MPS, is_gap=False).takeover_speed)
        return found

    assert max(speeds(is_known=True)) > 0.0
    np.testing.assert_allclose(speeds(is_known=True), speeds(is_known=False), atol=1e-12)
