# SPDX-License-Identifier: BSD-3-Clause
"""Reading sound bags: all formats, any order of joints and messages, constant memory."""

import sqlite3
import tracemalloc

import numpy as np
import pytest
from tiny_bags import JOINTS, KINDS, START_NS, STEP_NS, TinyBag, angle_of

from coclo_vio.datasets.dataset import DatasetConfig, guess_robot, open_dataset
from coclo_vio.datasets.rosbag.storage.bag_file import BagFile
from coclo_vio.robot.description import load_robot
from coclo_vio.values.config import parse_settings
from coclo_vio.values.errors import DatasetError, TimestampError
from coclo_vio.values.measurements import (
    ALL_SENSORS,
    CameraImuSample,
    FootForceSample,
    ImuSample,
    JointSample,
    StereoFrame,
)

ANGLES = [angle_of(joint) for joint in JOINTS]


def configured(*settings):
    return DatasetConfig.parse(parse_settings([f"rosbag.{setting}" for setting in settings]), "test")


def samples_of(dataset, kind, sensors=ALL_SENSORS):
    return [sample for sample in dataset.measurements(sensors) if isinstance(sample, kind)]


@pytest.fixture(params=KINDS)
def bag(request, tmp_path):
    return TinyBag(tmp_path / request.param)


@pytest.fixture
def mcap(tmp_path):
    return TinyBag(tmp_path / "walk.mcap")


def test_every_format_has_the_same_samples(bag, biped):
    for i in range(5):
        stamp_ns = START_NS + i * STEP_NS
        bag.add_joints(stamp_ns, velocity=(1.0, 2.0, 3.0, 4.0), effort=(5.0, 6.0, 7.0, np.inf))
        bag.add_imu(stamp_ns)
        bag.add_imu(stamp_ns, topic="/camera/imu", rate_x=0.25)
        bag.add("/foot_force/left", "geometry_msgs/msg/WrenchStamped", stamp_ns, wrench__force__z=30.0)
        bag.add("/foot_force/right", "geometry_msgs/msg/WrenchStamped", stamp_ns, wrench__force__z=40.0)
    dataset = open_dataset(bag.write(), biped)
    got = list(dataset.measurements(ALL_SENSORS))
    assert [type(sample) for sample in got[:4]] == [FootForceSample, ImuSample, JointSample, CameraImuSample]
    assert [sample.stamp_ns for sample in got[::4]] == [START_NS + i * STEP_NS for i in range(5)]
    force, imu, joints, camera_imu = got[-4:]
    np.testing.assert_array_equal(force.force, [30.0, 40.0])
    np.testing.assert_array_equal(imu.angular_velocity, [0.5, 0.0, 0.0])
    np.testing.assert_array_equal(imu.specific_force, [0.0, 0.0, 9.81])
    np.testing.assert_array_equal(camera_imu.angular_velocity, [0.25, 0.0, 0.0])
    np.testing.assert_array_equal(joints.position, ANGLES)
    np.testing.assert_array_equal(joints.velocity, [1.0, 2.0, 3.0, 4.0])
    np.testing.assert_array_equal(joints.effort, [5.0, 6.0, 7.0, np.nan])
    assert dataset.report().stream("joints").samples == 5
    assert len(list(dataset.measurements())) == 15  # from the beginning again, without the camera


def test_joints_are_read_by_name_in_any_order_and_among_others(bag, biped):
    bag.add_joints(START_NS, names=("gripper", *reversed(JOINTS)))
    bag.add_joints(START_NS + STEP_NS, names=JOINTS)
    first, second = samples_of(open_dataset(bag.write(), biped), JointSample)
    np.testing.assert_array_equal(first.position, ANGLES)
    np.testing.assert_array_equal(second.position, ANGLES)
    assert np.isnan(second.effort).all()


def test_aliases_names_and_signs_of_joints_are_followed(mcap, biped):
    mcap.add_joints(START_NS, names=("left_hip", "left_knee", "q3", "right_knee"), position=(1.0, 2.0, 3.0, 4.0))
    config = configured("joint_names={right_hip_joint: q3}", "joint_signs={left_knee_joint: -1}")
    (sample,) = samples_of(open_dataset(mcap.write(), biped, config), JointSample)
    np.testing.assert_array_equal(sample.position, [1.0, -2.0, 3.0, 4.0])


def test_joints_spread_over_topics_and_messages_come_together(mcap, biped):
    for i in range(3):
        stamp_ns = START_NS + i * STEP_NS
        mcap.add_joints(stamp_ns, names=JOINTS[:1], topic="/left")
        mcap.add_joints(stamp_ns + 1000, names=JOINTS[1:2], topic="/left")
        if i != 1:
            mcap.add_joints(stamp_ns, names=JOINTS[2:], topic="/right")
    samples = samples_of(open_dataset(mcap.write(), biped), JointSample)
    np.testing.assert_array_equal([sample.position for sample in samples][::2], [ANGLES, ANGLES])
    np.testing.assert_array_equal(samples[1].position, [*ANGLES[:2], np.nan, np.nan])
    assert [sample.stamp_ns - START_NS for sample in samples] == [1000, STEP_NS + 1000, 2 * STEP_NS + 1000]


def test_a_message_without_names_takes_those_of_the_configuration(mcap, biped):
    mcap.add("/joints", "sensor_msgs/msg/JointState", START_NS, position=(1.0, 2.0, 3.0, 4.0, 5.0))
    path = mcap.write()
    with pytest.raises(DatasetError, match=r"name no joints.*joint_entries"):
        list(open_dataset(path, biped).measurements())
    config = configured("joint_entries=[lamp, right_hip_joint, right_knee_joint, left_hip_joint, left_knee_joint]")
    (sample,) = samples_of(open_dataset(path, biped, config), JointSample)
    np.testing.assert_array_equal(sample.position, [4.0, 5.0, 2.0, 3.0])


def test_a_missing_velocity_is_estimated_and_noted(mcap, biped):
    for i in range(20):
        mcap.add_joints(START_NS + i * STEP_NS, position=(0.03 * i, 0.0, 0.0, -0.01 * i))
    dataset = open_dataset(mcap.write(), biped)
    velocity = samples_of(dataset, JointSample)[-1].velocity
    np.testing.assert_allclose(velocity, [3.0, 0.0, 0.0, -1.0], atol=1e-9)
    assert "no joint velocity in the bag: estimated causally from the angles" in dataset.report().notes


@pytest.mark.parametrize(
    ("settings", "expected"),
    [
        ([], [7.0, 8.0]),
        (["foot_force_entries='effort[4:6]'"], [7.0, 8.0]),
        (["foot_force_entries={left: 'effort[5]', right: left_foot}"], [8.0, 7.0]),
        (["foot_force_entries={left: 'position[left_foot]'}"], [0.7, np.nan]),
    ],
)
def test_foot_forces_among_the_joints_are_found(mcap, biped, settings, expected):
    names, angles = (*JOINTS, "left_foot", "right_foot"), (*ANGLES, 0.7, 0.8)
    mcap.add_joints(START_NS, names=names, position=angles, effort=(1.0, 2.0, 3.0, 4.0, 7.0, 8.0))
    force, joints = open_dataset(mcap.write(), biped, configured(*settings)).measurements()
    np.testing.assert_array_equal(force.force, expected)
    np.testing.assert_array_equal(joints.effort, [1.0, 2.0, 3.0, 4.0])


def test_foot_forces_of_different_times_are_separate_readings(mcap, biped):
    kind = "geometry_msgs/msg/WrenchStamped"
    mcap.add_joints(START_NS)
    mcap.add("/wrench/left", kind, START_NS, wrench__force__x=3.0, wrench__force__z=4.0)
    mcap.add("/wrench/right", kind, START_NS + STEP_NS, wrench__force__z=2.0)
    path = mcap.write()
    first, second = samples_of(open_dataset(path, biped), FootForceSample)
    np.testing.assert_array_equal([first.force, second.force], [[4.0, np.nan], [np.nan, 2.0]])
    lengths = samples_of(open_dataset(path, biped, configured("foot_force_component=norm")), FootForceSample)
    assert lengths[0].force[0] == 5.0


def test_messages_that_arrive_late_are_put_in_order(bag, biped):
    for i in range(30):
        stamp_ns = START_NS + i * STEP_NS
        bag.add_joints(stamp_ns, received_ns=stamp_ns + 300_000_000)
        bag.add_imu(stamp_ns, received_ns=stamp_ns)
    dataset = open_dataset(bag.write(), biped)
    stamps = [sample.stamp_ns for sample in dataset.measurements()]
    assert stamps == sorted(stamps)
    assert len(stamps) == 60
    in_time = open_dataset(bag.path, biped, configured("reorder_s=0.05"))
    stamps = [sample.stamp_ns for sample in in_time.measurements()]
    assert stamps != sorted(stamps)
    assert len(stamps) == 60
    assert any("reorder_s" in note for note in in_time.report().notes)


def test_a_bag_written_in_no_order_is_read_in_the_order_of_arrival(bag, biped):
    for i in np.random.default_rng(3).permutation(40):
        bag.add_imu(START_NS + int(i) * STEP_NS, rate_x=float(i))
    samples = samples_of(open_dataset(bag.write(), biped), ImuSample, frozenset({ImuSample}))
    assert [sample.angular_velocity[0] for sample in samples] == list(range(40))


def test_a_message_recorded_twice_is_passed_on_twice_and_counted(bag, biped):
    for i in (0, 1, 1, 2):
        bag.add_joints(START_NS + i * STEP_NS)
    dataset = open_dataset(bag.write(), biped)
    assert len(list(dataset.measurements())) == 4
    assert dataset.report().stream("joints").repeated_stamps == 1


def test_the_time_of_arrival_is_used_if_configured(bag, biped):
    for i in range(3):
        bag.add_joints(START_NS - i, received_ns=START_NS + i * STEP_NS)
    dataset = open_dataset(bag.write(), biped, configured("clock=received"))
    assert [sample.stamp_ns for sample in dataset.measurements()] == [START_NS + i * STEP_NS for i in range(3)]


def test_messages_of_one_time_are_matched_though_they_arrive_one_by_one(bag, biped):
    grey, kind = np.zeros((2, 2), dtype=np.uint8), "geometry_msgs/msg/WrenchStamped"
    for i in range(3):
        stamp_ns, came_ns = 5 + i * STEP_NS, START_NS + i * STEP_NS
        bag.add("/foot/left", kind, stamp_ns, received_ns=came_ns, wrench__force__z=1.0)
        bag.add("/foot/right", kind, stamp_ns, received_ns=came_ns + 2_000_000, wrench__force__z=2.0)
        bag.add_image(stamp_ns, "/left/image", grey, received_ns=came_ns + 3_000_000)
        bag.add_image(stamp_ns, "/right/image", grey, received_ns=came_ns + 6_000_000)
    dataset = open_dataset(bag.write(), biped, configured("clock=received"))
    samples = list(dataset.measurements(frozenset({FootForceSample, StereoFrame})))
    assert [type(sample) for sample in samples] == [FootForceSample, StereoFrame] * 3
    np.testing.assert_array_equal([sample.force for sample in samples[::2]], [[1.0, 2.0]] * 3)
    assert samples[0].stamp_ns == START_NS + 2_000_000
    assert samples[1].stamp_ns == START_NS + 3_000_000


def test_a_header_without_a_stamp_is_an_error_that_names_the_settings(bag, biped):
    bag.add_joints(0, received_ns=START_NS)
    with pytest.raises(TimestampError, match=r"on /joint_states: its header has no stamp.*clock=received"):
        list(open_dataset(bag.write(), biped).measurements())


def test_clocks_that_are_apart_are_noted(mcap, biped):
    mcap.add_joints(START_NS)
    mcap.add_imu(5_000_000_000, received_ns=START_NS)
    notes = open_dataset(mcap.write(), biped).report().notes
    assert any("/imu" in note and "/joint_states" in note and "s apart" in note for note in notes)


def test_a_topic_on_another_clock_neither_delays_the_stream_nor_is_held(mcap, biped):
    for i in range(300):
        stamp_ns = START_NS + i * STEP_NS
        mcap.add_joints(stamp_ns)
        mcap.add_imu(stamp_ns + 3600 * 10**9, received_ns=stamp_ns)
    order = [type(sample) for sample in open_dataset(mcap.write(), biped).measurements()]
    assert order.count(ImuSample) == order.count(JointSample) == 300
    assert ImuSample in order[:350]


def test_an_imu_reading_that_is_nan_is_left_out(bag, biped):
    bag.add_joints(START_NS)
    bag.add_imu(START_NS)
    bag.add_imu(START_NS + STEP_NS, rate_x=np.nan)
    report = open_dataset(bag.write(), biped).report()
    assert report.stream("imu").samples == 1
    assert report.dropped == {"/imu: IMU reading empty or NaN": 1}


def test_only_the_requested_topics_are_opened(bag, biped, monkeypatch):
    for i in range(3):
        bag.add_joints(START_NS + i * STEP_NS)
        bag.add_imu(START_NS + i * STEP_NS)
        for side in ("left", "right"):
            bag.add_image(START_NS + i * STEP_NS, f"/{side}/image_raw", np.zeros((2, 3), dtype=np.uint8))
    dataset = open_dataset(bag.write(), biped)
    read: list[str] = []
    decode = BagFile.decoded

    def watched(self, topic, data):
        read.append(topic)
        return decode(self, topic, data)

    monkeypatch.setattr(BagFile, "decoded", watched)
    assert len(list(dataset.measurements(frozenset({ImuSample})))) == 3
    assert set(read) == {"/imu"}
    read.clear()
    assert dataset.report().stream("stereo").samples == 3
    assert "/left/image_raw" not in read
    assert len(samples_of(dataset, StereoFrame, frozenset({StereoFrame}))) == 3


@pytest.mark.parametrize("kind", KINDS)
def test_memory_does_not_grow_with_the_length_of_a_bag(tmp_path, biped, kind):
    peaks = []
    for count in (60, 240):
        bag = TinyBag(tmp_path / str(count) / kind)
        rng = np.random.default_rng(count)
        for i in range(count):
            bag.add_imu(START_NS + i * 100_000_000)
            for side in ("left", "right"):
                pixels = rng.integers(0, 256, (160, 200), dtype=np.uint8)
                bag.add_image(START_NS + i * 100_000_000, f"/{side}/image_raw", pixels)
        dataset = open_dataset(bag.write(), biped)
        del bag
        tracemalloc.start()
        frames = sum(isinstance(sample, StereoFrame) for sample in dataset.measurements(ALL_SENSORS - {JointSample}))
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
        assert frames == count
    assert peaks[1] < 1.3 * peaks[0]
    assert peaks[1] < 240 * 2 * 160 * 200 / 2  # less than half of the images


def test_messages_are_read_on_demand(tmp_path, biped, monkeypatch):
    bag = TinyBag(tmp_path / "walk.db3")
    for i in range(1000):
        bag.add_joints(START_NS + i * STEP_NS)
    dataset = open_dataset(bag.write(), biped)
    taken = []
    messages = BagFile.messages

    def watched(self, names):
        for message in messages(self, names):
            taken.append(message.topic)
            yield message

    monkeypatch.setattr(BagFile, "messages", watched)
    stream = dataset.measurements()
    next(stream)
    assert len(taken) < 150  # a second of messages, and not the ten there are
    stream.close()


def test_sorting_on_request_takes_stamps_that_go_back(mcap, biped):
    for i, k in enumerate((0, 2, 1, 3)):
        mcap.add_joints(START_NS + k * STEP_NS, received_ns=START_NS + i * STEP_NS)
    dataset = open_dataset(mcap.write(), biped, DatasetConfig(sort=True))
    assert [sample.stamp_ns for sample in dataset.measurements()] == [START_NS + k * STEP_NS for k in range(4)]


def test_the_robot_is_guessed_from_the_joints(bag):
    bag.add_joints(START_NS, names=load_robot("daisy").joint_names)
    assert guess_robot(bag.write()) == "daisy"


def test_without_a_robot_the_imu_is_read_alone(bag):
    bag.add_joints(START_NS)
    bag.add_imu(START_NS)
    dataset = open_dataset(bag.write(), None)
    assert [type(sample) for sample in dataset.measurements()] == [ImuSample]
    assert any("no robot was named" in note for note in dataset.report().notes)


def test_a_ros2_bag_without_definitions_is_read_by_those_of_the_distribution(tmp_path, biped):
    bag = TinyBag(tmp_path / "walk.db3")
    bag.add_joints(START_NS)
    path = bag.write()
    _forget_definitions(path)
    (sample,) = open_dataset(path, biped).measurements()
    np.testing.assert_array_equal(sample.position, ANGLES)


def _forget_definitions(path):
    with sqlite3.connect(path) as database:
        database.execute("DELETE FROM message_definitions")
    database.close()
