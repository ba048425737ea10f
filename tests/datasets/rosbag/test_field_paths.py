# SPDX-License-Identifier: BSD-3-Clause
"""Messages of types that nobody reads, such as a Unitree's LowState: their fields by path, or how to name them."""

import sqlite3

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Ros2Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from tiny_bags import START_NS, STEP_NS, TinyBag

from coclo_vio.datasets.dataset import DatasetConfig, open_dataset
from coclo_vio.robot.description import load_robot
from coclo_vio.runs.inspection import inspect_recording
from coclo_vio.values.config import parse_settings
from coclo_vio.values.errors import CocloError, ConfigError, DatasetError, TopicNotFound
from coclo_vio.values.measurements import FootForceSample, ImuSample, JointSample

DEFINITIONS = {
    "unitree_go/msg/IMUState": "float32[4] quaternion\nfloat32[3] gyroscope\nfloat32[3] accelerometer\nint8 heat\n",
    "unitree_go/msg/MotorState": "uint8 mode\nfloat32 q\nfloat32 dq\nfloat32 ddq\nfloat32 tau_est\n",
    "unitree_go/msg/LowState": "unitree_go/IMUState imu_state\nunitree_go/MotorState[20] motor_state\n"
    "int16[4] foot_force\nuint32 tick\n",
    "my_robot/msg/State": "std_msgs/Header header\ngeometry_msgs/Vector3 turning\nfloat64[] forces\n",
}


def store_of_all():
    store = get_typestore(Stores.ROS2_HUMBLE)
    for name, text in DEFINITIONS.items():
        store.register(get_types_from_msg(text, name))
    return store


def low_state(store, i):
    types = store.types
    imu = types["unitree_go/msg/IMUState"](
        np.zeros(4, np.float32),
        np.array([0.25, 0.5, i], dtype=np.float32),
        np.array([0.0, 1.0, 9.75], dtype=np.float32),
        20,
    )
    motors = [types["unitree_go/msg/MotorState"](1, 0.5 * k, 0.25 * k, 0.0, -float(k)) for k in range(20)]
    return types["unitree_go/msg/LowState"](imu, motors, np.array([10, 20, 30, 40], dtype=np.int16), i)


def write(path, messages, plugin=StoragePlugin.MCAP):
    """A ROS 2 file of (topic, received_ns, message)."""
    store = store_of_all()
    with Ros2Writer(path.with_suffix(""), version=9, storage_plugin=plugin) as writer:
        topics = {}
        for topic, received_ns, message in messages(store):
            kind = message.__msgtype__
            if topic not in topics:
                topics[topic] = writer.add_connection(topic, kind, typestore=store)
            writer.write(topics[topic], received_ns, store.serialize_cdr(message, kind))
    (path.with_suffix("") / path.name).rename(path)
    return path


@pytest.fixture
def unitree(tmp_path):
    def messages(store):
        yield from (("/lowstate", START_NS + i * STEP_NS, low_state(store, i)) for i in range(60))

    return write(tmp_path / "go2.mcap", messages)


def config_of(*settings):
    return DatasetConfig.parse(parse_settings([f"rosbag.{setting}" for setting in settings]), "test")


def setting_in(error):
    """The setting that a sentence proposes."""
    return str(error.value).partition("dataset.rosbag.")[2].partition("; ")[0].replace("'{", "{").replace("}'", "}")


def test_a_bag_of_lowstate_alone_is_refused_with_the_setting_that_reads_it(unitree):
    go1 = load_robot("go1")
    with pytest.raises(CocloError) as error:
        inspect_recording(unitree, None, DatasetConfig())
    assert "/lowstate is of the type unitree_go/msg/LowState" in str(error.value)
    dataset = open_dataset(unitree, go1, config_of(setting_in(error)))
    samples = list(dataset.measurements())
    imu = [sample for sample in samples if isinstance(sample, ImuSample)]
    joints = [sample for sample in samples if isinstance(sample, JointSample)]
    feet = [sample for sample in samples if isinstance(sample, FootForceSample)]
    assert [len(imu), len(joints), len(feet)] == [60, 60, 60]
    assert [sample.stamp_ns for sample in joints] == [START_NS + i * STEP_NS for i in range(60)]
    np.testing.assert_array_equal(imu[7].angular_velocity, [0.25, 0.5, 7.0])
    np.testing.assert_array_equal(imu[7].specific_force, [0.0, 1.0, 9.75])
    np.testing.assert_array_equal(joints[3].position, 0.5 * np.arange(12))
    np.testing.assert_array_equal(joints[3].velocity, 0.25 * np.arange(12))
    np.testing.assert_array_equal(joints[3].effort, -np.arange(12.0))
    np.testing.assert_array_equal(feet[0].force, [10.0, 20.0, 30.0, 40.0])
    assert {choice.reason for choice in dataset.topics() if choice.topics} == {"fields named in dataset.rosbag.fields"}
    with pytest.raises(TopicNotFound, match=r"no JointState among .*dataset\.rosbag\.fields='{imu"):
        list(open_dataset(unitree, go1).measurements())
    report = dataset.report()
    assert report.dropped == {}
    assert any("/lowstate have no header: they are stamped with the time at which" in note for note in report.notes)


def test_the_order_of_joints_and_legs_is_that_of_the_names(unitree):
    go1 = load_robot("go1")
    names = ", ".join(reversed(go1.joint_names))
    dataset = open_dataset(
        unitree,
        go1,
        config_of(
            f"fields.joints={{topic: /lowstate, position: 'motor_state[0:12].q', names: [{names}]}}",
            "fields.foot_force={topic: /lowstate, force: foot_force, legs: [RL, RR, FL, FR]}",
        ),
    )
    samples = list(dataset.measurements(frozenset({JointSample, FootForceSample})))
    joints = next(sample for sample in samples if isinstance(sample, JointSample))
    np.testing.assert_array_equal(joints.position, 0.5 * np.arange(12)[::-1])
    assert list(next(sample for sample in samples if isinstance(sample, FootForceSample)).force) == [40, 30, 20, 10]
    assert any("no joint velocity in the bag" in note for note in dataset.report().notes)


def test_a_message_with_a_header_has_its_stamp(tmp_path):
    def messages(store):
        types = store.types
        for i in range(10):
            seconds, nanoseconds = divmod(START_NS + i * STEP_NS, 10**9)
            header = types["std_msgs/msg/Header"](types["builtin_interfaces/msg/Time"](seconds, nanoseconds), "trunk")
            turning = types["geometry_msgs/msg/Vector3"](0.1, 0.2, 0.3)
            state = types["my_robot/msg/State"](header, turning, np.array([7.0, 0.0, 0.0, 9.81]))
            yield "/state", START_NS + 5 * 10**9, state

    path = write(tmp_path / "walk.mcap", messages)
    with pytest.raises(DatasetError, match=r"/state \(my_robot/msg/State\); their fields can be named in dataset"):
        open_dataset(path, None).report()
    config = config_of("fields.imu={topic: /state, gyroscope: turning, accelerometer: 'forces[1:4]'}")
    samples = list(open_dataset(path, None, config).measurements())
    assert [sample.stamp_ns for sample in samples] == [START_NS + i * STEP_NS for i in range(10)]
    np.testing.assert_array_equal(samples[0].specific_force, [0.0, 0.0, 9.81])


@pytest.mark.parametrize(
    ("setting", "error", "sentence"),
    [
        ("topic: /low, gyroscope: a, accelerometer: b", TopicNotFound, "no topic /low.*those there are: /lowstate"),
        ("topic: /lowstate, gyroscope: a, accelerometer: b", DatasetError, "no field a .*foot_force, imu_state"),
        ("topic: /lowstate, gyroscope: imu_state, accelerometer: tick", DatasetError, "imu_state.*holds no numbers"),
        ("topic: /lowstate, gyroscope: tick, accelerometer: tick", DatasetError, "holds 1 numbers, not the 3"),
        ("topic: /lowstate, gyroscope: 'foot_force[2:9]', accelerometer: tick", DatasetError, "has 4 entries"),
        ("topic: /lowstate, gyroscope: 'tick[0]', accelerometer: tick", DatasetError, "has no entries"),
        ("topic: /lowstate, gyroscope: 'a b', accelerometer: tick", ConfigError, "'a b' is none"),
    ],
)
def test_a_wrong_path_is_one_sentence_that_lists_the_fields(unitree, setting, error, sentence):
    with pytest.raises(error, match=sentence) as found:
        list(open_dataset(unitree, None, config_of(f"fields.imu={{{setting}}}")).measurements())
    assert "\n" not in str(found.value)


def test_too_few_names_are_one_sentence(unitree):
    with pytest.raises(DatasetError, match="holds 20 angles, but there are 12 names"):
        open_dataset(
            unitree, load_robot("go1"), config_of("fields.joints={topic: /lowstate, position: 'motor_state[0:20].q'}")
        )


def test_a_type_without_a_definition_is_said_to_have_none(tmp_path):
    bag = TinyBag(tmp_path / "walk.db3")
    bag.add_imu(START_NS)
    path = bag.write()
    with sqlite3.connect(path) as database:
        database.execute("UPDATE topics SET type = 'unitree_go/msg/LowState'")
        database.execute("DELETE FROM message_definitions")
    config = config_of("fields.imu={topic: /imu, gyroscope: a, accelerometer: b}")
    with pytest.raises(DatasetError, match="no definition of unitree_go/msg/LowState"):
        open_dataset(path, None, config)
