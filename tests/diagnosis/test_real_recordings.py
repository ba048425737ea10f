# SPDX-License-Identifier: BSD-3-Clause
"""Recordings by others that are sound: the checks of joints, contacts and ground truth find nothing."""

from pathlib import Path

import pytest

from coclo_vio.datasets.dataset import open_dataset
from coclo_vio.diagnosis.all_checks import CHECKS
from coclo_vio.diagnosis.diagnose import diagnose
from coclo_vio.diagnosis.evidence import Evidence
from coclo_vio.diagnosis.finding import Stage
from coclo_vio.robot.description import load_robot

_STAGES = {Stage.JOINTS, Stage.CONTACT, Stage.GROUND_TRUTH}


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "robot_name"),
    [("go1_mocap", "go1"), ("icub_sway", "icub_sway/icub.yaml"), ("euroc_v1_01_start", None)],
)
def test_sound_recordings_have_no_findings(shared_data: Path, name: str, robot_name: str | None) -> None:
    robot = None
    if robot_name is not None:
        robot = load_robot(shared_data / robot_name if "/" in robot_name else robot_name)
    dataset = open_dataset(shared_data / name, robot)
    imu = dataset.imu_calibration() if robot is None else robot.imu
    checks = [check for check in CHECKS if check.stage in _STAGES]
    assert diagnose(Evidence(dataset, robot, imu), checks).findings == ()
