# SPDX-License-Identifier: BSD-3-Clause
"""Wires by name: what ``--source`` can be, opened as configured."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Literal, NamedTuple

from coclo_vio.datasets.rosbag.storage.type_definitions import TypeDefinitions
from coclo_vio.live import unitree
from coclo_vio.live.file_source import FileSource
from coclo_vio.live.optional_library import with_library
from coclo_vio.live.wire import Sink, Source
from coclo_vio.runs.live_config import LiveConfig, ZenohConfig
from coclo_vio.runs.run_config import RunConfig
from coclo_vio.values.config import merged
from coclo_vio.values.errors import ConfigError, DatasetError

if TYPE_CHECKING:
    from coclo_vio.live.dds_wire import DdsWire
    from coclo_vio.live.zenoh_wire import ZenohWire

SourceName = Literal["zenoh", "dds", "unitree", "file"]
SOURCES: tuple[SourceName, ...] = ("zenoh", "dds", "unitree", "file")


class OpenWire(NamedTuple):
    """A source, the sinks that go with it, and the message types of what is published."""

    source: Source
    sinks: tuple[Sink, ...]
    types: TypeDefinitions


def types_of(live: LiveConfig) -> TypeDefinitions:
    """The message types of a configuration, Unitree's among them.

    Raises:
        ConfigError: the file of a definition cannot be read.
        DatasetError: it cannot be parsed.
    """
    further: dict[str, str] = dict(unitree.DEFINITIONS)
    for msgtype, path in live.definitions.items():
        try:
            further[msgtype] = Path(path).read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError) as error:
            raise ConfigError(f"live.definitions: {path} cannot be read: {error}") from error
    return TypeDefinitions(live.distribution, further)


def configured_for(source: str, config: RunConfig) -> RunConfig:
    """The configuration with the fields of Unitree's messages where they are the source and none are configured.

    Raises:
        ConfigError: no such source, or Unitree's without a robot.
    """
    if source not in SOURCES:
        raise ConfigError(f"--source {source}: the sources are {', '.join(SOURCES)}")
    fields = config.dataset.rosbag.fields
    if source != "unitree" or fields != type(fields)():
        return config
    if config.robot is None:
        raise ConfigError("--source unitree needs the robot whose motors they are: name it with --robot")
    values: Mapping[str, object] = {"rosbag": {"fields": unitree.fields_of(config.robot)}}
    dataset = type(config.dataset).parse(merged(config.dataset.model_dump(), values), "unitree")
    return config.model_copy(update={"dataset": dataset})


def open_wire(source: str, endpoint: str | None, domain: int, config: RunConfig) -> OpenWire:
    """The wire of a name.

    Args:
        source: one of ``SOURCES``.
        endpoint: of zenoh, such as ``tcp/localhost:7447``; the path of a file.
        domain: of ROS 2.
        config: of the run.

    Raises:
        ConfigError: no such source, an extra is not installed, or a file is not named.
        DatasetError: it cannot be opened.
    """
    live = config.live
    types = types_of(live)
    wire: ZenohWire | DdsWire
    if source == "file":
        if endpoint is None:
            raise ConfigError("--source file needs the file that is being written: name it with --endpoint")
        return OpenWire(FileSource(Path(endpoint), config.robot, config.dataset), (), types)
    if source == "zenoh":
        zenoh = live.zenoh if endpoint is None else live.zenoh.model_copy(update={"connect": (endpoint,)})
        wire = zenoh_wire(types, zenoh, live.node_name, domain)
    elif source in ("dds", "unitree"):
        if endpoint is not None:
            raise DatasetError(
                f"--endpoint {endpoint}: DDS finds its partners itself; name the network interface in the environment "
                "variable CYCLONEDDS_URI, and the domain with --domain"
            )
        wire = dds_wire(types, domain)
    else:
        raise ConfigError(f"--source {source}: the sources are {', '.join(SOURCES)}")
    return OpenWire(wire, (wire,) if live.publishes else (), types)


def zenoh_wire(types: TypeDefinitions, config: ZenohConfig, node: str, domain: int) -> "ZenohWire":
    """A session of zenoh.

    Raises:
        ConfigError: zenoh is not installed.
        DatasetError: it cannot be opened.
    """
    module = with_library("coclo_vio.live.zenoh_wire", "zenoh", "live-zenoh")
    wire: ZenohWire = module.ZenohWire(types, config, node, domain)
    return wire


def dds_wire(types: TypeDefinitions, domain: int, *, keeps_all: bool = False) -> "DdsWire":
    """A participant of DDS.

    Raises:
        ConfigError: cyclonedds is not installed.
        DatasetError: the domain cannot be joined.
    """
    module = with_library("coclo_vio.live.dds_wire", "cyclonedds", "live-dds")
    wire: DdsWire = module.DdsWire(types, domain, keeps_all=keeps_all)
    return wire
