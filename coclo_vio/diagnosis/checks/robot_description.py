# SPDX-License-Identifier: BSD-3-Clause
"""The robot's description against its URDF: what the URDF says and the description leaves out or says otherwise."""

from collections.abc import Iterator

from coclo_vio.diagnosis.evidence import Evidence
from coclo_vio.diagnosis.finding import Finding, Severity, Stage
from coclo_vio.robot.description_check import check_description

_STREAMS = frozenset({"joints"})


def find_description(evidence: Evidence) -> Iterator[Finding]:
    """What the URDF contradicts in the description; a URDF that is missing or cannot be read among it."""
    if evidence.description is None:
        return
    for found in check_description(evidence.description):
        severity = Severity.ERROR if found.is_error else Severity.WARNING
        yield Finding(f"robot_{found.kind}", Stage.ROBOT, severity, found.sentence, _STREAMS)
