# SPDX-License-Identifier: BSD-3-Clause
"""Baselines of leg odometry: GTSAM's contact-aided invariant filter, and stance legs averaged without a filter."""

from collections.abc import Callable
from typing import TYPE_CHECKING

from coclo_vio.runs.modes.mode import Compared, Mode, Need
from coclo_vio.values.outputs import Estimator
from coclo_vio.values.trajectory_kind import TrajectoryKind

if TYPE_CHECKING:
    from coclo_vio.runs.equipment import Equipment
    from coclo_vio.runs.run_config import RunConfig


def _inekf(equipment: "Equipment", config: "RunConfig") -> Estimator:
    from coclo_vio.backend.inekf import InvariantLegOdometry  # noqa: PLC0415 -- loads GTSAM
    from coclo_vio.fusion.leg_odometry import LegOdometry  # noqa: PLC0415

    return LegOdometry("inekf", InvariantLegOdometry(equipment.require_robot(), config.inekf))


def _naive(name: str, *, rolls_feet: bool, weighs_load: bool) -> Callable[["Equipment", "RunConfig"], Estimator]:
    def make(equipment: "Equipment", config: "RunConfig") -> Estimator:
        from coclo_vio.filter.naive import NaiveLegOdometry  # noqa: PLC0415 -- loads Pinocchio
        from coclo_vio.fusion.leg_odometry import LegOdometry  # noqa: PLC0415

        robot = equipment.require_robot()
        naive = NaiveLegOdometry(robot, config.filter, rolls_feet=rolls_feet, weighs_load=weighs_load)
        return LegOdometry(name, naive)

    return make


_LEGS = frozenset({Need.LEGS})

MODES = (
    Mode(
        "inekf",
        "IMU-centric contact-aided filter of GTSAM, a baseline",
        _LEGS,
        _inekf,
        (TrajectoryKind("inekf", colour="#d55e00", line_width=1.0, line_style="--", layer=3),),
        rank=42,
    ),
    Mode(
        "naive",
        "stance feet averaged, foot centres at rest, attitude by the gyroscope",
        _LEGS,
        _naive("naive", rolls_feet=False, weighs_load=False),
        (TrajectoryKind("naive", colour="#8a8a8a", line_width=1.0, line_style="--", layer=2),),
        rank=60,
    ),
    Mode(
        "naive_rolling",
        "naive with rolling feet",
        _LEGS,
        _naive("naive_rolling", rolls_feet=True, weighs_load=False),
        (TrajectoryKind("naive_rolling", colour="#5a5a5a", line_width=1.0, line_style=":", layer=2),),
        rank=61,
        compared=Compared.ON_REQUEST,
    ),
    Mode(
        "naive_weighted",
        "naive with rolling feet weighted by load",
        _LEGS,
        _naive("naive_weighted", rolls_feet=True, weighs_load=True),
        (TrajectoryKind("naive_weighted", colour="#5a5a5a", line_width=1.0, line_style="-.", layer=2),),
        rank=62,
        compared=Compared.ON_REQUEST,
    ),
)
