# SPDX-License-Identifier: BSD-3-Clause
"""An adoption writes the corners of flat feet, and asks for them where the URDF does not show them."""

from pathlib import Path

import pytest
from flat_biped import Noise, walk, write_biped

from coclo_vio.adoption.adopt import adopt
from coclo_vio.datasets.writer import write_leg_log
from coclo_vio.robot.description import load_robot
from coclo_vio.robot.model import RobotModel


@pytest.mark.parametrize(("has_corners", "is_sure"), [(True, True), (False, False)])
def test_corners_of_soles_are_written_or_asked_for(tmp_path: Path, has_corners: bool, is_sure: bool) -> None:
    name = "sole" if has_corners else "plate"
    description = write_biped(tmp_path, has_sole_shape=has_corners, sole_name=name)
    log = write_leg_log(tmp_path, description, walk(RobotModel(description)).measurements(Noise(), 1))
    adoption = adopt(tmp_path / "biped.urdf", log)
    written = load_robot(adoption.write(tmp_path / "found.yaml"))
    assert [leg.is_flat for leg in written.legs] == [True, True]
    assert [len(leg.contact_points_m) for leg in written.legs] == ([4, 4] if has_corners else [0, 0])
    assert ("contact_points_m" not in {field.key for field in adoption.questions}) == is_sure
