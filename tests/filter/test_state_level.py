# SPDX-License-Identifier: BSD-3-Clause
"""The level of slip: it follows a state that is observed, and stays where nothing observes the state."""

from dataclasses import replace

import numpy as np
import pytest

from coclo_vio.filter.config import InitialConfig, RobustConfig
from coclo_vio.filter.leg_consistency import LegConsistency
from coclo_vio.filter.square_root_filter import SquareRootFilter
from coclo_vio.filter.state import State, StateLayout
from coclo_vio.filter.state_blocks import StateBlock, robust_blocks
from coclo_vio.filter.state_level import SlipLevels, StateLevel, creep_level, largest_level
from coclo_vio.values.calibration import ImuCalibration

SECONDS = 600


def core_of_six_legs() -> tuple[SquareRootFilter, StateBlock]:
    blocks = robust_blocks(6, RobustConfig(), InitialConfig(), ImuCalibration())
    layout = StateLayout(blocks)
    state = State(layout, np.eye(3), np.zeros(layout.dimension), np.zeros((0, 3, 3)))
    slip = next(block for block in blocks if block.name == "slip")
    return SquareRootFilter(state, np.diag(layout.sigmas(is_moving=False)), is_wide=False), slip


def learnt(share: float, sigma_left: float, seed: int) -> tuple[float, float]:
    """The level, and the walk as a multiple of the declared one, after ten minutes with a correction a second.

    Args:
        share: true sigma of the slip, as a multiple of the declared one.
        sigma_left: what a correction leaves of its uncertainty, as a multiple of the declared sigma.
        seed: of the slip.
    """
    core, block = core_of_six_legs()
    random, level = np.random.default_rng(seed), StateLevel(block)
    at = core.mean.layout.at("slip")
    sigma = float(np.mean(np.asarray(block.sigma)))
    kept = np.exp(-1.0 / block.memory_s)
    slip = share * sigma * random.normal(size=3)
    for second in range(1, SECONDS):
        slip = kept * slip + np.sqrt(1.0 - kept**2) * share * sigma * random.normal(size=3)
        vector = np.zeros(core.mean.layout.dimension)
        vector[at] = slip if sigma_left < 1.0 else 0.0
        core.mean = replace(core.mean, vector=vector)
        factor = np.diag(core.mean.layout.sigmas(is_moving=False))
        factor[at, at] = sigma_left * sigma * np.eye(3)
        core.replace_active(factor)
        level.learn(core, second * 1_000_000_000)
    return level.level, float(core.mean.layout.walks[at][0] / block.walk)


@pytest.mark.parametrize("share", [0.4, 1.0, 2.5])
def test_the_level_follows_a_slip_that_is_observed(share: float) -> None:
    level, walk = learnt(share, 0.05, seed=4)
    prior, data = 2.0, 6.0  # time constants of the state, see the module
    expected = np.sqrt((prior + data * share**2) / (prior + data))
    assert level == pytest.approx(expected, rel=0.35)
    assert walk == pytest.approx(level)


def test_the_level_stays_where_nothing_observes_the_slip() -> None:
    level, walk = learnt(3.0, 1.0, seed=5)
    assert level == pytest.approx(1.0)
    assert walk == pytest.approx(1.0)


def test_less_slip_means_less_level_before_it_is_well_observed() -> None:
    assert learnt(0.2, 0.6, seed=6)[0] < 0.85


def test_the_level_has_limits() -> None:
    assert learnt(60.0, 0.05, seed=7)[0] == 4.0


def consistency(
    lasting_share: float, stances: float = 20.0, legs: float = 5.0, *, noise_factor: float = 0.09
) -> LegConsistency:
    return LegConsistency(noise_factor, lasting_share, stances, legs, 1e-4)


def test_legs_that_agree_bound_the_slip_that_they_have_in_common() -> None:
    assert largest_level(consistency(0.002), 0.015) == pytest.approx(1.5 * 0.002 / 0.015)
    assert largest_level(consistency(0.03), 0.015) == pytest.approx(3.0)


@pytest.mark.parametrize(
    "shown", [None, consistency(0.002, stances=5.0), consistency(0.002, legs=2.0)], ids=["none", "seldom", "trot"]
)
def test_legs_that_are_few_or_seldom_compared_bound_nothing(shown: LegConsistency | None) -> None:
    assert largest_level(shown, 0.015) == np.inf
    assert creep_level(shown, 0.015) == 1.0


def test_a_slip_that_is_declared_as_none_has_no_bound() -> None:
    assert largest_level(consistency(0.002), 0.0) == np.inf
    assert creep_level(consistency(0.002), 0.0) == 1.0


def test_feet_creep_as_little_as_legs_differ_from_interval_to_interval() -> None:
    assert creep_level(consistency(0.0), 0.015) == pytest.approx(0.3)
    assert creep_level(consistency(0.006), 0.015) == pytest.approx(0.5)


def test_feet_that_differ_for_long_or_from_interval_to_interval_creep_as_declared() -> None:
    assert creep_level(consistency(0.03), 0.015) == 1.0
    assert creep_level(consistency(0.0, noise_factor=3.0), 0.015) == 1.0


def test_all_levels_are_learnt_together() -> None:
    core, block = core_of_six_legs()
    core.replace_active(np.diag(core.mean.layout.sigmas(is_moving=False)))
    levels = SlipLevels(core.mean.layout, 0.015)
    assert levels.learn(core, 1_000_000_000, None) == 1.0
    assert levels.learn(core, 2_000_000_000, consistency(0.006)) == pytest.approx(0.5)
    assert core.mean.layout.walks[core.mean.layout.at("slip")] == pytest.approx(0.6 * block.walk)


def test_the_level_is_no_larger_than_the_bound_and_no_smaller_than_a_fifth() -> None:
    core, block = core_of_six_legs()
    core.replace_active(np.diag(core.mean.layout.sigmas(is_moving=False)))
    level = StateLevel(block)
    for second, largest in enumerate((np.inf, 0.5, 0.01, np.inf), start=1):
        level.learn(core, second * 1_000_000_000, largest)
        expected = {0.5: 0.5, 0.01: 0.2}.get(largest, 1.0)
        assert level.level == pytest.approx(expected, rel=0.2)
        assert core.mean.layout.walks[core.mean.layout.at("slip")] == pytest.approx(block.walk * level.level)
