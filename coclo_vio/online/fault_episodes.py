# SPDX-License-Identifier: BSD-3-Clause
"""Refused samples as events: one for an episode of one stream and one reason, with a count, not one a sample."""

from collections.abc import Iterator
from dataclasses import dataclass

from coclo_vio.online.clock_follower import Refused
from coclo_vio.values.outputs import Event
from coclo_vio.values.units import NS_PER_S

_QUIET_NS = NS_PER_S // 2  # without another refusal an episode is over
_LONGEST_NS = (5 * NS_PER_S, 60 * NS_PER_S)  # a longer one is reported in parts: the first part, and the later ones


@dataclass(slots=True)
class _Episode:
    first: Refused
    first_ns: int
    last_ns: int
    count: int = 1
    is_later_part: bool = False


class FaultEpisodes:
    """Collects refusals until an episode is over."""

    def __init__(self) -> None:
        self._episodes: dict[tuple[str, str], _Episode] = {}

    def add(self, refused: Refused, now_ns: int) -> None:
        """Take a refusal; ``now_ns`` is the newest stamp by the clock of the estimator."""
        episode = self._episodes.get((refused.stream, refused.reason))
        if episode is None:
            self._episodes[refused.stream, refused.reason] = _Episode(refused, now_ns, now_ns)
        elif not episode.count:  # its parts before have been reported
            self._episodes[refused.stream, refused.reason] = _Episode(refused, now_ns, now_ns, is_later_part=True)
        else:
            episode.last_ns, episode.count = now_ns, episode.count + 1

    def over(self, now_ns: int) -> Iterator[Event]:
        """Events of the episodes that are over by then, their stamps by the clock of the estimator."""
        if not self._episodes:
            return
        for key, episode in list(self._episodes.items()):
            is_over = now_ns - episode.last_ns > _QUIET_NS
            is_long = now_ns - episode.first_ns > _LONGEST_NS[episode.is_later_part]
            if episode.count and (is_over or is_long):
                yield _event(episode)
                episode.count = 0
            if is_over:
                del self._episodes[key]

    def finish(self) -> Iterator[Event]:
        """Events of all episodes: nothing comes any more."""
        yield from (_event(episode) for episode in self._episodes.values() if episode.count)
        self._episodes.clear()


def _event(episode: _Episode) -> Event:
    refused = episode.first
    detail = (
        f"{episode.count} {'sample' if episode.count == 1 else 'samples'} of {refused.stream} refused "
        f"({refused.reason}): the stamp of the first was {_shown(refused.stamp)}, expected was {refused.limit}; the "
        "estimator goes on without"
    )
    return Event(episode.first_ns, "stamp_refused", detail)


def _shown(stamp: object) -> str:
    return f"{stamp} ns" if isinstance(stamp, int) and not isinstance(stamp, bool) else repr(stamp)[:60]
