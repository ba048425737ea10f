# SPDX-License-Identifier: BSD-3-Clause
"""The index page of several recordings: a table in the form of the paper's Table I, then each recording with a link."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from urllib.parse import quote

from coclo_vio.evaluation import html_page
from coclo_vio.evaluation.html_report import ranking_list
from coclo_vio.evaluation.paper_table import PAPER_MARK
from coclo_vio.evaluation.ranking import Ranking
from coclo_vio.evaluation.table_one import TableOne


@dataclass(frozen=True, slots=True)
class Entry:
    """One recording of a page over several.

    Attributes:
        report: its own report, relative to the page.
        summary: the result in sentences.
        rankings: of its trajectories.
        picture: a PNG file to show; None where there is none.
    """

    report: str
    summary: Sequence[str] = ()
    rankings: Sequence[Ranking] = ()
    picture: Path | None = None


def write_index(path: Path, title: str, table: TableOne, entries: Mapping[str, Entry]) -> Path:
    """Write the page and return its path.

    Args:
        path: HTML file to write.
        title: of the page.
        table: of all recordings.
        entries: by recording.

    Raises:
        EvaluationError: a picture cannot be read, or the page cannot be written.
    """
    rows = (
        html_page.row(
            f"{row.name} ({PAPER_MARK})" if row.is_paper else row.name,
            (escape(str(cell)) for cell in row.cells),
            kind="paper" if row.is_paper else "",
        )
        for row in table.rows
    )
    meaning = "Drift in percent of the path length / median RPE in percent per metre."
    if any(row.is_paper for row in table.rows):
        meaning += " The paper's drift is of the net displacement, one recording a trial; it gives no RPE."
    parts = [html_page.table(("", *table.headers), rows), f"<p>{meaning}</p>"]
    for name, entry in entries.items():
        parts += [
            f'<h2><a href="{quote(entry.report)}">{escape(name)}</a></h2>',
            *(f"<p>{escape(sentence)}</p>" for sentence in entry.summary),
            ranking_list(entry.rankings, ""),
            *((html_page.picture(entry.picture),) if entry.picture is not None else ()),
        ]
    return html_page.write_page(path, title, parts)
