# SPDX-License-Identifier: BSD-3-Clause
"""``live.json`` of a run folder: every message accounted for, and how long they took."""

from pathlib import Path
from typing import ClassVar, Literal

from coclo_vio.live.latency_histogram import LatencyRecord
from coclo_vio.live.topic_counts import TopicRecord
from coclo_vio.values.record import Record

LIVE_JSON = "live.json"


class LiveRecord(Record):
    """What came from a wire and what went out.

    Attributes:
        source: name of the wire.
        mode: that ran.
        roles: the topics that were read, by role.
        topics: what came on each.
        duration_s: from the start to the last message, s.
        estimates: from the arrival of a sample to the publication of the estimate of its time, by trajectory.
        published: messages that went out, by topic.
        unsent: messages that a sink did not take, by sink.
    """

    next_step: ClassVar[str] = "run again with `coclo-vio live`"

    schema_version: Literal[1] = 1
    source: str
    mode: str
    roles: dict[str, tuple[str, ...]]
    topics: dict[str, TopicRecord]
    duration_s: float
    estimates: dict[str, LatencyRecord]
    published: dict[str, int]
    unsent: dict[str, int]


def read_live_record(folder: Path) -> LiveRecord:
    """``live.json`` of a run folder.

    Raises:
        DatasetError: there is none, or it is malformed.
    """
    return LiveRecord.read(folder / LIVE_JSON)
