# SPDX-License-Identifier: BSD-3-Clause
"""One number from two sources that disagree: calibrations of the cameras, mountings of the body's IMU."""

from collections.abc import Iterator
from typing import Protocol, runtime_checkable

import numpy as np

from coclo_vio.diagnosis.evidence import Evidence
from coclo_vio.diagnosis.finding import Finding, Stage, warning
from coclo_vio.geometry import so3

_MOUNTING_DEG = 5.0
_ROTATION = "rotation_body_imu_rpy_rad"


@runtime_checkable
class HasConflicts(Protocol):
    """A dataset whose calibration may come from several sources."""

    def calibration_conflicts(self) -> tuple[str, ...]:
        """Where they disagree, a sentence each."""


def find_conflicts(evidence: Evidence) -> Iterator[Finding]:
    """Where two sources have different numbers for the same thing."""
    if isinstance(evidence.dataset, HasConflicts):
        for sentence in evidence.dataset.calibration_conflicts():
            yield warning("calibrations_disagree", Stage.CAMERAS, "stereo", sentence)
    used, other = evidence.robot_imu, evidence.unused_imu
    if used is None or other is None or not all(_ROTATION in each.model_fields_set for each in (used, other)):
        return
    apart = so3.log(used.T_body_imu[:3, :3].T @ other.T_body_imu[:3, :3])
    apart_deg = float(np.degrees(np.linalg.norm(apart)))
    if apart_deg > _MOUNTING_DEG:
        yield warning(
            "imu_mountings_disagree",
            Stage.MOUNTING,
            "imu",
            f"the mounting of the body's IMU differs by {apart_deg:.0f} deg between the recording and the robot's "
            "description; that of imu_calibration (recording by default) is used: correct the one that is wrong",
        )
