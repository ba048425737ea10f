# SPDX-License-Identifier: BSD-3-Clause
"""GTSAM's legged fixed-lag smoother as a mode, for the time of a benchmark only."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from coclo_vio.runs.modes.mode import Mode, Need
from coclo_vio.runs.modes.registry import register_mode, unregister_mode
from coclo_vio.values.outputs import Estimator
from coclo_vio.values.trajectory_kind import TrajectoryKind

if TYPE_CHECKING:
    from coclo_vio.runs.equipment import Equipment
    from coclo_vio.runs.run_config import RunConfig

GTSAM_SMOOTHER = "gtsam_smoother"
"""Name of the mode and of its trajectory."""


def _make(equipment: "Equipment", config: "RunConfig") -> Estimator:
    from coclo_vio.backend.foothold_smoother import SmoothedLegOdometry  # noqa: PLC0415 -- loads GTSAM
    from coclo_vio.fusion.leg_odometry import LegOdometry  # noqa: PLC0415

    return LegOdometry(GTSAM_SMOOTHER, SmoothedLegOdometry(equipment.require_robot(), config.inekf))


@contextmanager
def smoother_mode() -> Iterator[None]:
    """The mode is registered inside, and forgotten afterwards."""
    kind = TrajectoryKind(GTSAM_SMOOTHER, colour="#8c5a2b", line_width=1.0, line_style="-.", layer=3)
    summary = "IMU-centric contact-aided fixed-lag smoother of GTSAM, a baseline"
    register_mode(Mode(GTSAM_SMOOTHER, summary, frozenset({Need.LEGS}), _make, (kind,), rank=43))
    try:
        yield
    finally:
        unregister_mode(GTSAM_SMOOTHER)
