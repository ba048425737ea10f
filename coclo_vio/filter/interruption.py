# SPDX-License-Identifier: BSD-3-Clause
"""What a filter keeps, and what it gives up, where it goes on after an interruption or starts anew.

After an unknown time the body has moved by an unknown motion: pose, velocity and rate get noise of that size, and no
foothold holds. A filter that starts anew can take over what another one has learnt of constants.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from coclo_vio.filter.passive_states import PassiveStates
from coclo_vio.filter.square_root_filter import SquareRootFilter
from coclo_vio.filter.state import POSITION, RATE, ROTATION, VELOCITY, State
from coclo_vio.filter.unscented_transform import lower_factor
from coclo_vio.geometry import so3
from coclo_vio.values.arrays import Array

CONSTANTS = ("gyroscope_bias", "accelerometer_bias", "leg_scale", "leg_compliance", "camera")
_LEAST_SIGMA = 1e-8  # what is known better does not change

Learnt = Mapping[str, tuple[Array, Array]]
"""Value and one sigma of constants of the state, by the name of their block."""


def widen_over_gap(
    core: SquareRootFilter, gap_sigma_s: float, acceleration: float, angular_acceleration: float
) -> None:
    """Add the noise of a motion that lasted for an unknown time.

    Args:
        core: the filter; its mean stays.
        gap_sigma_s: one sigma of the time beyond what is predicted, s.
        acceleration: density of white acceleration, m/s^2/sqrt(Hz).
        angular_acceleration: density of white angular acceleration, rad/s^2/sqrt(Hz).
    """
    vector = core.mean.vector
    reach, root = np.sqrt(gap_sigma_s**3 / 3.0), np.sqrt(gap_sigma_s)
    speed = float(np.sqrt(vector[VELOCITY] @ vector[VELOCITY] + core.variance(VELOCITY).sum()))
    rate = float(np.sqrt(vector[RATE] @ vector[RATE] + core.variance(RATE).sum()))
    turn = rate * gap_sigma_s + angular_acceleration * reach
    rows = np.zeros((12, len(core.active_factor)))
    rows[:3, ROTATION] = turn * np.eye(3)
    rows[:3, POSITION] = turn * so3.hat(vector[POSITION]).T  # the body turns about its own position
    rows[3:6, POSITION] = (speed * gap_sigma_s + acceleration * reach) * np.eye(3)
    rows[6:9, VELOCITY] = acceleration * root * np.eye(3)
    rows[9:, RATE] = angular_acceleration * root * np.eye(3)
    core.replace_active(lower_factor(np.concatenate((core.active_factor.T, rows))))


def learnt_by(core: SquareRootFilter) -> dict[str, tuple[Array, Array]]:
    """What a filter has learnt of the constants of its state; correlations are left out."""
    there = {block.name for block in core.mean.layout.blocks}
    return {name: core.report(name) for name in CONSTANTS if name in there}


def take_learnt(core: SquareRootFilter, learnt: Learnt) -> None:
    """Take over what an earlier filter of the same sensors has learnt, at the start.

    Its posterior holds the prior, which both filters have; so the prior's information is removed from it first.
    """
    layout = core.mean.layout
    own: list[tuple[slice, Array, Array]] = []
    for name, (value, sigma) in learnt.items():
        if name not in {block.name for block in layout.blocks}:
            continue
        at = layout.at(name)
        if at.start >= layout.active:
            _replace_passive(core, at, value, sigma)
        else:
            own.append((at, value, sigma))
    indices, values, noise = [], [], []
    for at, value, sigma in own:
        for index, each, mine, before in zip(
            range(at.start, at.stop), value, sigma, np.sqrt(core.variance(at)), strict=True
        ):
            if _LEAST_SIGMA < mine < before:
                indices.append(index)
                values.append(each)
                noise.append(1.0 / np.sqrt(mine**-2 - before**-2))
    if not indices:
        return

    def model(stack: State) -> Array:
        return stack.vector[:, indices]

    predicted, rows = core.observe(model)
    core.update(rows, np.diag(noise), np.array(values) - predicted)


def _replace_passive(core: SquareRootFilter, at: slice, value: Array, sigma: Array) -> None:
    """Set passive errors that are correlated with nothing yet."""
    vector, active = core.mean.vector.copy(), core.mean.layout.active
    vector[at] = value
    own = core.passive.own.copy()
    errors = np.arange(at.start - active, at.stop - active)
    own[errors, errors] = np.square(sigma)
    factor = core.active_factor
    core.mean = replace(core.mean, vector=vector)
    core.passive = PassiveStates(core.passive.cross, own)
    core.replace_active(factor)
