# SPDX-License-Identifier: BSD-3-Clause
import numpy as np
import pytest

from coclo_vio.adoption.contact_levels import contact_levels, swing_scatter


def loads(swing: float, stance: float, share: float, seed: int = 4) -> np.ndarray:
    random = np.random.default_rng(seed)
    stands = random.random((3000, 4)) < share
    values = np.where(stands, random.normal(stance, 0.15 * abs(stance), stands.shape), swing)
    return np.asarray(values + random.normal(0.0, 0.03 * abs(stance), stands.shape))


@pytest.mark.parametrize(
    ("swing", "stance", "share"), [(0.0, 40.0, 0.6), (25.0, 450.0, 0.5), (-3.0, 60.0, 0.9), (0, 6, 0.3)]
)
def test_thresholds_are_between_feet_in_the_air_and_on_the_floor(swing, stance, share) -> None:
    levels = contact_levels(loads(swing, stance, share))
    assert levels.swing == pytest.approx(swing, abs=0.03 * stance)
    assert levels.stance == pytest.approx(stance, rel=0.05)
    assert swing + 0.2 * stance < levels.off < levels.on < 0.7 * stance
    assert levels.confidence > 0.7


def test_feet_that_were_never_lifted_give_shares_of_their_load() -> None:
    values = np.random.default_rng(5).normal(160.0, 15.0, (2000, 2))
    levels = contact_levels(values)
    assert (levels.separation, levels.on, levels.off) == (0.0, pytest.approx(80, abs=1), pytest.approx(48, abs=1))
    assert levels.confidence < 0.5


def test_loads_that_shift_between_two_feet_are_no_swing() -> None:
    sway = 40.0 * np.sin(np.linspace(0, 30, 3000))
    levels = contact_levels(np.column_stack((160.0 + sway, 160.0 - sway)))
    assert levels.separation == 0.0


def test_missing_loads_are_left_out_and_every_leg_counts() -> None:
    values = loads(0.0, 40.0, 0.6)
    values[::3] = np.nan
    assert contact_levels(values).stance == pytest.approx(40.0, rel=0.05)
    unequal = np.column_stack((np.zeros(30_000), np.full(30_000, 50.0)))
    assert contact_levels(unequal + np.random.default_rng(1).normal(0, 1, unequal.shape)).stance == pytest.approx(
        50, rel=0.05
    )


def test_a_noisier_swing_has_more_scatter() -> None:
    quiet = loads(0.0, 40.0, 0.5)
    noisy = quiet + np.random.default_rng(6).normal(0.0, 3.0, quiet.shape)
    assert swing_scatter(quiet, contact_levels(quiet)) < swing_scatter(noisy, contact_levels(noisy))
