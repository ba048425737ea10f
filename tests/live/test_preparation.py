# SPDX-License-Identifier: BSD-3-Clause
"""Messages as they come on a wire give the measurements, calibrations and topics that the bag of them gives."""

import numpy as np
import pytest
from played_source import came, run_played

import coclo_vio as cv
from coclo_vio.datasets.rosbag.storage.arrived_messages import ArrivedMessages
from coclo_vio.datasets.rosbag.storage.message_set import RawMessage
from coclo_vio.datasets.sequencer import order_key
from coclo_vio.live.estimate_latency import EstimateLatency
from coclo_vio.live.intake import Intake
from coclo_vio.live.measurement_stream import MeasurementStream
from coclo_vio.live.open_wire import types_of
from coclo_vio.live.preparation import given_calibrations, prepared_of_messages, wants_of
from coclo_vio.live.recorded_messages import low_states, recorded_messages
from coclo_vio.live.wire import WireMessage
from coclo_vio.live.wire_events import WireEvents
from coclo_vio.runs.live_config import LiveConfig
from coclo_vio.runs.modes.registry import mode_of
from coclo_vio.runs.run_config import resolve
from coclo_vio.runs.run_folder import read_estimates
from coclo_vio.values.calibration import SensorCalibrations
from coclo_vio.values.errors import ConfigError, DatasetError

_TYPES = types_of(LiveConfig())


@pytest.fixture(scope="module")
def messages(short_recording):
    with recorded_messages(short_recording, None, _TYPES) as found:
        return [m for m in found if m.at_ns]


def _arrived(messages, leaves_out=()):
    arrived = ArrivedMessages("the wire", lambda topic, msgtype: _TYPES.typed(msgtype))
    for message in messages:
        if message.topic not in leaves_out:
            arrived.add(RawMessage(message.topic, message.at_ns, message.data), message.msgtype)
    return arrived


def _stream(prepared, config):
    events = WireEvents(0.0)
    intake = Intake(wants_of(config, mode_of("combined")), events, most_messages=10**6, most_images=10**6)
    return MeasurementStream(prepared, config, intake, EstimateLatency()), intake


def test_a_wire_gives_the_measurements_of_the_bag(messages, short_recording):
    config = resolve("daisy")
    prepared = prepared_of_messages(_arrived(messages), mode_of("combined"), config, SensorCalibrations())
    stream, intake = _stream(prepared, config)
    came = [WireMessage(m.topic, m.msgtype, m.data, m.at_ns) for m in messages]
    found = list(stream.measurements(came))
    recording = cv.open(short_recording, robot="daisy")
    expected = list(recording.measurements(prepared.sensors))
    found.sort(key=order_key)  # as the guard does
    assert [(type(one), one.stamp_ns) for one in found] == [(type(one), one.stamp_ns) for one in expected]
    for kind, field in ((cv.JointSample, "position"), (cv.ImuSample, "specific_force"), (cv.StereoFrame, "left")):
        of_wire, of_bag = ([getattr(one, field) for one in some if isinstance(one, kind)] for some in (found, expected))
        np.testing.assert_array_equal(of_wire, of_bag)
    assert all(not record.refused for record in intake.records().values())


def test_calibrations_are_those_of_the_bag_and_a_given_one_goes_before(messages, short_recording):
    config = resolve("daisy")
    recording = cv.open(short_recording, robot="daisy")
    known = recording.calibration
    prepared = prepared_of_messages(_arrived(messages), mode_of("combined"), config, SensorCalibrations())
    assert prepared.config.robot.imu == known.imu
    without = _arrived(messages, leaves_out=("/tf_static", "/camera/infra1/camera_info"))
    with pytest.raises(DatasetError, match="calibration"):
        prepared_of_messages(without, mode_of("combined"), config, SensorCalibrations())
    given, _ = given_calibrations(short_recording, config)
    assert given.stereo == known.stereo
    assert prepared_of_messages(without, mode_of("combined"), config, given).leg_names


def test_what_a_mode_needs_and_does_not_find_is_named(messages):
    with pytest.raises(ConfigError, match="--robot"):
        prepared_of_messages(_arrived(messages), mode_of("coclo"), resolve(), SensorCalibrations())
    without = _arrived(messages, leaves_out=("/imu", "/camera/imu"))
    with pytest.raises(DatasetError, match=r"no topic has the body's IMU.*dataset\.rosbag\.topics\.imu"):
        prepared_of_messages(without, mode_of("coclo"), resolve("daisy"), SensorCalibrations())
    blind = _arrived(messages, leaves_out=[m.topic for m in messages if "image" in m.topic])
    with pytest.raises(DatasetError, match="no two topics are a left and a right image"):
        prepared_of_messages(blind, mode_of("combined"), resolve("daisy"), SensorCalibrations())


def test_only_what_a_mode_can_read_is_wanted():
    wants = wants_of(resolve("daisy"), mode_of("coclo"))
    assert wants("/imu", "sensor_msgs/msg/Imu")
    assert wants("/tf_static", "tf2_msgs/msg/TFMessage")
    assert not wants("/left", "sensor_msgs/msg/Image")
    assert not wants("/points", "sensor_msgs/msg/PointCloud2")
    assert wants_of(resolve("daisy"), mode_of("combined"))("/left", "sensor_msgs/msg/CompressedImage")
    named = resolve("daisy", settings=["dataset.rosbag.fields={imu: {topic: /s, gyroscope: g, accelerometer: a}}"])
    assert wants_of(named, mode_of("coclo"))("/s", "my_msgs/msg/State")


def test_held_messages_are_bounded(messages):
    arrived = ArrivedMessages("the wire", lambda topic, msgtype: _TYPES.typed(msgtype), most=50, most_bytes=300_000)
    for message in messages:
        arrived.add(RawMessage(message.topic, message.at_ns, message.data), message.msgtype)
    held = arrived.released()
    by_topic = {name: [m for m in held if m.topic == name] for name in arrived.topics}
    assert max(map(len, by_topic.values())) == 50
    assert sum(len(m.data) for m in by_topic["/camera/infra1/image_rect_raw/compressed"]) <= 300_000
    assert [m.received_ns for m in held] == sorted(m.received_ns for m in held)
    assert arrived.released() == []


@pytest.mark.long
def test_a_run_on_low_states_of_unitree_is_that_on_the_samples_in_them(short_recording, tmp_path):
    found = [came(message, message.at_ns) for message in low_states(short_recording, "daisy", _TYPES)]
    record, counted = run_played(found, tmp_path, source="unitree")
    assert counted.roles["joints"] == ("/lowstate as joints",)
    assert counted.topics["/lowstate"].received == len(found) == 600
    assert record.estimators["coclo"].measurements == 2 * 600, "joints and IMU"
    estimates = read_estimates(tmp_path, "coclo").trajectory
    truth = cv.open(short_recording, robot="daisy").ground_truth().trajectory
    walked = np.linalg.norm(truth.positions[-1, :2] - truth.positions[0, :2])
    assert np.linalg.norm(estimates.positions[-1, :2] - estimates.positions[0, :2]) == pytest.approx(walked, rel=0.1)
