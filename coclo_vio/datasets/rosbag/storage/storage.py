# SPDX-License-Identifier: BSD-3-Clause
"""The common interface of the readers of a bag's files."""

from collections.abc import Collection, Iterator
from typing import Protocol

from rosbags.interfaces import Connection


class Storage(Protocol):
    """The common interface of the readers of ``rosbags`` and of those of damaged files."""

    @property
    def connections(self) -> list[Connection]:
        """The connections of an open file; a topic may have several."""

    def open(self) -> None:
        """Read the connections."""

    def close(self) -> None:
        """Close the file."""

    def messages(self, connections: Collection[Connection]) -> Iterator[tuple[Connection, int, bytes]]:
        """Messages of ``connections`` with the time at which they were received, ns."""
