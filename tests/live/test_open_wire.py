# SPDX-License-Identifier: BSD-3-Clause
"""What the command line names: sources, extras that are not installed, definitions, Unitree's fields."""

import importlib
import sys

import pytest

from coclo_vio.live.open_wire import configured_for, open_wire, types_of
from coclo_vio.runs.live_config import LiveConfig
from coclo_vio.runs.run_config import resolve
from coclo_vio.values.errors import ConfigError, DatasetError


@pytest.mark.parametrize(
    ("source", "library", "extra"), [("zenoh", "zenoh", "live-zenoh"), ("dds", "cyclonedds", "live-dds")]
)
def test_a_library_that_is_not_installed_is_named_with_its_extra(source, library, extra, monkeypatch):
    for name in [name for name in sys.modules if name.partition(".")[0] == library or f"{source}_" in name]:
        monkeypatch.delitem(sys.modules, name)
    known = importlib.import_module

    def absent(name, *rest):
        if name == f"coclo_vio.live.{source}_wire":
            raise ModuleNotFoundError(f"No module named {library!r}", name=library)
        return known(name, *rest)

    monkeypatch.setattr(importlib, "import_module", absent)
    with pytest.raises(ConfigError, match=rf"needs {library}.*pip install 'coclo-vio\[{extra}\]'"):
        open_wire(source, None, 0, resolve("go1"))


def test_a_source_that_does_not_exist_lists_those_that_do():
    with pytest.raises(ConfigError, match="zenoh, dds, unitree, file"):
        configured_for("mqtt", resolve("go1"))


def test_a_file_has_to_be_named():
    with pytest.raises(ConfigError, match="name it with --endpoint"):
        open_wire("file", None, 0, resolve("go1"))


def test_dds_has_no_endpoint():
    with pytest.raises(DatasetError, match="CYCLONEDDS_URI"):
        open_wire("dds", "tcp/localhost:1", 0, resolve("go1"))


def test_unitree_needs_a_robot_and_keeps_fields_that_are_configured():
    with pytest.raises(ConfigError, match="name it with --robot"):
        configured_for("unitree", resolve())
    found = configured_for("unitree", resolve("go1")).dataset.rosbag.fields
    assert (found.imu.topic, found.joints.position) == ("/lowstate", "motor_state[0:12].q")
    own = resolve("go1", settings=["dataset.rosbag.fields={imu: {topic: /s, gyroscope: g, accelerometer: a}}"])
    assert configured_for("unitree", own).dataset.rosbag.fields.imu.topic == "/s"


def test_definitions_of_one_s_own_are_known(tmp_path):
    path = tmp_path / "State.msg"
    path.write_text("std_msgs/Header header\nfloat32[3] gyro\n", encoding="utf-8")
    types = types_of(LiveConfig(definitions={"my_msgs/msg/State": str(path)}))
    assert types.hash_of("my_msgs/msg/State").startswith("RIHS01_")
    assert types.has_header("my_msgs/msg/State")
    assert not types.has_header("tf2_msgs/msg/TFMessage")
    path.write_text("this is no definition {", encoding="utf-8")
    with pytest.raises(DatasetError, match="my_msgs/msg/State cannot be read"):
        types_of(LiveConfig(definitions={"my_msgs/msg/State": str(path)}))
