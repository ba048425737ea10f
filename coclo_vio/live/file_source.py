# SPDX-License-Identifier: BSD-3-Clause
"""A file that is being written as a source: an MCAP file, or a leg log as CSV or as a JSON object a line."""

import time
from pathlib import Path
from threading import Event, Thread
from typing import TYPE_CHECKING

from coclo_vio.datasets.config import DatasetConfig
from coclo_vio.datasets.growing_table import GrowingTable
from coclo_vio.datasets.joint_velocity import fill_velocities
from coclo_vio.datasets.leg_log import sample_table
from coclo_vio.datasets.read_report import ReadTally
from coclo_vio.datasets.rosbag.storage.growing_mcap import GrowingMcap
from coclo_vio.live.wire import Receiver, WireMessage
from coclo_vio.robot.description import RobotDescription
from coclo_vio.values.errors import CocloError, ConfigError, DatasetError, shortened

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

_LOOK_AGAIN_S = 0.02
_TABLES = (".csv", ".jsonl", ".ndjson")


class FileSource:
    """Follows a file from its beginning, in a thread.

    Attributes:
        name: of the file.
        is_over: whether an MCAP file has been closed by its writer and read to its end.
    """

    def __init__(self, path: Path, robot: RobotDescription | None, config: DatasetConfig) -> None:
        """Set what to read.

        Args:
            path: the file; it need not exist yet.
            robot: its joints and legs are read of a log.
            config: names of the columns.

        Raises:
            ConfigError: the suffix is not that of a file that can be followed.
        """
        if path.suffix.lower() not in (*_TABLES, ".mcap"):
            raise ConfigError(
                f"{path} ends in {path.suffix or 'nothing'}, which cannot be followed while it is written; --endpoint "
                "takes a file that ends in .mcap, .csv or .jsonl"
            )
        self.name, self.is_over = f"file {path}", False
        self._path, self._robot, self._config = path, robot, config
        self._mcap: GrowingMcap | None = None
        self._is_closed = Event()
        self._thread: Thread | None = None

    def start(self, receiver: Receiver) -> None:
        """Begin to read.

        Raises:
            DatasetError: never here; what cannot be read is refused.
        """
        is_table = self._path.suffix.lower() in _TABLES
        follow = self._follow_table if is_table else self._follow_mcap
        self._thread = Thread(target=self._guarded, args=(follow, receiver), name="coclo-vio file", daemon=True)
        self._thread.start()

    def poll(self) -> None:
        """Nothing has to be done."""

    def typed(self, topic: str, msgtype: str) -> "tuple[str, Typestore]":
        """The type of a topic and the definitions that the file has of it.

        Raises:
            DatasetError: no message has been read.
        """
        if self._mcap is None:
            raise DatasetError(f"{self.name} holds no messages")
        return self._mcap.typed(topic)

    def close(self) -> None:
        """End the reading."""
        self._is_closed.set()
        if self._thread is not None:
            self._thread.join()

    def _guarded(self, follow: "object", receiver: Receiver) -> None:
        try:
            while not self._path.exists():
                if not self._wait():
                    return
            follow(receiver)  # type: ignore[operator]
        except CocloError as error:
            receiver.refuse(self._path.name, shortened(error))
        finally:
            self.is_over = True

    def _wait(self) -> bool:
        return not self._is_closed.wait(_LOOK_AGAIN_S)

    def _follow_table(self, receiver: Receiver) -> None:
        table = GrowingTable(self._path, self._wait, lambda reason: receiver.refuse(self._path.name, reason))
        tally = ReadTally("leg log", self._config.gap_s)
        samples = sample_table(table, self._robot, self._config, tally)
        stream = samples.measurements(tally)
        if samples.joints is not None and not samples.joints.velocity.is_present.all():
            stream = fill_velocities(stream, ~samples.joints.velocity.is_present, self._config.joint_velocity)
        for measurement in stream:
            receiver.take(measurement)

    def _follow_mcap(self, receiver: Receiver) -> None:
        self._mcap = GrowingMcap(self._path)
        while True:
            for message in self._mcap.messages():
                if receiver.wants(message.topic, message.msgtype):
                    receiver.take(
                        WireMessage(
                            message.topic,
                            message.msgtype,
                            message.data,
                            time.time_ns(),
                            message.logged_ns,
                            message.sequence,
                            b"file",
                        )
                    )
            for reason in self._mcap.refused:
                receiver.refuse(self._path.name, reason)
            self._mcap.refused.clear()
            if self._mcap.is_complete or not self._wait():
                return
