# SPDX-License-Identifier: BSD-3-Clause
"""Files that grow while they are read, appended to at random places."""

import json
import time

import numpy as np
import pytest

from coclo_vio.datasets.config import DatasetConfig
from coclo_vio.datasets.dataset import open_dataset
from coclo_vio.datasets.rosbag.storage.growing_mcap import GrowingMcap
from coclo_vio.live.file_source import FileSource
from coclo_vio.live.wire import Receiver, WireMessage
from coclo_vio.robot.description import load_robot
from coclo_vio.values.errors import ConfigError
from coclo_vio.values.measurements import JointSample


class _Collector:
    def __init__(self):
        self.items, self.refused = [], []
        self.receiver = Receiver(
            lambda topic, msgtype: True, self.items.append, lambda *what: self.refused.append(what), lambda *what: None
        )


def _wait_for(condition):
    end = time.monotonic() + 20.0
    while not condition() and time.monotonic() < end:
        time.sleep(0.01)
    assert condition()


def _grown(source, path, data, pieces=13):
    """What a source gives of a file that is written piece by piece."""
    collector = _Collector()
    source.start(collector.receiver)
    cuts = np.sort(np.random.default_rng(8).integers(0, len(data), pieces)).tolist()
    with path.open("wb", buffering=0) as file:
        for start, end in zip([0, *cuts], [*cuts, len(data)], strict=True):
            file.write(data[start:end])
            time.sleep(0.01)
    return collector


def test_a_growing_log_gives_the_samples_of_the_finished_one(leg_log, tmp_path):
    robot = load_robot("daisy")
    log = next(leg_log.glob("*.csv"))
    expected = [s for s in open_dataset(log, robot).measurements() if isinstance(s, JointSample)]
    path = tmp_path / "log.csv"
    source = FileSource(path, robot, DatasetConfig())
    collector = _grown(source, path, log.read_bytes())
    joints = lambda: [s for s in collector.items if isinstance(s, JointSample)]  # noqa: E731
    _wait_for(lambda: len(joints()) >= len(expected))
    source.close()
    assert [s.stamp_ns for s in joints()] == [s.stamp_ns for s in expected]
    np.testing.assert_array_equal(joints()[-1].position, expected[-1].position)
    assert collector.refused == []


def test_a_log_of_json_lines_is_read_and_malformed_lines_are_reported(tmp_path):
    robot = load_robot("daisy")
    names = [f"{joint}.position" for joint in robot.joint_names]
    rows = [{"stamp_ns": 10**18 + i * 10**7} | dict.fromkeys(names, 0.1 * i) for i in range(20)]
    lines = [json.dumps(row) for row in rows]
    lines[5:5] = ["not json", json.dumps([1, 2]), json.dumps({"stamp_ns": "soon"})]
    path = tmp_path / "log.jsonl"
    source = FileSource(path, robot, DatasetConfig())
    collector = _grown(source, path, ("\n".join(lines) + "\n").encode())
    joints = lambda: [s for s in collector.items if isinstance(s, JointSample)]  # noqa: E731
    _wait_for(lambda: len(joints()) == 20)
    source.close()
    assert [s.stamp_ns for s in joints()] == [row["stamp_ns"] for row in rows]
    assert len(collector.refused) == 3


def test_a_growing_mcap_gives_every_message_and_says_when_it_is_complete(short_recording, tmp_path):
    path = tmp_path / "walk.mcap"
    source = FileSource(path, None, DatasetConfig())
    collector = _grown(source, path, short_recording.read_bytes())
    _wait_for(lambda: source.is_over)
    source.close()
    topics = [m.topic for m in collector.items if isinstance(m, WireMessage)]
    assert topics.count("/joint_states") == 600
    assert topics.count("/imu") == 600
    msgtype, store = source.typed("/imu", "sensor_msgs/msg/Imu")
    imu = next(m for m in collector.items if m.topic == "/imu")
    assert store.deserialize_cdr(imu.data, msgtype).header.frame_id
    assert collector.refused == []


def test_damage_in_a_growing_mcap_is_reported_and_ends_nothing(short_recording, tmp_path):
    data = bytearray(short_recording.read_bytes())
    random = np.random.default_rng(11)
    for at in random.integers(100, len(data) - 100, 4000):
        data[at] ^= 0xFF
    path = tmp_path / "walk.mcap"
    path.write_bytes(bytes(data))
    mcap = GrowingMcap(path)
    messages = list(mcap.messages())
    assert mcap.refused
    assert all(message.topic for message in messages)


def test_a_file_of_another_kind_is_refused(tmp_path):
    with pytest.raises(ConfigError, match=r"takes a file that ends in \.mcap, \.csv or \.jsonl"):
        FileSource(tmp_path / "walk.bag", None, DatasetConfig())
