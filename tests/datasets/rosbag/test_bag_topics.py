# SPDX-License-Identifier: BSD-3-Clause
"""The topic of every role: inferred from names and types as recorded robots use them, or configured."""

import numpy as np
import pytest
from tiny_bags import JOINTS, START_NS, STEP_NS, TinyBag

from coclo_vio.datasets.dataset import DatasetConfig, open_dataset
from coclo_vio.robot.description import load_robot
from coclo_vio.values.config import parse_settings
from coclo_vio.values.errors import ConfigError
from coclo_vio.values.measurements import CameraImuSample, FootForceSample, ImuSample

JOINT_STATE, IMU = "sensor_msgs/msg/JointState", "sensor_msgs/msg/Imu"
IMAGE, COMPRESSED, INFO = (f"sensor_msgs/msg/{name}" for name in ("Image", "CompressedImage", "CameraInfo"))
TRANSFORM, ODOMETRY, POSE = (
    "geometry_msgs/msg/TransformStamped",
    "nav_msgs/msg/Odometry",
    "geometry_msgs/msg/PoseStamped",
)
WRENCH = "geometry_msgs/msg/WrenchStamped"


def open_with(tmp_path, robot, topics, *settings, **fields_of):
    """A bag with one message on each topic: (topic, type) or (topic, type, frame)."""
    bag = TinyBag(tmp_path / "walk.mcap")
    for topic, msgtype, *frame in topics:
        fields = {"header__frame_id": frame[0]} if frame else {}
        if msgtype == JOINT_STATE:
            fields |= {"name": list(JOINTS), "position": (0.0,) * 4}
        bag.add(topic, msgtype, START_NS, **fields | fields_of.get(topic, {}))
    config = DatasetConfig.parse(parse_settings([f"rosbag.{setting}" for setting in settings]), "test")
    return open_dataset(bag.write(), robot, config)


def chosen(dataset):
    return {choice.role: choice.topic for choice in dataset.topics() if choice.topics}


def choice_of(dataset, role):
    return next(choice for choice in dataset.topics() if choice.role == role)


REALSENSE = {
    "left_image": "/camera/infra1/image_rect_raw",
    "right_image": "/camera/infra2/image_rect_raw",
    "left_info": "/camera/infra1/camera_info",
    "right_info": "/camera/infra2/camera_info",
}
FIELD = {
    "a RealSense on a legged robot": (
        [
            ("/joint_states", JOINT_STATE),
            ("/imu", IMU, "imu_link"),
            ("/camera/imu", IMU, "camera_imu_optical_frame"),
            ("/camera/accel/sample", IMU, "camera_accel_frame"),
            ("/camera/gyro/sample", IMU, "camera_gyro_frame"),
            *((topic, IMAGE) for topic in list(REALSENSE.values())[:2]),
            *((topic, INFO) for topic in list(REALSENSE.values())[2:]),
            ("/camera/color/image_raw", IMAGE),
            ("/camera/color/camera_info", INFO),
            ("/camera/depth/image_rect_raw", IMAGE),
            ("/camera/depth/camera_info", INFO),
            ("/vicon/wand/wand", TRANSFORM),
            ("/vicon/biped/biped", TRANSFORM),
        ],
        {
            "joints": "/joint_states",
            "imu": "/imu",
            "camera_imu": "/camera/imu",
            **REALSENSE,
            "ground_truth": "/vicon/biped/biped",
        },
    ),
    "Cerberus": (
        [
            ("/hardware_a1/joint_foot", JOINT_STATE),
            ("/hardware_a1/imu", IMU, "/world"),
            ("/camera_forward/imu", IMU, "camera_imu"),
            ("/camera_forward/infra1/image_rect_raw/compressed", COMPRESSED),
            ("/camera_forward/infra2/image_rect_raw/compressed", COMPRESSED),
            ("/mocap_node/Robot_1/pose", POSE),
        ],
        {
            "joints": "/hardware_a1/joint_foot",
            "imu": "/hardware_a1/imu",
            "camera_imu": "/camera_forward/imu",
            "left_image": "/camera_forward/infra1/image_rect_raw/compressed",
            "right_image": "/camera_forward/infra2/image_rect_raw/compressed",
            "ground_truth": "/mocap_node/Robot_1/pose",
        },
    ),
    "EuRoC": (
        [
            ("/cam0/image_raw", IMAGE),
            ("/cam1/image_raw", IMAGE),
            ("/imu0", IMU, "imu4"),
            ("/vicon/firefly_sbx/firefly_sbx", TRANSFORM),
        ],
        {
            "left_image": "/cam0/image_raw",
            "right_image": "/cam1/image_raw",
            "imu": "/imu0",
            "ground_truth": "/vicon/firefly_sbx/firefly_sbx",
        },
    ),
    "stereo with raw, rectified and compressed images": (
        [
            *((f"/stereo/{side}/image_raw", IMAGE) for side in ("left", "right")),
            *((f"/stereo/{side}/image_rect", IMAGE) for side in ("left", "right")),
            *((f"/stereo/{side}/image_rect/compressed", COMPRESSED) for side in ("left", "right")),
            *((f"/stereo/{side}/camera_info", INFO) for side in ("left", "right")),
            ("/mavros/imu/data_raw", IMU),
            ("/mavros/imu/data", IMU),
            ("/zed/zed_node/imu/data", IMU),
            ("/odom", ODOMETRY),
        ],
        {
            "left_image": "/stereo/left/image_rect",
            "right_image": "/stereo/right/image_rect",
            "left_info": "/stereo/left/camera_info",
            "right_info": "/stereo/right/camera_info",
            "imu": "/mavros/imu/data",
            "camera_imu": "/zed/zed_node/imu/data",
        },
    ),
    "joint commands beside joint states": (
        [("/a/joint_command", JOINT_STATE), ("/z/joint_states", JOINT_STATE), ("/gazebo/ground_truth", ODOMETRY)],
        {"joints": "/z/joint_states", "ground_truth": "/gazebo/ground_truth"},
    ),
    "an IMU that only its frame identifies": (
        [("/imu_a", IMU, "d435i_imu_frame"), ("/imu_b", IMU, "trunk")],
        {"camera_imu": "/imu_a", "imu": "/imu_b"},
    ),
    "a mono camera and an estimator's pose": ([("/camera/left/image", IMAGE), ("/vins/odometry", ODOMETRY)], {}),
}


@pytest.mark.parametrize("name", FIELD)
def test_topics_of_recorded_robots_are_assigned(tmp_path, biped, name):
    topics, expected = FIELD[name]
    assert chosen(open_with(tmp_path, biped, topics)) == expected


def test_every_role_has_its_reason_and_the_other_topics(tmp_path, biped):
    topics = [("/imu", IMU), ("/imu/raw", IMU), ("/joint_states", JOINT_STATE), ("/vicon/other/other", TRANSFORM)]
    dataset = open_with(tmp_path, biped, topics)
    roles = "joints imu camera_imu left_image right_image left_info right_info ground_truth foot_force"
    assert [choice.role for choice in dataset.topics()] == roles.split()
    imu = choice_of(dataset, "imu")
    assert (imu.topic, imu.msgtype, imu.others) == ("/imu", IMU, ("/imu/raw",))
    assert "4 of the 4 joints of biped" in choice_of(dataset, "joints").reason
    assert all(choice.reason for choice in dataset.topics())
    assert any("/imu is read, not /imu/raw" in note for note in dataset.report().notes)


def test_the_configuration_takes_precedence(tmp_path, biped):
    topics = [("/imu", IMU), ("/camera/imu", IMU), ("/vicon/a/a", TRANSFORM), ("/odom", ODOMETRY)]
    settings = ("topics.imu=/camera/imu", "topics.camera_imu=/imu", "topics.ground_truth=/odom")
    dataset = open_with(tmp_path, biped, topics, *settings)
    assert chosen(dataset) == {"imu": "/camera/imu", "camera_imu": "/imu", "ground_truth": "/odom"}
    assert choice_of(dataset, "imu").reason == "named in dataset.rosbag.topics"


def test_a_role_can_be_left_out(tmp_path, biped):
    topics = [("/imu", IMU), ("/vicon/a/a", TRANSFORM), ("/joint_states", JOINT_STATE), ("/foot/left", WRENCH)]
    settings = ("topics.imu=''", "topics.ground_truth=''", "topics.joints=[]", "topics.foot_force={}")
    dataset = open_with(tmp_path, biped, topics, *settings)
    assert chosen(dataset) == {}
    assert "left out" in choice_of(dataset, "imu").reason


def test_one_imu_may_serve_as_both(tmp_path, biped):
    settings = ("topics.imu=/camera/imu", "topics.camera_imu=/camera/imu")
    dataset = open_with(tmp_path, biped, [("/camera/imu", IMU)], *settings)
    samples = list(dataset.measurements(frozenset({ImuSample, CameraImuSample})))
    assert [type(sample) for sample in samples] == [ImuSample, CameraImuSample]


def test_a_custom_type_is_read_as_the_configured_one(tmp_path, biped):
    fields = {"/body": {"pose__pose__orientation__w": 1.0}}
    dataset = open_with(tmp_path, biped, [("/imu", IMU), ("/body", ODOMETRY)], f"types={{/body: {POSE}}}", **fields)
    assert choice_of(dataset, "ground_truth").others == ("/body",)
    with pytest.raises(ConfigError, match="written like sensor_msgs/msg/Imu"):
        open_with(tmp_path / "again", biped, [("/imu", IMU)], "types={/imu: Imu}")


def test_one_camera_info_is_not_taken_for_both(tmp_path, biped):
    topics = [("/stereo/left/image", IMAGE), ("/stereo/right/image", IMAGE), ("/stereo/camera_info", INFO)]
    dataset = open_with(tmp_path, biped, topics)
    assert set(chosen(dataset)) == {"left_image", "right_image"}
    assert dataset.stereo_calibration() is None


def test_the_feet_are_found_by_the_names_of_the_legs(tmp_path):
    robot = load_robot("daisy")
    topics = [("/foot_force/leg1", WRENCH), ("/foot_force/leg2", WRENCH), ("/leg1/hip", WRENCH), ("/arm", WRENCH)]
    dataset = open_with(tmp_path, robot, topics)
    feet = choice_of(dataset, "foot_force")
    assert feet.topics == ("/foot_force/leg1", "/foot_force/leg2")
    assert feet.others == ("/arm", "/leg1/hip")
    settings = "topics.foot_force={leg3: /arm}"
    named = open_with(tmp_path / "again", robot, topics, settings, **{"/arm": {"wrench__force__z": 9.0}})
    (sample,) = named.measurements(frozenset({FootForceSample}))
    np.testing.assert_array_equal(np.flatnonzero(sample.force == 9.0), [2])


def test_topics_without_messages_are_not_chosen(tmp_path, biped):
    bag = TinyBag(tmp_path / "walk.bag")
    bag.add_imu(START_NS, topic="/imu/raw")
    bag.add_imu(START_NS + STEP_NS, topic="/imu/raw")
    path = bag.write()
    assert chosen(open_dataset(path, biped)) == {"imu": "/imu/raw"}
