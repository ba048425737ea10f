# SPDX-License-Identifier: BSD-3-Clause
"""Plays a recording on a wire as a robot would: ``python -m coclo_vio.live.publish_recording RECORDING --wire zenoh``.

It is there to try a set-up without the robot, and for tests. At the end it prints what it sent, as JSON.
"""

import argparse
import json
import signal
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from threading import Event

from coclo_vio.datasets.rosbag.storage.type_definitions import TypeDefinitions
from coclo_vio.live.open_wire import dds_wire, types_of, zenoh_wire
from coclo_vio.live.recorded_messages import RecordedMessage, low_states, recorded_messages, restamped
from coclo_vio.live.wire import RobotWire
from coclo_vio.runs.live_config import LiveConfig, ZenohConfig
from coclo_vio.values.errors import CocloError
from coclo_vio.values.units import NS_PER_S

_STATIC = "/tf_static"
_SETTLED_S = 1.0
_LONGEST_NAP_S = 0.05
_ACKNOWLEDGED_S = 5.0


@dataclass(frozen=True, slots=True)
class Playback:
    """How a recording is played.

    Attributes:
        rate: seconds of the recording per second.
        seconds: of the recording that are played, None: all.
        waits_s: for a subscriber, at most; 0: not at all.
        keeps_stamps: leave the stamps as recorded; otherwise they are shifted to now.
        loops: begin again at the end, with stamps that go on.
    """

    rate: float = 1.0
    seconds: float | None = None
    waits_s: float = 0.0
    keeps_stamps: bool = False
    loops: bool = False


class Publisher:
    """Plays messages on a wire."""

    def __init__(self, wire: RobotWire, types: TypeDefinitions, playback: Playback) -> None:
        """Take the wire and how to play."""
        self._wire, self._types, self._playback = wire, types, playback
        self.sent: Counter[str] = Counter()
        self.is_stopped = Event()

    def play(self, messages: Callable[[], Iterator[RecordedMessage]]) -> None:
        """Play them all.

        Args:
            messages: those of the recording, from its beginning each time it is called.

        Raises:
            CocloError: the wire does not take a message.
        """
        self._announce(messages())
        self._wait()
        begun_s, begun_ns, played_ns = time.monotonic(), time.time_ns(), 0
        while not self.is_stopped.is_set():
            first_ns = last_ns = None
            for message in messages():
                first_ns = message.at_ns if first_ns is None else first_ns
                last_ns = message.at_ns
                at_ns = played_ns + message.at_ns - first_ns
                if not self._nap_until(begun_s + at_ns / NS_PER_S / self._playback.rate) or self._is_over(at_ns):
                    return
                self._send(message, 0 if self._playback.keeps_stamps else begun_ns + played_ns - first_ns)
            if not self._playback.loops or first_ns is None or last_ns is None:
                return
            played_ns += last_ns - first_ns + NS_PER_S // 100

    def close(self) -> None:
        """Wait until everything has been taken, and leave the wire."""
        self._wire.flush(_ACKNOWLEDGED_S)
        time.sleep(_SETTLED_S)
        self._wire.close()

    def _announce(self, messages: Iterator[RecordedMessage]) -> None:
        """Declare the topics of the first seconds, so that subscribers find them before anything is sent."""
        first_ns = None
        for message in messages:
            first_ns = message.at_ns if first_ns is None else first_ns
            self._wire.announce(message.topic, message.msgtype, is_transient_local=message.topic == _STATIC)
            self.sent.setdefault(message.topic, 0)
            if message.at_ns - first_ns > 2 * NS_PER_S:
                return

    def _wait(self) -> None:
        """Wait until somebody subscribes, and no further subscription comes for a while."""
        end_s, settled_s, known = time.monotonic() + self._playback.waits_s, 0.0, -1
        while time.monotonic() < end_s and not self.is_stopped.wait(_LONGEST_NAP_S):
            listened = sum(self._wire.has_listeners(topic) for topic in self.sent)
            if listened != known:
                known, settled_s = listened, time.monotonic()
            elif known > 0 and time.monotonic() - settled_s > _SETTLED_S:
                return

    def _send(self, message: RecordedMessage, shift_ns: int) -> None:
        data = restamped(message, self._types, shift_ns) if shift_ns else message.data
        self._wire.publish(message.topic, message.msgtype, message.at_ns, data)
        self.sent[message.topic] += 1

    def _is_over(self, at_ns: int) -> bool:
        return self._playback.seconds is not None and at_ns > self._playback.seconds * NS_PER_S

    def _nap_until(self, due_s: float) -> bool:
        """Wait for a time of ``monotonic``; False where playing is stopped meanwhile."""
        while (left_s := due_s - time.monotonic()) > 0:
            if self.is_stopped.wait(min(left_s, _LONGEST_NAP_S)):
                return False
        return not self.is_stopped.is_set()


def main(arguments: list[str] | None = None) -> int:
    """Play a recording; returns the exit status."""
    given = _parser().parse_args(arguments)
    live = LiveConfig(distribution=given.distribution)
    try:
        with ExitStack() as stack:
            types = types_of(live)
            wire = _wire(given, types)
            publisher = Publisher(
                wire, types, Playback(given.rate, given.seconds, given.wait, given.keep_stamps, given.loop)
            )
            for number in (signal.SIGINT, signal.SIGTERM):
                signal.signal(number, lambda *_: publisher.is_stopped.set())
            stack.callback(publisher.close)
            publisher.play(_messages(given, types, stack))
    except CocloError as error:
        sys.stderr.write(f"{error}\n")
        return 1
    sys.stdout.write(json.dumps({"sent": dict(publisher.sent)}) + "\n")
    return 0


def _messages(
    given: argparse.Namespace, types: TypeDefinitions, stack: ExitStack
) -> Callable[[], Iterator[RecordedMessage]]:
    if given.wire == "unitree":
        return lambda: low_states(given.recording, given.robot, types)

    def again() -> Iterator[RecordedMessage]:
        with recorded_messages(given.recording, given.robot, types) as messages:
            yield from messages

    return again


def _wire(given: argparse.Namespace, types: TypeDefinitions) -> RobotWire:
    if given.wire == "zenoh":
        connect = () if given.endpoint is None else (given.endpoint,)
        listen = () if given.listen is None else (given.listen,)
        return zenoh_wire(types, ZenohConfig(connect=connect, listen=listen), "recording", given.domain)
    return dds_wire(types, given.domain, keeps_all=True)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m coclo_vio.live.publish_recording", description=__doc__)
    parser.add_argument("recording", type=Path)
    parser.add_argument("--wire", choices=("zenoh", "dds", "unitree"), default="zenoh")
    parser.add_argument("--endpoint", help="zenoh endpoint to connect to, such as tcp/localhost:7447")
    parser.add_argument("--listen", help="zenoh endpoint to listen on, such as tcp/localhost:7448")
    parser.add_argument("--domain", type=int, default=0, help="ROS_DOMAIN_ID")
    parser.add_argument("--robot", help="of a recording that is no bag of ROS 2")
    parser.add_argument("--rate", type=float, default=1.0, help="seconds of the recording per second")
    parser.add_argument("--seconds", type=float, help="of the recording that are played")
    parser.add_argument("--wait", type=float, default=0.0, help="for a subscriber, s at most")
    parser.add_argument("--keep-stamps", action="store_true", help="otherwise stamps are shifted to now")
    parser.add_argument("--loop", action="store_true", help="begin again at the end")
    parser.add_argument("--distribution", choices=("humble", "iron", "jazzy", "kilted"), default="jazzy")
    return parser


if __name__ == "__main__":
    sys.exit(main())
