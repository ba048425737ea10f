# SPDX-License-Identifier: BSD-3-Clause
"""Bags as real robots record them, inspected: the topics read, those that could be, and what is missing."""

import re
from pathlib import Path

import numpy as np
import pytest
from tiny_bags import START_NS, STEP_NS, TinyBag

from coclo_vio.datasets.config import DatasetConfig
from coclo_vio.datasets.dataset import open_dataset
from coclo_vio.datasets.kalibr import KalibrConfig
from coclo_vio.datasets.rosbag.config import RosbagConfig, RosbagTopics
from coclo_vio.robot.description import load_robot
from coclo_vio.runs.inspection import inspect_recording
from coclo_vio.runs.run_config import resolve
from coclo_vio.values.config import parse_settings
from coclo_vio.values.measurements import FootForceSample, ImuSample, JointSample

GREY = np.zeros((4, 6), dtype=np.uint8)
CERBERUS_LEGS = ("FL", "FR", "RL", "RR")
CERBERUS = [f"{leg}{i}" for leg in CERBERUS_LEGS for i in range(3)]
CERBERUS_NAMES = ", ".join(
    f"{leg}_{part}_joint: {leg}{i}" for leg in CERBERUS_LEGS for i, part in enumerate(("hip", "thigh", "calf"))
)


def read_as(*settings):
    return DatasetConfig.parse(parse_settings([f"rosbag.{setting}" for setting in settings]), "test")


def topics_of(inspection):
    return {topic.role: topic for topic in inspection.topics}


def at(i):
    return START_NS + i * STEP_NS


@pytest.fixture
def cerberus(tmp_path):
    """A Unitree A1 as Cerberus records it: feet behind the joints of one message, a second IMU, its own odometry."""
    bag = TinyBag(tmp_path / "street.bag")
    feet = [f"{leg}_foot" for leg in CERBERUS_LEGS]
    for i in range(20):
        numbers = tuple(np.arange(16.0))
        fields = {"position": numbers, "velocity": numbers, "effort": numbers}
        bag.add_joints(at(i), names=CERBERUS + feet, topic="/hardware_a1/joint_foot", **fields)
        bag.add_joints(at(i), names=CERBERUS, topic="/hardware_a1/joint_torque_cmd", position=numbers[:12])
        bag.add_imu(at(i), topic="/hardware_a1/imu")
        if i % 2 == 0:
            bag.add_imu(at(i), topic="/imu/data")
            bag.add("/hardware_a1/estimation_body_pose", "nav_msgs/msg/Odometry", at(i))
            bag.add("/mocap_node/mocap/pose", "geometry_msgs/msg/PoseStamped", at(i), pose__orientation__w=1.0)
            for side in (1, 2):
                bag.add_image(at(i), f"/camera_forward/infra{side}/image_rect_raw", GREY)
    return bag.write()


def test_the_topics_of_cerberus_are_assigned_beside_a_second_imu_and_its_own_odometry(cerberus):
    inspection = inspect_recording(cerberus, None, DatasetConfig())
    topics = topics_of(inspection)
    assert (topics["imu"].topics, topics["imu"].others) == (("/hardware_a1/imu",), ("/imu/data",))
    assert topics["left_image"].topics == ("/camera_forward/infra1/image_rect_raw",)
    assert topics["ground_truth"].topics == ("/mocap_node/mocap/pose",)
    assert topics["ground_truth"].others == ("/hardware_a1/estimation_body_pose",)
    assert topics["joints"].others == ("/hardware_a1/joint_foot", "/hardware_a1/joint_torque_cmd")
    assert set(CERBERUS) < set(inspection.joints.there)
    assert inspection.joints.nearest is None
    assert any("kalibr" in note for note in inspection.report.notes)


def test_joint_names_of_another_robot_are_reported_with_those_in_the_bag(cerberus):
    inspection = inspect_recording(cerberus, load_robot("a1"), DatasetConfig())
    assert len(inspection.joints.missing) == 12
    assert topics_of(inspection)["joints"].reason == "holds 0 of the 12 joints of a1"
    assert any("FL0" in problem for problem in inspection.problems)
    assert inspection.missing["coclo"] == ("12 of a1's 12 joints",)


def test_cerberus_is_read_whole_once_its_joints_are_named(cerberus):
    config, a1 = read_as(f"joint_names={{{CERBERUS_NAMES}}}"), load_robot("a1")
    inspection = inspect_recording(cerberus, a1, config)
    topics = topics_of(inspection)
    assert inspection.joints.matched == a1.joint_names
    assert (topics["joints"].topics, topics["joints"].others) == (
        ("/hardware_a1/joint_foot",),
        ("/hardware_a1/joint_torque_cmd",),
    )
    assert inspection.missing["coclo"] == ()
    samples = list(open_dataset(cerberus, a1, config).measurements())
    force = next(sample for sample in samples if isinstance(sample, FootForceSample))
    np.testing.assert_array_equal(force.force, [13.0, 12.0, 15.0, 14.0])  # a1 has its right legs first
    joints = next(sample for sample in samples if isinstance(sample, JointSample))
    np.testing.assert_array_equal(joints.effort[:6], [3.0, 4.0, 5.0, 0.0, 1.0, 2.0])


def test_an_anymal_with_depth_cameras_has_their_infrared_pair(tmp_path):
    anymal = load_robot("anymal_b")
    bag = TinyBag(tmp_path / "anymal")
    for i in range(10):
        numbers = tuple(np.ones(12))
        bag.add_joints(
            at(i), names=anymal.joint_names, topic="/state_estimator/joint_states", position=numbers, effort=numbers
        )
        bag.add_imu(at(i), topic="/sensors/imu")
        bag.add_imu(at(i), topic="/depth_camera_front/accel/sample")
        bag.add("/state_estimator/odometry", "nav_msgs/msg/Odometry", at(i), pose__pose__orientation__w=1.0)
        for camera in ("infra1", "infra2", "depth"):
            bag.add_image(at(i), f"/depth_camera_front/{camera}/image_rect_raw", GREY)
        for side in ("front", "rear"):
            bag.add_image(at(i), f"/wide_angle_camera_{side}/image_raw", GREY)
    inspection = inspect_recording(bag.write(), anymal, DatasetConfig())
    topics = topics_of(inspection)
    assert topics["left_image"].topics == ("/depth_camera_front/infra1/image_rect_raw",)
    assert topics["left_image"].others == ("/wide_angle_camera_front/image_raw", "/wide_angle_camera_rear/image_raw")
    assert topics["imu"].topics == ("/sensors/imu",)
    assert topics["camera_imu"].topics == ()
    assert (topics["ground_truth"].topics, topics["ground_truth"].others) == ((), ("/state_estimator/odometry",))
    assert inspection.missing["coclo"] == ()


def test_a_spot_without_imu_is_read_for_what_it_has(tmp_path):
    bag = TinyBag(tmp_path / "spot.mcap")
    for i in range(10):
        bag.add_joints(at(i), names=("front_left_hip_x", "front_left_knee"), position=(1.0, 2.0))
        bag.add("/odometry", "nav_msgs/msg/Odometry", at(i), pose__pose__orientation__w=1.0)
        for side in ("frontleft", "frontright"):
            bag.add_image(at(i), f"/camera/{side}/image", GREY)
            bag.add_image(at(i), f"/depth/{side}/image", GREY)
    inspection = inspect_recording(bag.write(), None, DatasetConfig())
    topics = topics_of(inspection)
    assert topics["imu"].reason == "no topic is of type Imu"
    assert (topics["left_image"].topics, topics["left_image"].others) == (("/camera/frontleft/image",), ())
    assert inspection.problems == ()
    assert inspection.joints.there == ("front_left_hip_x", "front_left_knee")
    assert inspection.missing["stereo"] == ("calibration of the cameras",)
    assert inspection.missing["coclo"][0].startswith("a robot (the joints are those of no known one")


def test_the_page_on_recordings_reads_cerberus(cerberus, tmp_path):
    page = (Path(__file__).resolve().parents[3] / "docs" / "recordings.md").read_text(encoding="utf-8")
    (example,) = re.findall(r"```yaml\n(robot: .*?)```", page, flags=re.DOTALL)
    file = tmp_path / "a1.yaml"
    file.write_text(example, encoding="utf-8")
    resolved = resolve(file=file)
    rosbag = resolved.dataset.rosbag
    assert rosbag.kalibr.camchain == Path("camchain-imucam.yaml")
    bare = rosbag.model_copy(update={"kalibr": KalibrConfig()})
    dataset = open_dataset(cerberus, resolved.robot, resolved.dataset.model_copy(update={"rosbag": bare}))
    assert {type(sample) for sample in dataset.measurements()} == {FootForceSample, ImuSample, JointSample}
    truth = dataset.ground_truth()
    assert truth is not None
    np.testing.assert_allclose(truth.trajectory.T_world_body[0, :3, 3], [0.0, 0.0, -0.1])


def test_every_role_and_setting_of_the_page_on_recordings_exists():
    page = (Path(__file__).resolve().parents[3] / "docs" / "recordings.md").read_text(encoding="utf-8")
    roles = page.partition("| role |")[2].partition("\n\n")[0]
    named = {name for row in roles.splitlines()[2:] for name in re.findall(r"`(\w+)`", row.split("|")[1])}
    assert named == set(RosbagTopics.model_fields) - {"tf_static"}
    settings = page.partition("| the recording |")[2].partition("\n\n")[0]
    assert {re.split(r"[`:]", row.split("|")[2])[1] for row in settings.splitlines()[2:]} <= set(
        RosbagConfig.model_fields
    )
