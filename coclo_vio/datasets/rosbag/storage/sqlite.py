# SPDX-License-Identifier: BSD-3-Clause
"""The readable rows of ROS 2 databases (.db3) that were cut off; ``rosbags`` refuses such a file."""

import sqlite3
import struct
from collections.abc import Collection, Generator
from contextlib import suppress
from pathlib import Path

from rosbags.interfaces import Connection, ConnectionExtRosbag2, MessageDefinition, MessageDefinitionFormat
from rosbags.rosbag2.errors import ReaderError

_FORMATS = {"ros2msg": MessageDefinitionFormat.MSG, "ros2idl": MessageDefinitionFormat.IDL}


def check_length(path: Path) -> None:
    """Compare a database with the number of pages in its header: SQLite misses the loss of half a page.

    Format: "Database file format", sqlite.org/fileformat.html, section 1.3.

    Raises:
        ReaderError: the file is shorter than its pages.
    """
    with path.open("rb") as file:
        header = file.read(100)
    if len(header) < 100 or header[24:28] != header[92:96]:  # no header, or one whose count is not valid
        return
    (page_size,), (pages,) = struct.unpack_from(">H", header, 16), struct.unpack_from(">I", header, 28)
    size = pages * (65536 if page_size == 1 else page_size)
    if path.stat().st_size < size:
        raise ReaderError(f"the file has {path.stat().st_size} of {size} bytes")


class CutSqliteReader:
    """A damaged .db3: topics and messages in the order of the table, up to the first page that is missing."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._database: sqlite3.Connection | None = None
        self.connections: list[Connection] = []

    def open(self) -> None:
        """Read the topics.

        Raises:
            ReaderError: the topics cannot be read.
        """
        try:
            uri = f"{self._path.resolve().as_uri()}?immutable=1"
            self._database = sqlite3.connect(uri, uri=True)
            self._database.text_factory = _lenient_text
            # SQLite refuses a file shorter than its header states, unless the schema is declared writable.
            self._database.execute("PRAGMA writable_schema=ON")
            rows = self._database.execute("SELECT id, name, type FROM topics ORDER BY id").fetchall()
        except sqlite3.Error as error:
            raise ReaderError(f"its list of topics cannot be read ({error})") from error
        definitions = self._definitions()
        none = MessageDefinition(MessageDefinitionFormat.NONE, "")
        qos = ConnectionExtRosbag2("cdr", [])
        self.connections = [
            Connection(number, topic, msgtype, definitions.get(msgtype, none), "", 0, qos, self)
            for number, topic, msgtype in rows
            if topic and msgtype
        ]

    def close(self) -> None:
        """Close the database."""
        if self._database is not None:
            self._database.close()
            self._database = None

    def messages(self, connections: Collection[Connection]) -> Generator[tuple[Connection, int, bytes], None, None]:
        """Messages of ``connections`` in the order in which they were written, up to the cut."""
        if self._database is None:
            raise ReaderError("the database is not open")
        by_id = {connection.id: connection for connection in connections}
        rows = self._database.execute("SELECT topic_id, timestamp, data FROM messages")
        while True:
            try:
                row = rows.fetchone()
            except sqlite3.Error:
                return
            if row is None:
                return
            number, received_ns, data = row
            if not isinstance(received_ns, int) or not isinstance(data, bytes):  # a row in a lost page
                return
            if number in by_id:
                yield by_id[number], received_ns, data

    def _definitions(self) -> dict[str, MessageDefinition]:
        """Message definitions by type, where the recorder wrote them and they can be read."""
        found: dict[str, MessageDefinition] = {}
        with suppress(sqlite3.Error, KeyError):
            rows = self._database.execute(  # type: ignore[union-attr]
                "SELECT topic_type, encoding, encoded_message_definition FROM message_definitions"
            )
            for msgtype, encoding, text in rows:
                found[msgtype] = MessageDefinition(_FORMATS[encoding], text)
        return found


def _lenient_text(text: bytes) -> str:
    return text.decode("utf-8", errors="replace")
