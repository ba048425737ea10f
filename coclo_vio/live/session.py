# SPDX-License-Identifier: BSD-3-Clause
"""One run on a wire: messages in, measurements to the estimator, outputs to the run folder and to the wire."""

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path

from coclo_vio.datasets.rosbag.storage.arrived_messages import ArrivedMessages
from coclo_vio.datasets.rosbag.storage.type_definitions import TypeDefinitions
from coclo_vio.live.estimate_latency import EstimateLatency
from coclo_vio.live.intake import Intake
from coclo_vio.live.live_record import LiveRecord
from coclo_vio.live.live_recording import LiveRecording
from coclo_vio.live.measurement_stream import MeasurementStream
from coclo_vio.live.outgoing import Outgoing
from coclo_vio.live.preparation import Prepared, prepared_of_measurements, prepared_of_messages, wants_of
from coclo_vio.live.ros_outputs import RosOutputs
from coclo_vio.live.run_files import RunFiles
from coclo_vio.live.unending import UnendingEstimator
from coclo_vio.live.wire import Sink, Source, WireMessage, raw_message
from coclo_vio.live.wire_events import WireEvents
from coclo_vio.runs import pipeline
from coclo_vio.runs.modes.mode import Mode
from coclo_vio.runs.observers import Observers
from coclo_vio.runs.paced_play import for_use_online
from coclo_vio.runs.recording_view import seen
from coclo_vio.runs.run_config import RunConfig
from coclo_vio.runs.run_record import RunRecord
from coclo_vio.values.calibration import SensorCalibrations
from coclo_vio.values.errors import CocloError, DatasetError
from coclo_vio.values.measurements import Measurement
from coclo_vio.values.outputs import Estimate, Output

_LOOK_AROUND_S = 0.05
_POLL_S = 0.1
_RETRY_S = 0.5


@dataclass(frozen=True, slots=True)
class LiveSettings:
    """What one run on a wire is made of.

    Attributes:
        mode: to run.
        config: of the run.
        folder: of the run, made if needed.
        given: calibrations that go before those of the wire.
        seconds: how long to run from the first sample on, None: until it is stopped.
        stops: whether to stop; asked many times a second.
        observers: who is shown what the mode reads and gives.
    """

    mode: Mode
    config: RunConfig
    folder: Path
    given: SensorCalibrations
    seconds: float | None = None
    stops: Callable[[], bool] = lambda: False
    observers: Observers = field(default_factory=Observers)


def run_live(
    source: Source, sinks: Sequence[Sink], types: TypeDefinitions, settings: LiveSettings
) -> tuple[RunRecord, LiveRecord]:
    """Run until the time is over, the source ends or ``stops`` says so; the files of the run are complete then.

    A message that cannot be read, and a measurement that the estimator refuses, are counted and reported as events.
    Frames of ``combined`` are processed beside the filter unless ``bridge.vision`` says otherwise.

    Args:
        source: of messages.
        sinks: to which odometry, transforms and diagnostics go besides the recording.
        types: definitions of what goes out.
        settings: mode, configuration, folder.

    Raises:
        CocloError: what the mode needs has not come in time, or a file of the run cannot be written.
    """
    settings = replace(settings, config=for_use_online(settings.config))
    live = settings.config.live
    events = WireEvents(live.event_s)
    intake = Intake(
        wants_of(settings.config, settings.mode),
        events,
        most_messages=live.most_messages,
        most_images=live.most_images,
    )
    with ExitStack() as stack:
        stack.callback(source.close)
        source.start(intake.receiver)
        session = _Session(source, intake, events, settings)
        prepared, first = session.gathered()
        if prepared.messages is not None and prepared.converter is not None:
            intake.choose(prepared.messages.carriers(prepared.converter.topics))
        return session.run(prepared, first, sinks, types, stack)


class _Session:
    """The run from the first message on."""

    def __init__(self, source: Source, intake: Intake, events: WireEvents, settings: LiveSettings) -> None:
        self._source, self._intake, self._events, self._settings = source, intake, events, settings
        self._live = settings.config.live
        self._polled_s = 0.0
        self._ends_s: float | None = None
        self._recording: LiveRecording | None = None

    def gathered(self) -> tuple[Prepared, list[WireMessage | Measurement]]:
        """Gather until what the mode needs has come; the estimator, and what has been gathered.

        Raises:
            CocloError: it has not come in time.
        """
        live, settings = self._live, self._settings
        rest = settings.mode, settings.config, settings.given, settings.observers.drawn_every
        arrived = ArrivedMessages(self._source.name, self._source.typed)
        gathered: list[WireMessage | Measurement] = []
        begun_s = time.monotonic()
        try_s: float | None = None
        problem: CocloError | None = None
        while True:
            item = self._next()
            now_s = time.monotonic()
            if item is not None:
                try_s = now_s + live.first_messages_s if try_s is None else try_s
                gathered.append(item)
                if isinstance(item, WireMessage):
                    arrived.add(raw_message(item, live.unstamped), item.msgtype)
            is_last = now_s - begun_s > live.wait_s or self._stops() or (self._source.is_over and item is None)
            if try_s is not None and (now_s >= try_s or is_last):
                try_s = now_s + _RETRY_S
                kinds = frozenset(type(one) for one in gathered if not isinstance(one, WireMessage))
                try:
                    if kinds:
                        return prepared_of_measurements(kinds, self._source.name, *rest), gathered
                    return prepared_of_messages(arrived, *rest), gathered
                except CocloError as error:
                    problem = error
            if is_last:
                raise problem or DatasetError(
                    f"{self._source.name}: nothing that is read came within {now_s - begun_s:.0f} s; check --endpoint, "
                    "--domain and the topics, or wait longer (live.wait_s)"
                )
            excess = max(0, len(gathered) - 4 * live.most_messages)
            self._intake.leave_out(gathered[:excess])
            del gathered[:excess]

    def run(
        self,
        prepared: Prepared,
        first: list[WireMessage | Measurement],
        sinks: Sequence[Sink],
        types: TypeDefinitions,
        stack: ExitStack,
    ) -> tuple[RunRecord, LiveRecord]:
        """Push everything and hand on what comes out."""
        settings, live, observers = self._settings, self._live, self._settings.observers
        files = stack.enter_context(RunFiles(settings.folder, settings.mode, prepared, self._source.name))
        if live.records:
            self._recording = LiveRecording(settings.folder, types, self._source)
            stack.callback(self._recording.close)
        outputs = RosOutputs(types, settings.mode.trajectory_names, live)
        all_sinks = [*sinks, *([] if self._recording is None else [self._recording])]
        outgoing = Outgoing(outputs, all_sinks, self._events, live.diagnostics_s)
        latency = EstimateLatency()
        stream = MeasurementStream(prepared, settings.config, self._intake, latency)
        begun_s = time.monotonic()

        def take(output: Output) -> None:
            if isinstance(output, Estimate):
                latency.estimated(output)
            outgoing.take(output)
            observers.take(settings.mode.name, output)

        def advance(stamp_ns: int) -> None:
            if outgoing.diagnose(stamp_ns, self._intake.records, prepared.estimator):
                if self._recording is not None:
                    self._recording.flush()
                files.write_live(self._counted(prepared, outgoing, latency, begun_s))
            files.advance()

        def keep(output: Output) -> None:
            if observers.keep(output):
                files.take(output)

        estimator = UnendingEstimator(prepared.estimator, self._events, lambda: stream.arrival_ns)
        measurements = stream.measurements(self._items(first))
        shown = measurements if observers.view is None else seen(measurements, observers.view)
        summary = pipeline.run(estimator, shown, take, advance, tally=files.tally, keep=keep)
        self._source.close()
        counted = self._counted(prepared, outgoing, latency, begun_s)
        files.write_live(counted)
        return files.finish(summary, is_stopped=settings.stops()), counted

    def _counted(self, prepared: Prepared, outgoing: Outgoing, latency: EstimateLatency, begun_s: float) -> LiveRecord:
        return LiveRecord(
            source=self._source.name,
            mode=self._settings.mode.name,
            roles=dict(prepared.roles),
            topics=dict(self._intake.records()),
            duration_s=time.monotonic() - begun_s,
            estimates=latency.records(),
            published=dict(outgoing.published),
            unsent=dict(outgoing.unsent),
        )

    def _items(self, first: list[WireMessage | Measurement]) -> Iterator[WireMessage | Measurement | None]:
        """What was gathered, then what comes; None where nothing comes for a while."""
        if self._settings.seconds is not None:
            self._ends_s = time.monotonic() + self._settings.seconds
        for item in first:
            self._record(item)
            yield item
        first.clear()
        while not self._stops():
            came = self._next()
            if came is None and self._is_over():
                return
            if came is not None:
                self._record(came)
            yield came

    def _next(self) -> WireMessage | Measurement | None:
        now_s = time.monotonic()
        if now_s - self._polled_s > _POLL_S:
            self._polled_s = now_s
            try:
                self._source.poll()
            except CocloError as error:
                self._intake.refuse(self._source.name, str(error))
        return self._intake.next(_LOOK_AROUND_S)

    def _is_over(self) -> bool:
        idle_s = time.monotonic() - self._intake.last_arrival_s
        return self._source.is_over or (self._live.idle_s > 0 and idle_s > self._live.idle_s)

    def _stops(self) -> bool:
        return self._settings.stops() or (self._ends_s is not None and time.monotonic() >= self._ends_s)

    def _record(self, item: WireMessage | Measurement) -> None:
        if self._recording is not None and isinstance(item, WireMessage):
            self._recording.take(item)
