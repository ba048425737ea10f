# SPDX-License-Identifier: BSD-3-Clause
"""A full diagnosis of a recording, again with what it certainly corrects: the content of ``coclo-vio doctor``."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from coclo_vio.datasets.dataset import Dataset, open_dataset
from coclo_vio.diagnosis.all_checks import CHECKS
from coclo_vio.diagnosis.diagnose import Cost, Diagnosis, diagnose
from coclo_vio.diagnosis.evidence import Evidence
from coclo_vio.diagnosis.finding import Finding
from coclo_vio.runs.preflight import evidence_of
from coclo_vio.runs.run_config import RunConfig
from coclo_vio.values.config import merged, parse_settings, read_yaml
from coclo_vio.values.errors import ConfigError, TopicNotFound

_SECONDS = 120.0  # of the recording that are looked at
_MOST_ROUNDS = 3


@dataclass(frozen=True, slots=True, eq=False)
class Examination:
    """What a full diagnosis found.

    Attributes:
        diagnosis: of the recording as it is configured.
        settings: what certainly corrects something of it, in the order in which it was found.
        corrected: the diagnosis with these settings; the first one where there are none.
        evidence: the recording as it is configured.
        corrected_evidence: the same with the settings.
    """

    diagnosis: Diagnosis
    settings: tuple[str, ...]
    corrected: Diagnosis
    evidence: Evidence
    corrected_evidence: Evidence

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What was found as configured, and what only came to light with the settings."""
        kinds = {finding.kind for finding in self.diagnosis.findings}
        return (*self.diagnosis.findings, *(each for each in self.corrected.findings if each.kind not in kinds))

    def to_json(self) -> dict[str, Any]:
        """The same as plain values."""
        return {
            **self.diagnosis.to_json(),
            "settings": list(self.settings),
            "with_settings": self.corrected.to_json() if self.settings else None,
        }


def examine(path: Path, config: RunConfig) -> Examination:
    """Carry out all checks on a recording, then again with the settings that certainly correct something.

    Args:
        path: the recording.
        config: resolved configuration.

    Raises:
        DatasetError: no recording, or one that cannot be read at all.
    """
    evidence = _evidence(path, config)
    first = diagnose(evidence, CHECKS, Cost.IMAGES)
    settings: tuple[str, ...] = ()
    latest, latest_evidence = first, evidence
    for _ in range(_MOST_ROUNDS):
        further = tuple(each for each in latest.certain_settings if each not in settings)
        if not further:
            break
        settings = _without_replaced(settings, further)
        latest_evidence = _evidence(path, config.with_settings(settings))
        latest = diagnose(latest_evidence, CHECKS, Cost.IMAGES)
    return Examination(first, settings, latest, evidence, latest_evidence)


def _without_replaced(settings: tuple[str, ...], further: tuple[str, ...]) -> tuple[str, ...]:
    """The settings with further ones, the later in place of an earlier one of the same key."""
    keys = {setting.partition("=")[0] for setting in further}
    return (*(each for each in settings if each.partition("=")[0] not in keys), *further)


def _evidence(path: Path, config: RunConfig) -> Evidence:
    return evidence_of(_opened(path, config), config, _SECONDS)


def _opened(path: Path, config: RunConfig) -> Dataset:
    """The recording; in part where it lacks joints of the robot."""
    try:
        return open_dataset(path, config.robot, config.dataset)
    except TopicNotFound:
        return open_dataset(path, None, config.dataset)


def write_settings(path: Path, settings: tuple[str, ...]) -> Path:
    """Add settings to a YAML configuration, which is made where there is none; returns its path.

    Raises:
        ConfigError: the file cannot be read or written, or is not YAML.
    """
    values = read_yaml(path) if path.exists() else {}
    changed = merged(values, parse_settings(settings))
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(yaml.safe_dump(changed, sort_keys=False), encoding="utf-8")
    except OSError as error:
        raise ConfigError(f"cannot write {path}: {error.strerror}; choose another file for --fix") from error
    return path
