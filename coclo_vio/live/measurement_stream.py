# SPDX-License-Identifier: BSD-3-Clause
"""Measurements in order from messages as they come: converted, corrected, sorted within milliseconds, decoded."""

import time
from collections.abc import Iterable, Iterator

import numpy as np

from coclo_vio.datasets.joint_velocity import JointVelocityEstimator
from coclo_vio.datasets.rosbag.conversion import Item, item_key
from coclo_vio.datasets.rosbag.stereo_pairing import RawPair
from coclo_vio.datasets.rosbag.timing import ReorderWindow
from coclo_vio.datasets.sample_corrections import SampleCorrections
from coclo_vio.live.estimate_latency import EstimateLatency
from coclo_vio.live.intake import Intake
from coclo_vio.live.preparation import Prepared
from coclo_vio.live.wire import WireMessage, raw_message
from coclo_vio.runs.run_config import RunConfig
from coclo_vio.values.errors import DatasetError, shortened
from coclo_vio.values.measurements import JointSample, Measurement
from coclo_vio.values.units import NS_PER_S

_Arrived = tuple[int, Item]


class MeasurementStream:
    """Turns what comes into measurements; what cannot be turned is refused with its topic and the reason."""

    def __init__(self, prepared: Prepared, config: RunConfig, intake: Intake, latency: EstimateLatency) -> None:
        """Prepare the conversion.

        Args:
            prepared: the converter.
            config: corrections of the samples, span of sorting.
            intake: counts what is refused.
            latency: gets the arrival of each sample.
        """
        self._prepared, self._intake, self._latency = prepared, intake, latency
        self._unstamped = config.live.unstamped
        self._window: ReorderWindow[_Arrived] = ReorderWindow(round(config.live.reorder_s * NS_PER_S))
        self._sorts = config.live.reorder_s > 0
        self._corrections = SampleCorrections(config.dataset.corrections, prepared.config.robot)
        lacks = prepared.lacks_velocity
        if config.dataset.corrections.joints.velocity == "from_position" and prepared.config.robot is not None:
            lacks = np.ones(len(prepared.config.robot.joint_names), dtype=np.bool_)
        self._lacks_velocity = lacks
        self._velocity = JointVelocityEstimator(config.dataset.joint_velocity)
        self._refused = dict(prepared.tally.dropped)

    def measurements(self, items: Iterable[WireMessage | Measurement | None]) -> Iterator[Measurement]:
        """The measurements, each once those before it have come or the span of sorting is over.

        Args:
            items: messages and measurements as they come; None where nothing comes for a while.
        """
        for item in items:
            due = self._window.advance(time.time_ns()) if item is None else self._pushed(item)
            yield from self._ready(due)
        yield from self._ready(self._window.finish())

    def _pushed(self, item: WireMessage | Measurement) -> Iterator[_Arrived]:
        if isinstance(item, WireMessage):
            arrived_ns = item.arrived_ns
            found = self._converted(item)
        else:
            arrived_ns = time.time_ns()
            found = iter([item])
        for sample in found:
            if self._sorts:
                yield from self._window.push(arrived_ns, item_key(sample), (arrived_ns, sample))
            else:
                yield arrived_ns, sample

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

    def _ready(self, due: Iterable[_Arrived]) -> Iterator[Measurement]:
        for arrived_ns, item in due:
            sample = self._decoded(item)
            if sample is None:
                continue
            if isinstance(sample, JointSample) and self._lacks_velocity is not None:
                estimated = self._velocity.push(sample.stamp_ns, sample.position)
                sample = sample.with_velocity(np.where(self._lacks_velocity, estimated, sample.velocity))
            self._prepared.tally.count(type(sample), sample.stamp_ns)
            self._latency.arrived(sample.stamp_ns, arrived_ns)
            yield sample

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
