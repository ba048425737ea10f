# SPDX-License-Identifier: BSD-3-Clause
"""Real serialised messages between two processes on this computer: every one accounted for."""

import os
import signal
import subprocess
import sys
import time
from collections import Counter
from contextlib import contextmanager

import numpy as np
import pytest
from live_processes import children_of, environment, free_port, is_alive, run_beside

from coclo_vio.datasets.rosbag.storage.bag_file import BagFile
from coclo_vio.live.live_record import read_live_record
from coclo_vio.live.open_wire import types_of
from coclo_vio.live.recorded_messages import recorded_messages, restamped
from coclo_vio.runs.live_config import LiveConfig, ZenohConfig
from coclo_vio.runs.run_folder import read_estimates, read_record

_AT_ONCE = ["--set", "live.first_messages_s=0.3"]
_ENDED = ["--set", "live.idle_s=1", *_AT_ONCE]
_PLAYED = ["--seconds", "4", "--rate", "2", "--wait", "40"]


@pytest.fixture
def dds_domain(monkeypatch):
    """A domain on the loopback that hardly anybody uses."""
    pytest.importorskip("cyclonedds", reason="cyclonedds is an extra (live-dds)")
    monkeypatch.setenv("CYCLONEDDS_URI", environment()["CYCLONEDDS_URI"])
    return free_port() % 100 + 100


def _check(sent, record, topics):
    for topic in topics:
        came = record.topics[topic]
        assert came.received + came.lost + came.earlier == sent[topic] > 0, topic
        assert came.received > 0.9 * sent[topic]
        assert came.refused == {}
        assert came.latency.count == came.received
        assert came.latency.negative == 0
        assert came.latency.p50_ms < 100.0


@pytest.mark.long
def test_zenoh_accounts_for_every_message_and_gets_estimates_back(short_recording, tmp_path):
    pytest.importorskip("zenoh", reason="zenoh is an extra (live-zenoh)")
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    publisher = [str(short_recording), "--listen", endpoint, *_PLAYED]
    sent, record = run_beside(publisher, "zenoh", tmp_path / "out", endpoint=endpoint)
    _check(sent, record, ("/joint_states", "/imu", "/camera/imu"))
    estimates = len(read_estimates(tmp_path / "out", "coclo").trajectory)
    assert estimates > 300
    assert record.published["/coclo/odometry"] == record.published["/tf"] == estimates
    assert record.estimates["coclo"].count == estimates
    assert 0.0 < record.estimates["coclo"].p50_ms < 10_000.0  # how long depends on who else uses the machine
    bag = BagFile(tmp_path / "out" / "recording" / "recording.mcap", allow_partial=False)
    counts = Counter(message.topic for message in bag.messages(bag.topics.keys()))
    assert counts["/coclo/odometry"] == estimates
    assert counts["/joint_states"] == record.topics["/joint_states"].received


@pytest.mark.slow
def test_images_are_processed_beside_the_filter_and_come_back_as_a_trajectory(short_recording, tmp_path):
    pytest.importorskip("zenoh", reason="zenoh is an extra (live-zenoh)")
    endpoint, folder = f"tcp/127.0.0.1:{free_port()}", tmp_path / "out"
    arguments = ["-s", "zenoh", "--endpoint", endpoint, "-m", "combined", "-r", "daisy", "-o", str(folder), *_AT_ONCE]
    with _live(arguments) as process, _played(short_recording, "--listen", endpoint, "--rate", "0.4"):
        _wait_for(lambda: _rows(folder / "combined_vins_keyframes.csv") > 3)
        vision = children_of(process.pid)
        os.kill(process.pid, signal.SIGTERM)
        said, _ = process.communicate(timeout=60)
    assert process.returncode == 143, said
    assert vision
    assert not any(is_alive(pid) for pid in vision)
    assert "vision: beside" in (folder / "config.yaml").read_text(encoding="utf-8")
    run = read_record(folder)
    counts = run.estimators["combined_coclo"].counts
    assert counts["frames"] > 5, counts
    assert counts["smoother_keyframes"] >= 3
    assert counts["feedback_accepted"] >= 1
    published = read_live_record(folder).published
    for name in ("combined_coclo", "combined_vins"):
        assert published[f"/{name}/odometry"] == run.estimators[name].estimates > 3
    assert read_live_record(folder).estimates["combined_coclo"].p95_ms < 1500.0


@pytest.mark.long
def test_dds_accounts_for_every_message(short_recording, tmp_path, dds_domain):
    publisher = [str(short_recording), "--wire", "dds", "--domain", str(dds_domain), *_PLAYED]
    sent, record = run_beside(publisher, "dds", tmp_path / "out", domain=dds_domain)
    _check(sent, record, ("/joint_states", "/imu", "/camera/imu"))
    assert len(read_estimates(tmp_path / "out", "coclo").trajectory) > 300


@pytest.mark.slow
def test_low_states_of_unitree_are_read_as_joints_and_imu(short_recording, tmp_path, dds_domain):
    publisher = [str(short_recording), "--wire", "unitree", "--robot", "daisy", "--domain", str(dds_domain), *_PLAYED]
    sent, record = run_beside(publisher, "unitree", tmp_path / "out", domain=dds_domain)
    _check(sent, record, ("/lowstate",))
    assert record.roles["joints"] == ("/lowstate as joints",)
    assert len(read_estimates(tmp_path / "out", "coclo").trajectory) > 200, "its time is that of sending, twice as fast"


@contextmanager
def _started(module, *arguments):
    process = subprocess.Popen(
        [sys.executable, "-m", module, *map(str, arguments)],
        env=environment(),
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    try:
        yield process
    finally:
        process.kill()


def _live(arguments):
    return _started("coclo_vio", "live", *arguments)


def _played(recording, *arguments):
    return _started("coclo_vio.live.publish_recording", recording, "--wait", 40, *arguments)


@pytest.mark.long
def test_a_fuzzed_message_on_the_wire_ends_nothing(short_recording, tmp_path):
    pytest.importorskip("zenoh", reason="zenoh is an extra (live-zenoh)")
    from coclo_vio.live.zenoh_wire import ZenohWire  # noqa: PLC0415 -- an extra

    endpoint, folder = f"tcp/127.0.0.1:{free_port()}", tmp_path / "out"
    types = types_of(LiveConfig())
    arguments = ["-s", "zenoh", "--endpoint", endpoint, "-m", "coclo", "-r", "daisy", "-o", str(folder), *_ENDED]
    wire = ZenohWire(types, ZenohConfig(connect=(), listen=(endpoint,)), "fuzzer")
    with _live(arguments) as process, recorded_messages(short_recording, None, types) as messages:
        random = np.random.default_rng(21)
        for topic, kind in (("/joint_states", "JointState"), ("/imu", "Imu"), ("/camera/imu", "Imu")):
            wire.announce(topic, f"sensor_msgs/msg/{kind}")
        end = time.monotonic() + 60.0
        while not wire.has_listeners("/joint_states") and time.monotonic() < end:
            time.sleep(0.05)
        begun, first, fuzzed = time.time_ns(), None, 0
        for message in messages:
            first = message.at_ns if first is None else first
            if message.topic not in ("/joint_states", "/imu", "/camera/imu"):
                continue
            data = restamped(message, types, begun - first)
            wire.publish(message.topic, message.msgtype, 0, data)
            if (message.at_ns - first) > 2 * 10**9 and random.random() < 0.2:
                wire.publish(message.topic, message.msgtype, 0, _mutated(data, random))
                fuzzed += 1
            if (message.at_ns - first) > 4 * 10**9:
                break
            time.sleep(0.0005)
        wire._session.put("0/joint_states/sensor_msgs::msg::dds_::JointState_/RIHS01_00", b"of another definition")
        said, _ = process.communicate(timeout=120)
    wire.close()
    assert process.returncode == 0, said
    record = read_live_record(folder)
    run = read_record(folder).estimators["coclo"]
    assert run.failure is None
    assert fuzzed > 50
    refused = sum(sum(topic.refused.values()) for topic in record.topics.values())
    assert refused > fuzzed / 5
    kinds = {event.kind for event in run.events}
    assert "wire_message_refused" in kinds
    reasons = [event.detail for event in run.events if event.kind == "wire_message_refused"]
    assert any("/joint_states" in reason for reason in reasons)
    assert len(reasons) < refused / 2  # one a second of each reason, with their number
    assert any("another definition" in reason for reason in reasons)


def _mutated(data, random):
    """Bytes that are cut, flipped or replaced, but for the stamp in the first half of the cases."""
    kind = random.integers(4)
    mutable = bytearray(data)
    if kind == 0:
        return bytes(mutable[: random.integers(0, len(mutable))])
    if kind == 1:
        return random.bytes(int(random.integers(1, 300)))
    start = 12 if kind == 2 else 0
    for at in random.integers(start, len(mutable), 6):
        mutable[at] = random.integers(256)
    return bytes(mutable)


@pytest.mark.long
def test_an_interrupt_finishes_the_files(short_recording, tmp_path):
    growing, folder = tmp_path / "growing.mcap", tmp_path / "out"
    data = short_recording.read_bytes()
    growing.write_bytes(data[: len(data) * 3 // 4])
    arguments = ["-s", "file", "--endpoint", str(growing), "-m", "coclo", "-r", "daisy", "-o", str(folder), *_AT_ONCE]
    with _live(arguments) as process:
        _wait_for(lambda: _rows(folder / "coclo.tum"))
        os.kill(process.pid, signal.SIGINT)
        said, _ = process.communicate(timeout=60)
    assert process.returncode == 130, said
    estimates = read_estimates(folder, "coclo")
    record = read_record(folder)
    assert record.estimators["coclo"].estimates == len(estimates.trajectory) > 0
    assert record.status == record.estimators["coclo"].status == "interrupted"
    assert "run folder" in said


def _rows(path):
    return path.read_bytes().count(b"\n") if path.exists() else 0


def _wait_for(condition, within_s=90.0):
    end_s = time.monotonic() + within_s
    while not condition() and time.monotonic() < end_s:
        time.sleep(0.05)
    assert condition()
