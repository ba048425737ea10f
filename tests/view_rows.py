# SPDX-License-Identifier: BSD-3-Clause
"""Reads the file of a view back."""

from pathlib import Path

import pytest


def view_rows(path: Path) -> dict[str, list[tuple[int, dict[str, object]]]]:
    """By topic or entity of a file of either view, the stamp (ns) and the components of each row in order."""
    chunk = pytest.importorskip("rerun.chunk")
    is_mcap = path.suffix == ".mcap"
    timeline = "message_log_time" if is_mcap else "time"
    found: dict[str, list[tuple[int, dict[str, object]]]] = {}
    for one in (chunk.McapReader if is_mcap else chunk.RrdReader)(str(path)).stream().to_chunks():
        if timeline not in one.timeline_names:
            continue
        table = one.to_record_batch()
        stamps = table.column(timeline).cast("int64").to_pylist()
        found.setdefault(one.entity_path, []).extend(zip(stamps, table.to_pylist(), strict=True))
    return {name: sorted(each, key=lambda row: row[0]) for name, each in found.items()}
