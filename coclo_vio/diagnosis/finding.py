# SPDX-License-Identifier: BSD-3-Clause
"""What a check finds: a sentence with the value, what it should be, and what to set."""

from dataclasses import dataclass
from enum import Enum
from typing import Any


class Stage(Enum):
    """What a check is about; a diagnosis goes through them in this order."""

    STREAMS = "streams"
    ROBOT = "robot"
    CLOCKS = "clocks"
    IMU = "imu"
    JOINTS = "joints"
    CONTACT = "contact"
    CAMERAS = "cameras"
    MOUNTING = "mounting"
    GROUND_TRUTH = "ground truth"


class Severity(Enum):
    """What a finding means for a result."""

    ERROR = "error"
    """The result of a mode that reads these streams cannot be right."""
    WARNING = "warning"
    """The result may be worse than it could be, or the check is not certain."""
    NOTE = "note"
    """A figure that was measured and is as it should be."""


@dataclass(frozen=True, slots=True)
class Finding:
    """Something that is not as it should be.

    Attributes:
        kind: a short name for programs, such as ``imu_acceleration_unit``.
        stage: what it is about.
        severity: what it means for a result.
        sentence: the value, what it should be, and what to do.
        streams: the streams whose readings are concerned (names of ``STREAM_NAMES``), or ``ground_truth``; a mode that
            reads one of them is concerned.
        remedy: settings (``a.b=value``) that correct it; none where there is none.
        is_certain: whether the remedy follows from the recording without doubt, so that it can be written.
    """

    kind: str
    stage: Stage
    severity: Severity
    sentence: str
    streams: frozenset[str]
    remedy: tuple[str, ...] = ()
    is_certain: bool = False

    @property
    def is_error(self) -> bool:
        """Whether a result cannot be right."""
        return self.severity is Severity.ERROR

    def to_json(self) -> dict[str, Any]:
        """The same as plain values."""
        return {
            "kind": self.kind,
            "stage": self.stage.value,
            "severity": self.severity.value,
            "sentence": self.sentence,
            "streams": sorted(self.streams),
            "remedy": list(self.remedy),
            "is_certain": self.is_certain,
        }


def error(kind: str, stage: Stage, streams: str, sentence: str, *remedy: str, is_certain: bool = False) -> Finding:
    """A finding with which a result cannot be right; ``streams`` are names separated by blanks."""
    return Finding(kind, stage, Severity.ERROR, sentence, frozenset(streams.split()), remedy, is_certain)


def warning(kind: str, stage: Stage, streams: str, sentence: str, *remedy: str, is_certain: bool = False) -> Finding:
    """A finding that makes a result doubtful or worse; ``streams`` are names separated by blanks."""
    return Finding(kind, stage, Severity.WARNING, sentence, frozenset(streams.split()), remedy, is_certain)


def note(kind: str, stage: Stage, streams: str, sentence: str) -> Finding:
    """A measured figure that is as it should be; ``streams`` are names separated by blanks."""
    return Finding(kind, stage, Severity.NOTE, sentence, frozenset(streams.split()))
