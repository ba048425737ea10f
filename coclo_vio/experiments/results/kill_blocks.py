# SPDX-License-Identifier: BSD-3-Clause
"""Kills as Markdown, with their origin."""

from collections.abc import Callable, Mapping

from coclo_vio.experiments.kills.kill_record import KillsRecord
from coclo_vio.experiments.kills.kill_text import HEAD, amiss_lines, rows, summary_sentence
from coclo_vio.experiments.results.result_files import ResultFiles, markdown_table

_FILE = "kills.json"


def _kills(files: ResultFiles) -> str:
    """Counts by command, and what was not as it should be."""
    record = KillsRecord.read(files.folder / _FILE)
    parts = [summary_sentence(record), markdown_table(HEAD, rows(record)), "\n".join(amiss_lines(record))]
    return "\n\n".join([*filter(None, parts), files.origin(_FILE)])


KILL_BLOCKS: Mapping[str, Callable[[ResultFiles], str]] = {"kills": _kills}
"""What the page on interrupted runs can show, by name."""
