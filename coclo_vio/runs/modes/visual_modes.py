# SPDX-License-Identifier: BSD-3-Clause
"""Stereo visual odometry: with a preintegrated IMU, alone, or with body twists of another source."""

from collections.abc import Callable
from typing import TYPE_CHECKING

from coclo_vio.runs.modes.mode import Compared, Mode, Need
from coclo_vio.values.outputs import Estimator
from coclo_vio.values.trajectory_kind import TrajectoryKind

if TYPE_CHECKING:
    from coclo_vio.runs.equipment import Equipment
    from coclo_vio.runs.run_config import RunConfig


def _vins(equipment: "Equipment", config: "RunConfig") -> Estimator:
    from coclo_vio.fusion.visual_odometry import visual_odometry  # noqa: PLC0415 -- loads GTSAM and OpenCV

    return visual_odometry(
        "vins",
        equipment.require_cameras(),
        config.frontend,
        config.smoother,
        imu=equipment.require_vision_imu(),
        ties="imu",
        has_frames=equipment.has_frames,
        pictures_every=equipment.pictures_every,
    )


def _without_imu_ties(name: str, *, uses_twist: bool) -> Callable[["Equipment", "RunConfig"], Estimator]:
    def make(equipment: "Equipment", config: "RunConfig") -> Estimator:
        from coclo_vio.fusion.visual_odometry import visual_odometry  # noqa: PLC0415 -- loads GTSAM and OpenCV

        stereo = equipment.require_cameras()
        if uses_twist:
            equipment.require_body_twist()
        return visual_odometry(
            name,
            stereo,
            config.frontend,
            config.smoother,
            imu=equipment.known_vision_imu,
            ties="twist" if uses_twist else "none",
            has_frames=equipment.has_frames,
            pictures_every=equipment.pictures_every,
        )

    return make


MODES = (
    Mode(
        "vins",
        "stereo and a preintegrated IMU in a sliding window",
        frozenset({Need.CAMERAS, Need.IMU}),
        _vins,
        (
            TrajectoryKind(
                "vins",
                "VINS",
                "#e69f00",
                1.3,
                is_featured=True,
                paper_drift_percent={"flat": 1.65, "ramp": 22.04, "stairs": 8.55},
            ),
        ),
        rank=20,
        default_rank=2,
        table=True,
    ),
    Mode(
        "stereo",
        "stereo alone in the same window; an IMU only levels the start",
        frozenset({Need.CAMERAS}),
        _without_imu_ties("stereo", uses_twist=False),
        (TrajectoryKind("stereo", colour="#8c5a2b", line_width=1.0, line_style="--", layer=3),),
        uses=frozenset({Need.IMU}),
        rank=50,
        default_rank=3,
        compared=Compared.WITHOUT_LEGS,
    ),
    Mode(
        "stereo_twist",
        "stereo, and a recorded body twist as weak odometry",
        frozenset({Need.CAMERAS, Need.BODY_TWIST}),
        _without_imu_ties("stereo_twist", uses_twist=True),
        (TrajectoryKind("stereo_twist", colour="#8c5a2b", line_width=1.0, line_style=":", layer=3),),
        uses=frozenset({Need.IMU}),
        rank=51,
        compared=Compared.WITHOUT_LEGS,
    ),
)
