# SPDX-License-Identifier: BSD-3-Clause
"""Layouts of the filter's state with default parameters, and random states, for tests that need no profile."""

import numpy as np

from coclo_vio.filter.config import InitialConfig, PaperConfig, RobustConfig
from coclo_vio.filter.state import State, StateLayout
from coclo_vio.filter.state_blocks import StateBlock, paper_blocks, robust_blocks
from coclo_vio.geometry import so3
from coclo_vio.values.calibration import ImuCalibration


def layout_of(
    legs: int,
    *,
    has_contacts: bool = False,
    has_frame: bool = False,
    config: RobustConfig | None = None,
    extra: tuple[StateBlock, ...] = (),
) -> StateLayout:
    """The state of a robot, with contact probabilities as in the paper's profile or without."""
    initial, imu = InitialConfig(), ImuCalibration()
    if has_contacts:
        return StateLayout(paper_blocks(legs, PaperConfig(), initial, imu, has_frame=has_frame))
    return StateLayout(robust_blocks(legs, config or RobustConfig(), initial, imu, has_frame=has_frame, extra=extra))


def state_of(layout: StateLayout, random: np.random.Generator) -> State:
    """A state of random numbers; the entries of the rotations are zero."""
    vector = random.normal(size=layout.dimension)
    for at in layout.rotations:
        vector[at] = 0.0
    remembered = so3.exp(random.normal(size=(len(layout.poses), 3)))
    return State(layout, so3.exp(random.normal(size=3)), vector, remembered)
