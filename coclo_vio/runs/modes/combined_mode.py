# SPDX-License-Identifier: BSD-3-Clause
"""Leg odometry and stereo vision together, with feedback (paper section IV)."""

from typing import TYPE_CHECKING

from coclo_vio.runs.modes.mode import Mode, Need
from coclo_vio.values.outputs import Estimator
from coclo_vio.values.trajectory_kind import TrajectoryKind

if TYPE_CHECKING:
    from coclo_vio.runs.equipment import Equipment
    from coclo_vio.runs.run_config import RunConfig


def _combined(equipment: "Equipment", config: "RunConfig") -> Estimator:
    from coclo_vio.filter.odometry import LegOdometryFilter  # noqa: PLC0415 -- loads Pinocchio
    from coclo_vio.filter.state_blocks import held_frame_block  # noqa: PLC0415
    from coclo_vio.fusion.combined import combined_odometry  # noqa: PLC0415 -- loads GTSAM and OpenCV
    from coclo_vio.fusion.combined_beside import combined_beside  # noqa: PLC0415

    is_beside = config.bridge.vision == "beside"
    make = combined_beside if is_beside else combined_odometry
    return make(
        LegOdometryFilter(
            equipment.require_robot(),
            config.filter,
            remembers_frames=True,
            extra_blocks=(held_frame_block(),) if is_beside else (),
            camera_imu=equipment.second_imu,
            reports_innovations=equipment.pictures_every is not None,
        ),
        equipment.require_cameras(),
        config.frontend,
        config.smoother,
        config.bridge,
        has_frames=equipment.has_frames,
        pictures_every=equipment.pictures_every,
    )


MODES = (
    Mode(
        "combined",
        "leg odometry and stereo vision that correct each other: combined_coclo and combined_vins",
        frozenset({Need.LEGS, Need.CAMERAS}),
        _combined,
        (
            TrajectoryKind(
                "combined_coclo",
                "combined COCLO",
                "#009e73",
                1.4,
                layer=6,
                standalone="coclo",
                is_featured=True,
                paper_drift_percent={"flat": 1.57, "stairs": 2.61},
            ),
            TrajectoryKind(
                "combined_vins",
                "combined VINS",
                "#cc79a7",
                3.0,  # wide: the two are often one curve
                layer=5,
                standalone="vins",
                is_featured=True,
                paper_drift_percent={"flat": 1.46, "stairs": 5.28},
            ),
        ),
        uses=frozenset({Need.IMU}),
        rank=30,
        default_rank=0,
        table=True,
        has_feedback=True,
    ),
)
