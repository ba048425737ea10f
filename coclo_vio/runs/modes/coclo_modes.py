# SPDX-License-Identifier: BSD-3-Clause
"""Leg odometry by COCLO, in the configured profile and as the paper prints it."""

from typing import TYPE_CHECKING

from coclo_vio.runs.modes.mode import Compared, Mode, Need
from coclo_vio.values.outputs import Estimator
from coclo_vio.values.trajectory_kind import TrajectoryKind

if TYPE_CHECKING:
    from coclo_vio.runs.equipment import Equipment
    from coclo_vio.runs.run_config import RunConfig


def _coclo(equipment: "Equipment", config: "RunConfig") -> Estimator:
    return _estimator("coclo", equipment, config)


def _coclo_leg_scale(equipment: "Equipment", config: "RunConfig") -> Estimator:
    robust = config.filter.robust.model_copy(update={"estimates_leg_scale": True})
    changed = config.filter.model_copy(update={"profile": "robust", "robust": robust})
    return _estimator("coclo_leg_scale", equipment, config.model_copy(update={"filter": changed}))


def _coclo_paper(equipment: "Equipment", config: "RunConfig") -> Estimator:
    changed = config.filter.model_copy(update={"profile": "paper"})
    return _estimator("coclo_paper", equipment, config.model_copy(update={"filter": changed}))


def _estimator(name: str, equipment: "Equipment", config: "RunConfig") -> Estimator:
    from coclo_vio.filter.odometry import LegOdometryFilter  # noqa: PLC0415 -- loads Pinocchio
    from coclo_vio.fusion.leg_odometry import LegOdometry  # noqa: PLC0415

    return LegOdometry(
        name,
        LegOdometryFilter(
            equipment.require_robot(),
            config.filter,
            camera_imu=equipment.second_imu,
            reports_innovations=equipment.pictures_every is not None,
        ),
    )


MODES = (
    Mode(
        "coclo",
        "contact-centric leg odometry, the configured profile (default: robust)",
        frozenset({Need.LEGS}),
        _coclo,
        (
            TrajectoryKind(
                "coclo",
                "COCLO",
                "#0072b2",
                1.3,
                is_featured=True,
                paper_drift_percent={"flat": 1.01, "ramp": 6.51, "stairs": 7.28},
            ),
        ),
        uses=frozenset({Need.IMU}),
        rank=10,
        default_rank=1,
        table=True,
    ),
    Mode(
        "coclo_leg_scale",
        "the robust profile, estimating the effective leg length",
        frozenset({Need.LEGS}),
        _coclo_leg_scale,
        (TrajectoryKind("coclo_leg_scale", colour="#0072b2", line_width=1.0, line_style="-.", layer=3),),
        uses=frozenset({Need.IMU}),
        rank=40,
        compared=Compared.ON_REQUEST,
    ),
    Mode(
        "coclo_paper",
        "the paper's profile, section III as printed",
        frozenset({Need.LEGS}),
        _coclo_paper,
        (TrajectoryKind("coclo_paper", colour="#56b4e9", line_width=1.0, line_style="--", layer=3),),
        rank=41,
    ),
)
