# SPDX-License-Identifier: BSD-3-Clause
"""A source that gives messages at once, each with the time at which it is said to have come; and a run on it."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from coclo_vio.live.live_record import LiveRecord
from coclo_vio.live.open_wire import configured_for, types_of
from coclo_vio.live.recorded_messages import RecordedMessage, recorded_messages, restamped
from coclo_vio.live.session import LiveSettings, run_live
from coclo_vio.live.wire import Receiver, WireMessage
from coclo_vio.runs.live_config import LiveConfig
from coclo_vio.runs.modes.registry import mode_of
from coclo_vio.runs.observers import Observers
from coclo_vio.runs.run_config import resolve
from coclo_vio.runs.run_record import RunRecord
from coclo_vio.values.calibration import SensorCalibrations

TYPES = types_of(LiveConfig())


class PlayedSource:
    """Has given everything when it has been started."""

    name = "a list of messages"

    def __init__(self, messages: Sequence[WireMessage]) -> None:
        self.is_over = False
        self._messages = messages

    def start(self, receiver: Receiver) -> None:
        for message in self._messages:
            if receiver.wants(message.topic, message.msgtype):
                receiver.take(message)
        self.is_over = True

    def poll(self) -> None:
        pass

    def typed(self, topic: str, msgtype: str) -> object:
        return TYPES.typed(msgtype)

    def close(self) -> None:
        pass


def messages_of(recording: Path) -> list[WireMessage]:
    """The messages of a recording, each as if it had come at its stamp."""
    with recorded_messages(recording, None, TYPES) as found:
        return [came(message, message.at_ns) for message in found if message.at_ns]


def came(message: RecordedMessage, at_ns: int) -> WireMessage:
    """A message that came at a time."""
    return WireMessage(message.topic, message.msgtype, message.data, at_ns, at_ns, monotonic_ns=at_ns)


def stamped_later(message: WireMessage, shift_ns: int) -> WireMessage:
    """The same message at the same time, with another stamp in its header."""
    recorded = RecordedMessage(message.topic, message.msgtype, message.arrived_ns, message.data)
    return replace(message, data=restamped(recorded, TYPES, shift_ns))


def run_played(
    messages: Sequence[WireMessage],
    folder: Path,
    mode: str = "coclo",
    *,
    settings: Sequence[str] = (),
    source: str = "file",
    observers: Observers | None = None,
) -> tuple[RunRecord, LiveRecord]:
    """Run a mode on messages; nothing is dropped, and no bag of them is written.

    Args:
        messages: in the order in which they come.
        folder: of the run.
        mode: to run.
        settings: of the configuration.
        source: that of ``--source`` whose messages they are.
        observers: of the run.
    """
    kept = ("live.most_messages=100000", "live.most_images=1000", "live.records=false", "bridge.vision=in_turn")
    config = configured_for(source, resolve("daisy", settings=[*kept, *settings]))
    live = LiveSettings(mode_of(mode), config, folder, SensorCalibrations(), observers=observers or Observers())
    return run_live(PlayedSource(messages), (), TYPES, live)
