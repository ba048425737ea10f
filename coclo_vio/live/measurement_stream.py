# SPDX-License-Identifier: BSD-3-Clause
"""Measurements from messages as they come: converted, corrected, decoded; the guard puts them in order."""

import time
from collections.abc import Iterable, Iterator

from coclo_vio.datasets.rosbag.conversion import Item
from coclo_vio.datasets.rosbag.stereo_pairing import RawPair
from coclo_vio.datasets.sample_corrections import SampleCorrections
from coclo_vio.live.estimate_latency import EstimateLatency
from coclo_vio.live.intake import Intake
from coclo_vio.live.preparation import Prepared
from coclo_vio.live.wire import WireMessage, raw_message
from coclo_vio.runs.run_config import RunConfig
from coclo_vio.values.errors import DatasetError, shortened
from coclo_vio.values.measurements import Measurement


class MeasurementStream:
    """Turns what comes into measurements; what cannot be turned is refused with its topic and the reason.

    Attributes:
        arrival_ns: when the measurement that was given last came, by a clock that never steps; None if that is unknown.
    """

    def __init__(self, prepared: Prepared, config: RunConfig, intake: Intake, latency: EstimateLatency) -> None:
        """Prepare the conversion.

        Args:
            prepared: the converter.
            config: corrections of the samples.
            intake: counts what is refused.
            latency: gets the arrival of each sample.
        """
        self._prepared, self._intake, self._latency = prepared, intake, latency
        self._unstamped = config.live.unstamped
        self.arrival_ns: int | None = None
        self._corrections = SampleCorrections(config.dataset.corrections, prepared.config.robot)
        self._refused = dict(prepared.tally.dropped)

    def measurements(self, items: Iterable[WireMessage | Measurement | None]) -> Iterator[Measurement]:
        """The measurements, in the order in which they came.

        Args:
            items: messages and measurements as they come; None where nothing comes for a while.
        """
        for item in items:
            if isinstance(item, WireMessage):
                yield from self._given(self._converted(item), item.arrived_ns, item.monotonic_ns)
            elif item is not None:
                yield from self._given((item,), time.time_ns(), None)

    def _given(self, found: Iterable[Item], arrived_ns: int, monotonic_ns: int | None) -> Iterator[Measurement]:
        """The measurements of one arrival."""
        self.arrival_ns = monotonic_ns
        for item in found:
            sample = self._decoded(item)
            if sample is not None:
                self._prepared.tally.count(type(sample), sample.stamp_ns)
                self._latency.arrived(sample.stamp_ns, arrived_ns)
                yield sample

    def _converted(self, message: WireMessage) -> Iterator[Item]:
        messages, converter = self._prepared.messages, self._prepared.converter
        if messages is None or converter is None:
            return
        for raw in messages.expanded(raw_message(message, self._unstamped), converter.topics):
            try:
                for item in converter.push(raw):
                    yield item if isinstance(item, RawPair) else self._corrections.corrected(item)
            except (DatasetError, ValueError, ArithmeticError) as error:
                self._intake.refuse(message.topic, shortened(error))
        self._count_refused(message.topic)

    def _count_refused(self, topic: str) -> None:
        """Report what the converter has left out since."""
        dropped = self._prepared.tally.dropped
        if dropped == self._refused:
            return
        for name, count in dropped.items():
            of_topic, _, reason = name.partition(": ")
            for _ in range(count - self._refused.get(name, 0)):
                self._intake.refuse(topic if of_topic.startswith(topic) else of_topic, reason)
        self._refused = dict(dropped)

    def _decoded(self, item: Item) -> Measurement | None:
        if not isinstance(item, RawPair):
            return item
        if self._prepared.messages is None:
            return None
        try:
            return self._corrections.corrected(item.decoded(self._prepared.messages))
        except DatasetError as error:
            self._intake.refuse(item.left.topic, shortened(error))
            return None
