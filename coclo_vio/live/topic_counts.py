# SPDX-License-Identifier: BSD-3-Clause
"""Every message of a topic accounted for: received, lost, late, dropped, refused; and how long it was under way.

Where the wire numbers its messages (rmw_zenoh does), those missing between the first and the last number of a sender
are lost; otherwise those count that the wire itself reports (DDS does).
"""

from collections import Counter
from dataclasses import dataclass, field

from pydantic import BaseModel, ConfigDict

from coclo_vio.live.latency_histogram import LatencyHistogram, LatencyRecord
from coclo_vio.live.wire import WireMessage


class TopicRecord(BaseModel):
    """What came on a topic.

    Attributes:
        msgtype: its type.
        received: messages that came.
        lost: messages that were sent meanwhile and did not come.
        earlier: messages that were sent before the first one came.
        late: messages that came after one with a higher number, or again.
        dropped: messages that came and were dropped, since the estimator did not keep up.
        refused: messages that could not be read, by reason.
        senders: number of publishers.
        latency: from sending to arrival; by two clocks where the sender is another computer.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    msgtype: str
    received: int
    lost: int
    earlier: int
    late: int
    dropped: int
    refused: dict[str, int]
    senders: int
    latency: LatencyRecord | None


@dataclass(slots=True)
class _Sender:
    """The numbers of one publisher's messages."""

    first: int
    last: int
    received: int = 1

    @property
    def lost(self) -> int:
        return max(0, self.last - self.first + 1 - self.received)


@dataclass(slots=True)
class TopicCounts:
    """Counts the messages of one topic; one thread at a time."""

    msgtype: str
    received: int = 0
    late: int = 0
    dropped: int = 0
    lost_by_wire: int = 0
    refused: Counter[str] = field(default_factory=Counter)
    latency: LatencyHistogram = field(default_factory=LatencyHistogram)
    _senders: dict[bytes, _Sender] = field(default_factory=dict)

    def add(self, message: WireMessage) -> None:
        """Count a message that came."""
        self.received += 1
        if message.sent_ns is not None:
            self.latency.add(message.arrived_ns - message.sent_ns)
        if message.sequence is None:
            self._senders.setdefault(message.sender, _Sender(1, 0, 0))
            return
        sender = self._senders.get(message.sender)
        if sender is None:
            self._senders[message.sender] = _Sender(message.sequence, message.sequence)
            return
        sender.received += 1
        if message.sequence <= sender.last:
            self.late += 1
        sender.last = max(sender.last, message.sequence)

    def record(self) -> TopicRecord:
        """What it came to."""
        senders = self._senders.values()
        return TopicRecord(
            msgtype=self.msgtype,
            received=self.received,
            lost=self.lost_by_wire + sum(sender.lost for sender in senders),
            earlier=sum(max(0, sender.first - 1) for sender in senders),
            late=self.late,
            dropped=self.dropped,
            refused=dict(self.refused),
            senders=len(senders),
            latency=self.latency.record(),
        )
