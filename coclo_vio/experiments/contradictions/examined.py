# SPDX-License-Identifier: BSD-3-Clause
"""What inspect, run and doctor say of one member, by their exit status and the finding that names it."""

from pathlib import Path
from typing import Any

from coclo_vio.datasets.dataset import open_dataset
from coclo_vio.experiments.contradictions.content import sample_content
from coclo_vio.experiments.contradictions.members import Member
from coclo_vio.runs.examination import examine
from coclo_vio.runs.inspection import resolve_if_known
from coclo_vio.runs.preflight import preflight
from coclo_vio.runs.run_config import RunConfig
from coclo_vio.runs.running import run_modes
from coclo_vio.values.errors import CocloError, ConfigError

_OF_CAMERAS = frozenset({"stereo", "stereo_tracks", "camera_imu"})


def examined(member: Member, folder: Path) -> dict[str, Any]:
    """Write a member into a folder and examine it.

    Args:
        member: which.
        folder: an empty one.

    Returns:
        Plain values: kind, name and form of the member; ``says``: the sentence that names it; ``is_named``: whether
        there is one; ``severity``; ``settings``: what certainly corrects it; ``run`` and ``doctor``: exit status.
    """
    content = member.change(sample_content(has_frames=member.needs_images))
    path = member.write(content, folder / "recording")
    row: dict[str, Any] = {"kind": member.kind, "name": member.name, "form": member.form}
    try:
        config, _ = resolve_if_known(path, content.description or content.robot, None, ())
        examination = examine(path, config)
        dataset = open_dataset(path, config.robot, config.dataset)
        inspected = {finding.kind for finding in preflight(dataset, config).findings}
    except CocloError as error:
        return {**row, "says": str(error), "is_named": True, "severity": "refused", "settings": [], **_REFUSED}
    named = [finding for finding in examination.findings if finding.kind == member.finding]
    finding = named[0] if named else None
    return {
        **row,
        "says": "" if finding is None else finding.sentence,
        "is_named": finding is not None,
        "severity": "" if finding is None else finding.severity.value,
        "settings": list(examination.settings),
        "inspect": "named" if member.finding in inspected else "only by doctor",
        "run": _status(path, config, folder, streams=frozenset() if finding is None else finding.streams),
        "doctor": int(bool(examination.diagnosis.errors)),
    }


_REFUSED = {"inspect": "refused", "run": 1, "doctor": 1}


def _status(path: Path, config: RunConfig, folder: Path, streams: frozenset[str]) -> int:
    """The exit status of a run of the mode that the finding concerns."""
    mode = "vins" if streams and streams <= _OF_CAMERAS else "coclo"
    try:
        record = run_modes(path, (mode,), config, folder / "out")
    except ConfigError:
        return 2
    except CocloError:
        return 1
    first = next(iter(record.estimators.values()))
    return int(bool(first.failure) or not first.estimates)
