# SPDX-License-Identifier: BSD-3-Clause
"""Files of bags that are sound but odd: metadata that does not fit, other profiles, chunks that expand, two types."""

import bz2
import re
import sqlite3
import struct
import tracemalloc

import lz4.frame
import numpy as np
import pytest
from tiny_bags import START_NS, STEP_NS, TinyBag

from coclo_vio.datasets.dataset import DatasetConfig, guess_robot, open_dataset
from coclo_vio.datasets.rosbag.storage.unpack import MOST_UNPACKED, unpacked, unpacked_prefix, zstd
from coclo_vio.experiments.fuzz.container_forms import expanding_bag, expanding_mcap, plain_bag, plain_mcap
from coclo_vio.values.errors import DatasetError
from coclo_vio.values.measurements import ImuSample

PARTIAL = DatasetConfig(allow_partial=True)
IMU = frozenset({ImuSample})


def fill(bag, count=30):
    for i in range(count):
        bag.add_imu(START_NS + i * STEP_NS)
    return bag.write()


def stamps_of(path, config=None):
    return [sample.stamp_ns for sample in open_dataset(path, None, config).measurements(IMU)]


@pytest.mark.parametrize(
    ("text", "note"),
    [
        ("", "is empty or not that of a bag"),
        ("rosbag2_bagfile_information: {", "is not YAML"),
        ("rosbag2_bagfile_information: 3", "is empty or not that of a bag"),
        (
            "rosbag2_bagfile_information: {message_count: 0, relative_file_paths: []}",
            "does not name walk.db3, which is read too",
        ),
        (
            "rosbag2_bagfile_information: {message_count: 7, relative_file_paths: [walk.db3]}",
            "counts 7 messages, .* 30",
        ),
        (
            "rosbag2_bagfile_information: {message_count: 30, relative_file_paths: [walk.db3, walk_1.db3]}",
            "names walk_1.db3, which is not there",
        ),
    ],
    ids=["empty", "cut off", "no mapping", "stale", "miscounted", "a file is missing"],
)
def test_a_folder_whose_metadata_does_not_fit_is_read_by_its_files(tmp_path, text, note):
    path = fill(TinyBag(tmp_path / "walk"))
    (path / "metadata.yaml").write_text(text, encoding="utf-8")
    dataset = open_dataset(path, None)
    assert len(list(dataset.measurements(IMU))) == 30
    notes = dataset.report().notes
    assert any(re.search(note, each) for each in notes), notes
    assert not any("damage" in each for each in notes)


def test_a_folder_of_metadata_alone_is_one_sentence(tmp_path):
    path = fill(TinyBag(tmp_path / "walk"))
    (path / "walk.db3").unlink()
    with pytest.raises(DatasetError, match=r"holds metadata\.yaml and no \.mcap or \.db3 file"):
        open_dataset(path, None)


@pytest.mark.parametrize("mode", ["file", "message"])
def test_files_and_messages_that_are_compressed_are_read(tmp_path, mode):
    path = fill(TinyBag(tmp_path / "walk"))
    if mode == "file":
        data = (path / "walk.db3").read_bytes()
        (path / "walk.db3").unlink()
        (path / "walk.db3.zstd").write_bytes(zstd.compress(data))
    else:
        with sqlite3.connect(path / "walk.db3") as database:
            rows = database.execute("SELECT id, data FROM messages").fetchall()
            database.executemany("UPDATE messages SET data = ? WHERE id = ?", [(zstd.compress(d), i) for i, d in rows])
    text = (path / "metadata.yaml").read_text()
    text = text.replace("compression_mode: ''", f"compression_mode: {mode.upper()}").replace(
        "compression_format: ''", "compression_format: zstd"
    )
    assert mode.upper() in text
    (path / "metadata.yaml").write_text(text.replace("walk.db3", "walk.db3.zstd") if mode == "file" else text)
    assert len(stamps_of(path)) == 30


def test_a_file_that_expands_without_end_is_refused(tmp_path):
    path = tmp_path / "walk"
    path.mkdir()
    (path / "walk_0.db3.zstd").write_bytes(zstd.compress(bytes(300_000_000)))
    with pytest.raises(DatasetError, match="expands to more than 200 times its size"):
        open_dataset(path, None)


@pytest.mark.parametrize("config", [None, PARTIAL], ids=["whole", "partial"])
@pytest.mark.parametrize("kind", ["mcap", "bag"])
def test_a_chunk_that_expands_to_gigabytes_is_refused_in_bounded_memory(tmp_path, kind, config):
    path = tmp_path / f"bomb.{kind}"
    if kind == "mcap":
        path.write_bytes(expanding_mcap(fill(TinyBag(tmp_path / "walk.mcap")).read_bytes()))
        assert path.stat().st_size < 60_000
    else:
        path.write_bytes(expanding_bag("bz2"))
    tracemalloc.start()
    try:
        with pytest.raises(DatasetError) as error:
            open_dataset(path, None, config)
        assert tracemalloc.get_traced_memory()[1] < 3 * MOST_UNPACKED
    finally:
        tracemalloc.stop()
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("compression", ["zstd", "bz2", "lz4"])
def test_chunks_are_unpacked_to_their_recorded_size_and_no_further(compression):
    compress = {"zstd": zstd.compress, "bz2": bz2.compress, "lz4": lz4.frame.compress}[compression]
    data = np.random.default_rng(3).integers(0, 4, 200_000, dtype=np.uint8).tobytes()
    assert unpacked(compression, compress(data), len(data)) == data
    assert unpacked(compression, compress(data), None) == data
    for size in (len(data) - 1, len(data) + 1):
        with pytest.raises(ValueError, match="does not unpack to its recorded size"):
            unpacked(compression, compress(data), size)
    with pytest.raises(ValueError, match="larger than the 128 MB"):
        unpacked(compression, compress(data), 2**40)
    assert len(unpacked_prefix(compression, compress(bytes(40 * 2**20)))) <= 41 * 2**20
    with pytest.raises(ValueError, match=r"expands to 100 MB, more than 200 times|does not unpack"):
        unpacked(compression, compress(data)[:1000], 100 * 2**20)


def test_a_length_of_gigabytes_in_a_damaged_bag_reserves_no_memory(tmp_path):
    path = fill(TinyBag(tmp_path / "walk.bag"))
    data = bytearray(path.read_bytes())
    data[13:17] = struct.pack("<I", 2**32 - 1)  # the length of the first record's header
    path.write_bytes(data)
    tracemalloc.start()
    try:
        for config in (None, PARTIAL):
            with pytest.raises(DatasetError):
                stamps_of(path, config)
        assert tracemalloc.get_traced_memory()[1] < 50_000_000
    finally:
        tracemalloc.stop()


def test_mcap_of_recorders_that_do_not_name_ros2_is_read(tmp_path):
    path = fill(TinyBag(tmp_path / "walk.mcap"))
    data = plain_mcap(path.read_bytes())
    start = data.index(b"ros2")
    path.write_bytes(data[: start - 4] + struct.pack("<I", 4) + b"none" + data[start + 4 :])
    assert len(stamps_of(path)) == 30


def test_a_topic_of_two_types_is_read_as_the_first_and_noted(tmp_path):
    bag = TinyBag(tmp_path / "walk.bag")
    for i in range(5):
        bag.add_imu(START_NS + i * STEP_NS)
    path = bag.write()
    data = plain_bag(path.read_bytes())
    other = TinyBag(tmp_path / "other.bag")
    other.add("/tmu", "geometry_msgs/msg/PoseStamped", START_NS)
    for i in range(5):
        other.add_imu(START_NS + i * STEP_NS)
    data = plain_bag(other.write().read_bytes()).replace(b"/tmu", b"/imu")
    path.write_bytes(data)
    dataset = open_dataset(path, None)
    assert any("/imu has messages of two types" in note for note in (*dataset._bag.notes,))


@pytest.mark.parametrize("name", ["x" * 300 + ".bag", "x/" * 3000, "a\0b.bag"])
def test_a_path_that_no_file_can_have_is_one_sentence(tmp_path, name):
    for read in (lambda path: open_dataset(path, None), guess_robot):
        with pytest.raises(DatasetError) as error:
            read(tmp_path / name)
        assert len(str(error.value)) < 700


def test_a_topic_without_a_name_is_left_out(tmp_path):
    bag = TinyBag(tmp_path / "walk.db3")
    bag.add_joints(START_NS)
    path = fill(bag)
    with sqlite3.connect(path) as database:
        database.execute("CREATE TABLE other AS SELECT * FROM topics")
        database.execute("DROP TABLE topics")
        database.execute("ALTER TABLE other RENAME TO topics")
        database.execute("UPDATE topics SET name = NULL WHERE name = '/joint_states'")
    assert len(stamps_of(path)) == 30
