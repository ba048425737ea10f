# SPDX-License-Identifier: BSD-3-Clause
"""All checks of a recording in the order of their stages."""

from collections.abc import Callable, Iterable, Iterator, Set
from dataclasses import dataclass, replace
from enum import IntEnum
from typing import Any

from coclo_vio.diagnosis.evidence import Evidence
from coclo_vio.diagnosis.finding import Finding, Severity, Stage
from coclo_vio.values.errors import CocloError

_COMPOSED = {"axes", "acceleration_sign", "delay_s", "is_swapped"}  # corrections that checks add to what is set


class Cost(IntEnum):
    """What a check needs; a run takes those up to ``SAMPLES``, and a few images."""

    REPORT = 0
    """What is known once the recording was read through: stamps, calibrations, the robot's description."""
    SAMPLES = 1
    """Readings of the first minutes, and a few images."""
    IMAGES = 2
    """Tracks over many images."""


@dataclass(frozen=True, slots=True)
class Check:
    """One check.

    Attributes:
        name: of it, in a diagnosis.
        stage: what it is about.
        cost: what it needs.
        find: what is not as it should be, in a recording; nothing where the recording does not allow the check.
        needs: streams without which there is nothing to check, ``ground_truth`` or ``robot``, separated by blanks, and
            alternatives by ``|``.
    """

    name: str
    stage: Stage
    cost: Cost
    find: Callable[[Evidence], Iterable[Finding]]
    needs: str = ""

    def is_possible(self, there: Set[str]) -> bool:
        """Whether a recording with these contents has what the check needs."""
        return all(there & set(need.split("|")) for need in self.needs.split())


@dataclass(frozen=True, slots=True)
class Diagnosis:
    """What the checks found.

    Attributes:
        checked: names of the checks by stage, in order; those for which the recording has nothing are left out.
        findings: what is not as it should be, in the order of their stages, errors first.
        notes: figures that were measured and are as they should be.
    """

    checked: dict[Stage, tuple[str, ...]]
    findings: tuple[Finding, ...]
    notes: tuple[Finding, ...] = ()

    @property
    def errors(self) -> tuple[Finding, ...]:
        """Those with which a result cannot be right."""
        return tuple(finding for finding in self.findings if finding.is_error)

    @property
    def certain_settings(self) -> tuple[str, ...]:
        """The settings that certainly correct something, each once."""
        certain = (setting for finding in self.findings if finding.is_certain for setting in finding.remedy)
        return tuple(dict.fromkeys(certain))

    def of_stage(self, stage: Stage) -> tuple[Finding, ...]:
        """The findings of a stage."""
        return tuple(finding for finding in self.findings if finding.stage is stage)

    def of_streams(self, streams: Iterable[str]) -> tuple[Finding, ...]:
        """The findings that concern one of these streams."""
        names = set(streams)
        return tuple(finding for finding in self.findings if finding.streams & names)

    def to_json(self) -> dict[str, Any]:
        """The same as plain values, with a verdict for each stage."""
        return {
            "stages": {stage.value: _verdict(self.of_stage(stage)) for stage in self.checked},
            "checks": {stage.value: list(names) for stage, names in self.checked.items()},
            "findings": [finding.to_json() for finding in self.findings],
            "notes": [each.to_json() for each in self.notes],
            "settings": list(self.certain_settings),
        }


def diagnose(evidence: Evidence, checks: Iterable[Check], most: Cost = Cost.IMAGES) -> Diagnosis:
    """Carry out checks on a recording.

    Args:
        evidence: the recording.
        checks: which.
        most: those that need more are left out.
    """
    there = _contents(evidence)
    affordable = [check for check in checks if check.cost <= most and check.is_possible(there)]
    stages = [stage for stage in Stage if any(check.stage is stage for check in affordable)]
    checked = {stage: tuple(check.name for check in affordable if check.stage is stage) for stage in stages}
    found = [finding for check in affordable for finding in _found(check, evidence)]
    order = list(Stage)
    found.sort(key=lambda finding: (order.index(finding.stage), not finding.is_error))
    once = dict.fromkeys(found)
    notes = tuple(each for each in once if each.severity is Severity.NOTE)
    return Diagnosis(checked, tuple(each for each in once if each.severity is not Severity.NOTE), notes)


def _contents(evidence: Evidence) -> set[str]:
    """What a recording has, by the names that checks need."""
    streams = set(evidence.first_stamps_ns)
    has_truth, has_robot = evidence.truth is not None, evidence.description is not None
    return streams | ({"ground_truth"} if has_truth else set()) | ({"robot"} if has_robot else set())


def _found(check: Check, evidence: Evidence) -> Iterator[Finding]:
    try:
        for finding in check.find(evidence):
            yield _beside_corrections(finding, evidence)
    except CocloError:  # what cannot be read is reported by inspection and run
        return


def _beside_corrections(finding: Finding, evidence: Evidence) -> Finding:
    """The finding without a remedy that would replace another correction of the same key."""
    taken = {
        key: value
        for key in (setting.partition("=")[0] for setting in finding.remedy)
        if key.rpartition(".")[2] not in _COMPOSED and (value := _configured(key, evidence)) is not None
    }
    if not taken:
        return finding
    listed = " and ".join(f"{key}={value}" for key, value in taken.items())
    sentence = f"{finding.sentence}; beside {listed}, which is set already: correct that"
    return replace(finding, sentence=sentence, remedy=(), is_certain=False)


def _configured(key: str, evidence: Evidence) -> object | None:
    """The value of a correction where it is not the default; None elsewhere."""
    if not key.startswith("dataset.corrections."):
        return None
    values: object = evidence.corrections.model_dump(exclude_defaults=True)
    for part in key.split(".")[2:]:
        values = values.get(part) if isinstance(values, dict) else None
    return values


def _verdict(findings: tuple[Finding, ...]) -> str:
    if any(finding.is_error for finding in findings):
        return "error"
    return "warning" if findings else "good"
