# SPDX-License-Identifier: BSD-3-Clause
"""Streams that are silent while others go on; the estimator goes on with what there is."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from coclo_vio.online.config import OnlineConfig
from coclo_vio.online.stream_state import StreamState
from coclo_vio.values.outputs import Event
from coclo_vio.values.units import NS_PER_S

_PERIODS = 10  # a stream is not silent before so many of its periods
_EVERY_NS = NS_PER_S // 20


@dataclass(slots=True)
class _Heard:
    """When a stream was heard last, and for how long others have gone on since."""

    last_ns: int
    arrived: int = 0
    silent_ns: int = 0
    is_silent: bool = False


class StreamWatch:
    """Events where a stream falls silent, and where it goes on."""

    def __init__(self, config: OnlineConfig) -> None:
        """Take the limit."""
        self._silent_ns = round(config.silent_s * NS_PER_S)
        self._heard: dict[type, _Heard] = {}
        self._looked_ns: int | None = None

    def look(self, streams: Iterable[StreamState], now_ns: int) -> Iterator[Event]:
        """See which streams are silent; where nothing comes at all, that time does not count.

        Args:
            streams: all of them.
            now_ns: newest stamp of all, by the clock of the estimator.
        """
        step_ns = 0 if self._looked_ns is None else now_ns - self._looked_ns
        if not self._silent_ns or (self._looked_ns is not None and 0 <= step_ns < _EVERY_NS):
            return
        self._looked_ns = now_ns
        for stream in streams:
            heard = self._heard.setdefault(stream.kind, _Heard(now_ns))
            if stream.arrived != heard.arrived:
                if heard.is_silent:
                    pause_s = (now_ns - heard.last_ns) / NS_PER_S
                    yield Event(now_ns, "stream_resumed", f"{stream.name} goes on after {pause_s:.2g} s of silence")
                self._heard[stream.kind] = _Heard(now_ns, stream.arrived)
                continue
            heard.silent_ns += min(step_ns, 2 * _EVERY_NS)
            if heard.is_silent or stream.period_ns is None:
                continue
            if heard.silent_ns > max(self._silent_ns, _PERIODS * stream.period_ns):
                heard.is_silent = True
                detail = (
                    f"no sample of {stream.name} has come for {heard.silent_ns / NS_PER_S:.2g} s, while others have "
                    f"(online.silent_s = {self._silent_ns / NS_PER_S:g}): the estimator goes on without"
                )
                yield Event(now_ns, "stream_silent", detail)
