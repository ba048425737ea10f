# SPDX-License-Identifier: BSD-3-Clause
"""Real and bundled recordings whose robot was described by hand. What is real skips where the recordings are absent."""

import numpy as np
import pytest

from coclo_vio.adoption.adopt import adopt
from coclo_vio.adoption.adoption import Adoption
from coclo_vio.datasets.sample import sample_path
from coclo_vio.robot.description import RobotDescription, load_robot, urdf_path


def assert_same(adoption: Adoption, robot: RobotDescription) -> None:
    found = adoption.description
    assert {(leg.name, leg.joints, leg.foot_frame) for leg in found.legs} == {
        (leg.name, leg.joints, leg.foot_frame) for leg in robot.legs
    }
    np.testing.assert_allclose(found.imu.T_body_imu, robot.imu.T_body_imu, atol=1e-4)
    assert found.contact.source == robot.contact.source
    assert found.contact.on_force == pytest.approx(robot.contact.on_force, rel=0.25)
    assert found.contact.off_force == pytest.approx(robot.contact.off_force, rel=0.3)


@pytest.mark.long
def test_the_bundled_daisy() -> None:
    adoption = adopt(urdf_path(load_robot("daisy")), sample_path())
    assert_same(adoption, load_robot("daisy"))
    assert [leg.foot_radius_m for leg in adoption.description.legs] == [0.02] * 6
    assert [field.key for field in adoption.questions] == ["imu.position_body_m"]


def test_the_go1_of_the_motion_capture(shared_data) -> None:
    adoption = adopt(shared_data / "go1_mocap" / "go1.urdf", shared_data / "go1_mocap")
    assert_same(adoption, load_robot("go1"))
    assert adoption.description.joint_aliases == load_robot("go1").joint_aliases
    assert adoption.description.joint_velocity_noise_radps == pytest.approx(0.35, rel=0.15)


def test_the_swaying_biped_has_flat_feet_and_a_turned_imu(shared_data) -> None:
    folder = shared_data / "icub_sway"
    adoption = adopt(folder / "model.urdf", folder)
    assert_same(adoption, load_robot(folder / "icub.yaml"))
    assert [leg.foot_radius_m for leg in adoption.description.legs] == [0.0, 0.0]
    assert not next(field for field in adoption.fields if field.key.startswith("contact.on_force")).is_sure


def test_a_bag_with_too_few_names_and_foot_forces_in_another_order(shared_data) -> None:
    adoption = adopt(shared_data / "go1_mocap" / "go1.urdf", shared_data / "go1_bags" / "Go_1_move.bag")
    assert adoption.description.leg_names == ("FL", "FR", "RL", "RR")
    joints, feet = adoption.settings
    places = ("hip", "thigh", "calf")
    listed = ", ".join(f"{leg}_{place}_joint" for leg in ("FL", "FR", "RL", "RR") for place in places)
    assert joints == f"dataset.rosbag.joint_entries=[{listed}]"
    assert feet == (
        'dataset.rosbag.foot_force_entries={FL: "effort[9]", FR: "effort[8]", RL: "effort[11]", RR: "effort[10]"}'
    )
    np.testing.assert_allclose(adoption.description.imu.T_body_imu, load_robot("go1").imu.T_body_imu, atol=1e-6)
    assert "contact.forces" in {field.key for field in adoption.questions}
