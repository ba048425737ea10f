# SPDX-License-Identifier: BSD-3-Clause
"""What came and what went out, as an MCAP bag that grows in the run folder."""

import shutil
from pathlib import Path
from typing import TYPE_CHECKING

from coclo_vio.datasets.rosbag.storage.type_definitions import TypeDefinitions
from coclo_vio.datasets.rosbag.writing.new_bag import RawBag
from coclo_vio.live.wire import Source, WireMessage
from coclo_vio.values.errors import CocloError

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

FOLDER = "recording"


class LiveRecording:
    """A bag of messages; one of a type without a definition is left out."""

    name = "recording"

    def __init__(self, folder: Path, types: TypeDefinitions, source: Source) -> None:
        """Begin ``recording`` in a run folder, in place of an earlier one.

        Args:
            folder: of the run.
            types: definitions of what goes out.
            source: has those of what comes.

        Raises:
            DatasetError: it cannot be written.
        """
        path = folder / FOLDER
        if (path / f"{FOLDER}.mcap").exists():
            shutil.rmtree(path)
        self._bag = RawBag(path)
        self._types, self._source = types, source
        self._refused: set[str] = set()

    def take(self, message: WireMessage) -> None:
        """Write a message that came, at the time of its arrival."""
        self._write(message.topic, message.msgtype, message.arrived_ns, message.data, incoming=True)

    def publish(self, topic: str, msgtype: str, stamp_ns: int, data: bytes) -> None:
        """Write a message that goes out."""
        self._write(topic, msgtype, stamp_ns, data, incoming=False)

    def flush(self) -> None:
        """Hand everything to the operating system."""
        self._bag.flush()

    def close(self) -> None:
        """Complete the bag.

        Raises:
            DatasetError: it cannot be written.
        """
        self._bag.close()

    def _write(self, topic: str, msgtype: str, at_ns: int, data: bytes, *, incoming: bool) -> None:
        if topic in self._refused:
            return
        try:
            self._bag.write(topic, msgtype, at_ns, data, self._store(topic, msgtype, incoming=incoming))
        except CocloError:
            self._refused.add(topic)

    def _store(self, topic: str, msgtype: str, *, incoming: bool) -> "Typestore":
        return (self._source.typed(topic, msgtype) if incoming else self._types.typed(msgtype))[1]
