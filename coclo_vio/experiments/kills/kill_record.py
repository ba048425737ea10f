# SPDX-License-Identifier: BSD-3-Clause
"""``kills.json``: what became of each command that was ended."""

from collections.abc import Sequence
from typing import ClassVar, Literal

from pydantic import BaseModel, ConfigDict

from coclo_vio.values.record import Record

Left = Literal["evaluated", "too short", "no estimate yet", "failed"]
"""What ``evaluate`` makes of the files: it reads them all; it finds one too short, as it does the same part of the run
that was not ended; there was no estimate yet, or no finished job; or it fails, or estimates are missing."""
_LONGEST_LOSS_S, _LARGEST_DIFFERENCE = 1.0, 1e-9


class _Part(BaseModel):
    """A part of a record."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class Kill(_Part):
    """What became of one command.

    Attributes:
        command: ``run``, ``compare`` or ``table``.
        modes: that it ran, separated by commas.
        signal: that ended it.
        at_share: of its work when the signal was sent.
        status: of the process.
        is_status_right: whether that is the expected one.
        lost_s: seconds before the newest measurement read of which estimates are missing that the whole run has; None
            where that is not known.
        left: what ``evaluate`` makes of the files, or of a table the jobs that had finished.
        reason: why it is not evaluated.
        resumed_status: of the process that resumed it.
        resumed_from_s: seconds of recording that were not computed again, by mode; of a table the jobs kept.
        difference: largest difference between a number of the resumed and the whole run; None where their files differ
            otherwise.
        has_same_events: whether events, counts and keyframes are the same; of a table what stands in its words.
    """

    command: str
    modes: str
    signal: str
    at_share: float
    status: int
    is_status_right: bool
    lost_s: float | None
    left: Left
    reason: str
    resumed_status: int
    resumed_from_s: dict[str, tuple[float, ...]]
    difference: float | None
    has_same_events: bool

    @property
    def is_whole(self) -> bool:
        """Whether nothing is missing but the last second."""
        return self.left != "failed" and (self.lost_s is None or self.lost_s <= _LONGEST_LOSS_S)

    @property
    def is_equal(self) -> bool:
        """Whether the resumed run is the one that was not ended."""
        return self.difference is not None and self.difference <= _LARGEST_DIFFERENCE and self.has_same_events

    @property
    def is_passed(self) -> bool:
        """Whether all is as it should be."""
        return self.is_status_right and self.is_whole and self.resumed_status == 0 and self.is_equal


class KillsSummary(_Part):
    """Counts over kills, and the worst figures; None without any.

    Attributes:
        kills: how many.
        passed: how many are as they should be.
        right_status: of the process that was ended.
        left: by what ``evaluate`` makes of the files.
        resumed: how many were resumed.
        equal: how many are then equal to the whole run.
        by_signal: kills.
        worst_lost_s: the most that is missing.
        worst_difference: the largest.
    """

    kills: int
    passed: int
    right_status: int
    left: dict[Left, int]
    resumed: int
    equal: int
    by_signal: dict[str, int]
    worst_lost_s: float | None
    worst_difference: float | None

    @classmethod
    def of(cls, kills: Sequence[Kill]) -> "KillsSummary":
        """Sum up."""
        lost = [kill.lost_s for kill in kills if kill.lost_s is not None]
        different = [kill.difference for kill in kills if kill.difference is not None]
        lefts: dict[Left, int] = dict.fromkeys(("evaluated", "too short", "no estimate yet", "failed"), 0)
        signals: dict[str, int] = {}
        for kill in kills:
            lefts[kill.left] += 1
            signals[kill.signal] = signals.get(kill.signal, 0) + 1
        return cls(
            kills=len(kills),
            passed=sum(kill.is_passed for kill in kills),
            right_status=sum(kill.is_status_right for kill in kills),
            left=lefts,
            resumed=sum(kill.resumed_status == 0 for kill in kills),
            equal=sum(kill.is_equal for kill in kills),
            by_signal=signals,
            worst_lost_s=max(lost, default=None),
            worst_difference=max(different, default=None),
        )


class KillsRecord(Record):
    """``kills.json``.

    Attributes:
        summary: of all.
        kills: in the order in which they were done.
    """

    next_step: ClassVar[str] = "kill again with `python -m coclo_vio.experiments.kills`"

    schema_version: Literal[1] = 1
    summary: KillsSummary
    kills: tuple[Kill, ...]

    @classmethod
    def of(cls, kills: Sequence[Kill]) -> "KillsRecord":
        """The record of kills."""
        return cls(summary=KillsSummary.of(kills), kills=tuple(kills))

    def by_command(self) -> dict[tuple[str, str], KillsSummary]:
        """The summaries by command and modes."""
        names = dict.fromkeys((kill.command, kill.modes) for kill in self.kills)
        return {
            name: KillsSummary.of([kill for kill in self.kills if (kill.command, kill.modes) == name]) for name in names
        }
