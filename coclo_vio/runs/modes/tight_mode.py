# SPDX-License-Identifier: BSD-3-Clause
"""Leg odometry and stereo vision in one window, with nothing fed back (the paper's future work)."""

from typing import TYPE_CHECKING

from coclo_vio.runs.modes.mode import Compared, Mode, Need
from coclo_vio.values.measurements import CameraImuSample
from coclo_vio.values.outputs import Estimator
from coclo_vio.values.trajectory_kind import TrajectoryKind

if TYPE_CHECKING:
    from coclo_vio.runs.equipment import Equipment
    from coclo_vio.runs.run_config import RunConfig


def _tight(equipment: "Equipment", config: "RunConfig") -> Estimator:
    from coclo_vio.fusion.tight import tight_odometry  # noqa: PLC0415 -- loads Pinocchio, GTSAM and OpenCV

    return tight_odometry(
        equipment.require_robot(),
        config.filter,
        equipment.require_cameras(),
        config.frontend,
        config.smoother,
        camera_imu=equipment.camera_imu if equipment.vision_imu is CameraImuSample else None,
        has_frames=equipment.has_frames,
        pictures_every=equipment.pictures_every,
    )


MODES = (
    Mode(
        "tight",
        "legs, IMU and stereo in one sliding window, nothing fed back: tight and tight_vins",
        frozenset({Need.LEGS, Need.CAMERAS}),
        _tight,
        (
            TrajectoryKind("tight", "tight", "#d55e00", 1.4, layer=6, standalone="coclo"),
            TrajectoryKind("tight_vins", "tight VINS", "#f0a878", 2.4, layer=5, standalone="vins"),
        ),
        uses=frozenset({Need.IMU}),
        rank=35,
        compared=Compared.ON_REQUEST,
    ),
)
