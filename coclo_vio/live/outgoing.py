# SPDX-License-Identifier: BSD-3-Clause
"""What leaves a run: each estimate as messages to every sink, and diagnostics once in a while."""

import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence

from coclo_vio.live.ros_outputs import RosOutputs
from coclo_vio.live.topic_counts import TopicRecord
from coclo_vio.live.wire import Sink
from coclo_vio.live.wire_events import WireEvents
from coclo_vio.online.guarded_estimator import GuardedEstimator
from coclo_vio.values.errors import CocloError
from coclo_vio.values.outputs import Estimate, Event, Output


class Outgoing:
    """Publishes; a sink that does not take a message is counted and reported, and ends nothing.

    Attributes:
        published: messages that went out, by topic.
        unsent: messages that a sink did not take, by sink.
    """

    def __init__(self, outputs: RosOutputs, sinks: Sequence[Sink], events: WireEvents, every_s: float) -> None:
        """Take the sinks.

        Args:
            outputs: makes the messages.
            sinks: get them.
            events: gets what a sink does not take.
            every_s: diagnostics go out this often.
        """
        self._outputs, self._sinks, self._events, self._every_s = outputs, sinks, events, every_s
        self._due_s = time.monotonic() + every_s
        self._recent: list[Event] = []
        self._latest_ns = 0
        self.published: Counter[str] = Counter()
        self.unsent: Counter[str] = Counter()

    def take(self, output: Output) -> None:
        """Publish an estimate; keep an event for the next diagnostics."""
        match output:
            case Estimate():
                self._latest_ns = max(self._latest_ns, output.state.stamp_ns)
                for message in self._outputs.of_estimate(output):
                    self._send(*message)
            case Event():
                self._recent.append(output)

    def diagnose(
        self, stamp_ns: int, topics: Callable[[], Mapping[str, TopicRecord]], estimator: GuardedEstimator
    ) -> bool:
        """Publish diagnostics where they are due; returns whether they were.

        Args:
            stamp_ns: the time of the estimator, where there is no estimate yet.
            topics: what came.
            estimator: has counts, and knows what became of all samples.
        """
        now_s = time.monotonic()
        if now_s < self._due_s:
            return False
        self._due_s = now_s + self._every_s
        at_ns, status = self._latest_ns or stamp_ns, estimator.status
        self._send(*self._outputs.diagnostics(at_ns, topics(), estimator.counts, status, self._recent))
        self._recent.clear()
        return True

    def _send(self, topic: str, msgtype: str, stamp_ns: int, data: bytes) -> None:
        self.published[topic] += 1
        for sink in self._sinks:
            try:
                sink.publish(topic, msgtype, stamp_ns, data)
            except CocloError as error:
                self.unsent[sink.name] += 1
                self._events.report(topic, f"{sink.name} does not take it: {error}", kind="wire_publication_failed")
