# SPDX-License-Identifier: BSD-3-Clause
"""Measurements in time order from a bag's messages: one pass, a second of messages in memory."""

from collections.abc import Iterator

from coclo_vio.datasets.read_report import ReadTally
from coclo_vio.datasets.rosbag.config import RosbagConfig
from coclo_vio.datasets.rosbag.conversion import Item, MessageConverter, item_key
from coclo_vio.datasets.rosbag.storage.message_set import MessageSet
from coclo_vio.datasets.rosbag.timing import ReorderWindow
from coclo_vio.values.units import NS_PER_S


class BagStream:
    """One pass over a bag: the samples of the chosen sensors; image pairs are not yet decoded."""

    def __init__(self, bag: MessageSet, converter: MessageConverter, config: RosbagConfig, tally: ReadTally) -> None:
        """Prepare the pass.

        Args:
            bag: the bag.
            converter: a fresh one.
            config: within which span messages are sorted.
            tally: gets a note on messages that are later than that.
        """
        self._bag, self._converter, self._config, self._tally = bag, converter, config, tally

    def in_order(self, *, sorts: bool) -> Iterator[Item]:
        """The samples by stamp: streamed, or all held in memory and sorted.

        Raises:
            DatasetError: a message cannot be decoded, or a stamp that goes back, unless they are dropped.
        """
        if sorts:
            yield from sorted((item for _, item in self._items()), key=item_key)
            return
        window: ReorderWindow[Item] = ReorderWindow(round(self._config.reorder_s * NS_PER_S))
        for received_ns, item in self._items():
            yield from window.push(received_ns, item_key(item), item)
        yield from window.finish()
        if window.late:
            self._tally.note(
                f"{window.late} samples came more than {self._config.reorder_s:g} s late and are out of order; "
                "increase dataset.rosbag.reorder_s, or set dataset.rosbag.clock=received"
            )

    def _items(self) -> Iterator[tuple[int, Item]]:
        received_ns = 0
        for message in self._bag.messages(self._converter.topics):
            received_ns = max(received_ns, message.received_ns)
            for item in self._converter.push(message):
                yield message.received_ns, item
        for item in self._converter.finish():
            yield received_ns, item
