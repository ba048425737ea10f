# SPDX-License-Identifier: BSD-3-Clause
"""Damaged bags: an error of one sentence each, and what can be read if partial reading is allowed."""

import bz2
import shutil

import lz4.frame
import numpy as np
import pytest
from tiny_bags import JOINTS, KINDS, START_NS, STEP_NS, TinyBag

from coclo_vio.datasets.dataset import DatasetConfig, guess_robot, open_dataset
from coclo_vio.datasets.rosbag.storage.unpack import unpacked_prefix, zstd
from coclo_vio.robot.description import load_robot
from coclo_vio.values.config import parse_settings
from coclo_vio.values.errors import DatasetError, TimestampError, TopicNotFound
from coclo_vio.values.measurements import ALL_SENSORS, ImuSample, JointSample

PARTIAL = DatasetConfig(allow_partial=True)
WRITING = {
    "walk.bag": [{"chunk": 2000}, {"chunk": 2000, "compression": "LZ4"}, {"chunk": 2000, "compression": "BZ2"}, {}],
    "walk.mcap": [{}],
    "walk.db3": [{}],
}


@pytest.fixture(params=KINDS)
def bag(request, tmp_path):
    return TinyBag(tmp_path / request.param)


def fill(bag, count=300, **fields):
    rng = np.random.default_rng(8)
    for i in range(count):
        bag.add_joints(START_NS + i * STEP_NS, position=tuple(rng.normal(size=4)), **fields)
        bag.add_imu(START_NS + i * STEP_NS, rate_x=float(rng.normal()))


def cut(path, part):
    data = path.read_bytes()
    path.write_bytes(data[: int(part * len(data))])


def one_sentence(error):
    message = str(error.value)
    assert "\n" not in message
    assert len(message) < 600
    return message


@pytest.mark.long
@pytest.mark.parametrize(("kind", "options"), [(kind, options) for kind in WRITING for options in WRITING[kind]])
@pytest.mark.parametrize("part", [0.4, 0.7, 0.999])
def test_a_bag_that_was_cut_off_is_read_up_to_the_cut_if_allowed(tmp_path, biped, assert_same, kind, options, part):
    bag = TinyBag(tmp_path / kind)
    fill(bag)
    path = bag.write(**options)
    whole = list(open_dataset(path, biped).measurements())
    cut(path, part)
    with pytest.raises(DatasetError, match="--allow-partial") as error:
        open_dataset(path, biped)
    assert str(path) in one_sentence(error)
    dataset = open_dataset(path, biped, PARTIAL)
    found = list(dataset.measurements())
    assert (0.8 * part - 0.15) * len(whole) < len(found) <= len(whole)
    complete = sum(sample.stamp_ns < found[-1].stamp_ns for sample in found)
    assert len(found) - complete <= 2
    assert_same(found[:complete], whole[:complete])
    assert any("damaged or cut off" in note for note in dataset.report().notes)


def test_a_folder_whose_database_was_cut_off_is_read_up_to_the_cut(tmp_path, biped):
    bag = TinyBag(tmp_path / "walk")
    fill(bag)
    path = bag.write()
    cut(path / "walk.db3", 0.5)
    with pytest.raises(DatasetError, match="--allow-partial"):
        open_dataset(path, biped)
    assert 200 < len(list(open_dataset(path, biped, PARTIAL).measurements())) < 600


def test_a_folder_without_metadata_is_read_by_its_files(tmp_path, biped):
    bag = TinyBag(tmp_path / "walk")
    fill(bag, 10)
    path = bag.write()
    (path / "metadata.yaml").unlink()
    assert len(list(open_dataset(path, biped).measurements())) == 20


def test_damage_in_the_middle_is_noted_and_ends_the_reading(bag, biped):
    noise = np.random.default_rng(4).integers(0, 256, (150, 200), dtype=np.uint8)
    for i in range(100):
        bag.add_imu(START_NS + i * STEP_NS)
        bag.add_image(START_NS + i * STEP_NS, "/left/image", noise)
    path = bag.write()
    file = path / "walk.db3" if path.is_dir() else path
    data = bytearray(file.read_bytes())
    middle = len(data) * 6 // 10
    for start in range(middle, middle + 100_000, 100):
        data[start : start + 50] = b"\xff" * 50
    file.write_bytes(data)
    sensors = frozenset({ImuSample})
    with pytest.raises(DatasetError) as error:
        list(open_dataset(path, biped).measurements(sensors))
    one_sentence(error)
    dataset = open_dataset(path, biped, PARTIAL)
    assert 20 < len(list(dataset.measurements(sensors))) < 100
    assert any("damaged" in note or "breaks" in note for note in dataset.report().notes)


@pytest.mark.parametrize(
    ("compression", "compress"), [("bz2", bz2.compress), ("lz4", lz4.frame.compress), ("zstd", zstd.compress)]
)
def test_what_can_be_unpacked_of_a_chunk_is_a_prefix(compression, compress):
    data = np.random.default_rng(2).integers(0, 256, 3_000_000, dtype=np.uint8).tobytes()
    packed = compress(data)
    assert unpacked_prefix(compression, packed) == data
    cut_off = unpacked_prefix(compression, packed[: len(packed) // 2])
    assert len(cut_off) > 500_000
    assert data.startswith(cut_off)
    damaged = bytearray(packed)
    damaged[len(packed) // 2 :] = bytes(len(packed) - len(packed) // 2)
    assert len(unpacked_prefix(compression, bytes(damaged))) > 500_000
    assert unpacked_prefix("", data) == data


@pytest.mark.parametrize("kind", ["walk.bag", "walk.mcap", "walk.db3"])
@pytest.mark.parametrize("content", [b"", b"not a bag at all, but long enough for a header" * 40])
def test_a_file_that_is_not_a_bag_is_one_sentence_with_and_without_partial_reading(tmp_path, biped, kind, content):
    path = tmp_path / kind
    path.write_bytes(content)
    for config in (None, PARTIAL):
        with pytest.raises(DatasetError) as error:
            open_dataset(path, biped, config)
        assert str(path) in one_sentence(error)


def test_a_bag_without_joints_is_an_error_and_the_rest_is_read_if_allowed(bag, biped):
    bag.add_imu(START_NS)
    path = bag.write()
    with pytest.raises(TopicNotFound, match=r"no JointState among the topics /imu.*--allow-partial") as error:
        list(open_dataset(path, biped).measurements())
    assert str(path) in one_sentence(error)
    dataset = open_dataset(path, biped, PARTIAL)
    assert [type(sample) for sample in dataset.measurements()] == [ImuSample]
    assert any("no JointState" in note for note in dataset.report().notes)


def test_a_bag_without_joints_is_read_when_none_are_requested(bag, biped):
    bag.add_imu(START_NS)
    dataset = open_dataset(bag.write(), biped)
    assert len(list(dataset.measurements(frozenset({ImuSample})))) == 1
    assert dataset.report().stream("imu").samples == 1


def test_a_wrong_joint_name_is_listed_beside_the_names_in_the_bag(bag, biped):
    bag.add_joints(START_NS, names=(*JOINTS[:3], "right_knie"), position=(1.0, 2.0, 3.0, 4.0))
    path = bag.write()
    with pytest.raises(TopicNotFound, match=r"no joint is called right_knee_joint:.*right_knie.*joint_names") as error:
        open_dataset(path, biped)
    one_sentence(error)
    assert guess_robot(path) is None
    dataset = open_dataset(path, biped, PARTIAL)
    (sample,) = dataset.measurements()
    np.testing.assert_array_equal(sample.position, [1.0, 2.0, 3.0, np.nan])
    assert any("right_knee_joint" in note for note in dataset.report().notes)


def test_a_bag_of_another_robot_is_an_error_that_lists_its_joints(bag):
    bag.add_joints(START_NS)
    path = bag.write()
    with pytest.raises(TopicNotFound, match=r"left_hip_joint.*name another robot"):
        open_dataset(path, load_robot("go1"))


def test_swapped_stamps_are_an_error_and_are_left_out_if_allowed(bag, biped):
    for i, k in enumerate((0, 1, 3, 2, 4, 5)):
        bag.add_joints(START_NS + k * STEP_NS, received_ns=START_NS + i * STEP_NS)
        bag.add_imu(START_NS + i * STEP_NS)
    path = bag.write()
    message = (
        rf"message 4 on /joint_states: its stamp {START_NS + 2 * STEP_NS} ns goes back by 0\.01 s.*--allow-partial"
    )
    with pytest.raises(TimestampError, match=message) as error:
        list(open_dataset(path, biped).measurements())
    one_sentence(error)
    dataset = open_dataset(path, biped, PARTIAL)
    stamps = [sample.stamp_ns for sample in dataset.measurements() if isinstance(sample, JointSample)]
    assert [(stamp_ns - START_NS) // STEP_NS for stamp_ns in stamps] == [0, 1, 3, 4, 5]
    assert dataset.report().dropped == {"/joint_states: stamp goes back": 1}


def test_the_report_counts_swapped_stamps_instead_of_failing(bag, biped):
    for i, k in enumerate((0, 2, 1, 3)):
        bag.add_joints(START_NS + k * STEP_NS, received_ns=START_NS + i * STEP_NS)
    report = open_dataset(bag.write(), biped).report()
    assert report.dropped == {"/joint_states: stamp goes back": 1}
    assert report.stream("joints").samples == 3


def test_an_image_that_cannot_be_decoded_is_left_out_if_allowed(bag, biped):
    for i, size in enumerate((4, 3, 4)):
        for side in ("left", "right"):
            data = np.zeros(size, dtype=np.uint8)
            bag.add_image(START_NS + i * STEP_NS, f"/{side}/image", np.zeros((2, 2), dtype=np.uint8), data=data)
    path = bag.write()
    sensors = ALL_SENSORS - {JointSample}
    with pytest.raises(DatasetError, match="has 3 bytes for 2 x 2 pixels"):
        list(open_dataset(path, biped).measurements(sensors))
    dataset = open_dataset(path, biped, PARTIAL)
    assert len(list(dataset.measurements(sensors))) == 2
    assert dataset.report().dropped == {"/left/image: image pair cannot be decoded": 1}


def test_a_folder_with_several_bags_is_an_error_that_names_them(tmp_path, biped):
    bag = TinyBag(tmp_path / "one.bag")
    bag.add_joints(START_NS)
    bag.write()
    assert len(list(open_dataset(tmp_path, biped).measurements())) == 1
    shutil.copy(tmp_path / "one.bag", tmp_path / "two.bag")
    with pytest.raises(DatasetError, match=r"holds 2 bags \(one\.bag, two\.bag\); pass the path of one"):
        open_dataset(tmp_path, biped)


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ("topics.imu=/imo", r"no message on /imo.*as imu.*type are: /imu"),
        ("topics.imu=/joint_states", r"has /joint_states, but as sensor_msgs/msg/JointState"),
        ("topics.joints=[/legs]", r"no message on /legs.*as joints"),
        ("topics.foot_force={middle: /imu}", r"names the legs middle; the legs of biped are left, right"),
        ("joint_names={left_ankle: q}", r"joint_names names left_ankle, which biped does not have"),
        ("joint_signs={left_ankle: -1}", r"joint_signs names left_ankle"),
        ("foot_force_entries={middle: q}", r"names the legs middle"),
        ("foot_force_entries='effort[4:9]'", r"a range of 2 entries.*effort\[12:14\]"),
        ("foot_force_entries={left: 'torque[3]'}", r"'torque\[3\]' must be the name of an entry"),
    ],
)
def test_a_setting_that_does_not_fit_the_bag_is_an_error_that_lists_the_choices(tmp_path, biped, setting, message):
    bag = TinyBag(tmp_path / "walk.mcap")
    bag.add_joints(START_NS)
    bag.add_imu(START_NS)
    config = DatasetConfig.parse(parse_settings([f"rosbag.{setting}"]), "test")
    with pytest.raises(DatasetError, match=message):
        open_dataset(bag.write(), biped, config)
