# SPDX-License-Identifier: BSD-3-Clause
"""The tables as Markdown, and as one HTML file with its figures in it that loads nothing from the network."""

import base64
from collections.abc import Sequence
from html import escape
from pathlib import Path

from coclo_vio.experiments.table.table_record import TableRecord
from coclo_vio.experiments.table.text_tables import TextTable, text_tables

TITLE = "Table I over simulated trials"
_AGAINST_THE_PAPER = "Against the paper"
_STYLE = """
body { font-family: system-ui, sans-serif; max-width: 72rem; margin: 2rem auto; padding: 0 1rem; color: #222; }
table { border-collapse: collapse; } th, td { padding: .25rem .8rem; border-bottom: 1px solid #ddd; text-align: right; }
th:first-child, td:first-child { text-align: left; } p.caption { color: #555; max-width: 60rem; }
img { max-width: 100%; } pre { background: #f5f5f5; padding: 1rem; white-space: pre-wrap; }
"""


def markdown(table: TableRecord) -> str:
    """The page as Markdown.

    Args:
        table: the content of ``table.json``.
    """
    parts = [f"# {TITLE}", f"`{table.command}`", *(_markdown_table(each) for each in text_tables(table.summary))]
    parts += [f"## {_AGAINST_THE_PAPER}", "\n".join(f"* {line}" for line in against_the_paper(table))]
    parts += [f"## Failures\n\n{lines}" for lines in ["\n".join(f"* {line}" for line in failures(table))] if lines]
    return "\n\n".join(parts) + "\n"


def html(table: TableRecord, figures: Sequence[Path] = ()) -> str:
    """The page as one HTML file.

    Args:
        table: the content of ``table.json``.
        figures: PNG files, embedded.
    """
    lists = {_AGAINST_THE_PAPER: against_the_paper(table), "Failures": failures(table)}
    parts = [
        f'<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8"><title>{escape(TITLE)}</title>',
        f"<style>{_STYLE}</style></head><body><h1>{escape(TITLE)}</h1>",
        f"<pre>{escape(table.command)}</pre>",
        *(_html_table(each) for each in text_tables(table.summary)),
        *(_html_list(title, lines) for title, lines in lists.items() if lines),
        *(_html_figure(figure) for figure in figures),
        "</body></html>\n",
    ]
    return "\n".join(parts)


def against_the_paper(table: TableRecord) -> list[str]:
    """The comparisons with the paper in sentences."""
    return [comparison.sentence for comparison in table.summary.against_the_paper]


def failures(table: TableRecord) -> list[str]:
    """Which trajectories failed on which recording, and why."""
    return [
        f"{job.trial} {job.seed} {job.variant}, {name}: {trajectory.failure}"
        for job in table.jobs
        for name, trajectory in job.estimators.items()
        if trajectory.failure is not None
    ]


def _markdown_table(table: TextTable) -> str:
    def line(cells: Sequence[str]) -> str:
        return f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in cells)} |"

    ruler = f"| --- |{' ---: |' * (len(table.head) - 1)}"
    lines = [f"## {table.title}", "", line(table.head), ruler, *(line(row) for row in table.rows), "", table.caption]
    return "\n".join(lines).rstrip()


def _html_table(table: TextTable) -> str:
    head = "".join(f"<th>{escape(cell)}</th>" for cell in table.head)
    rows = ("".join(f"<td>{escape(cell)}</td>" for cell in row) for row in table.rows)
    body = "\n".join(f"<tr>{row}</tr>" for row in rows)
    caption = f'<p class="caption">{escape(table.caption)}</p>'
    return f"<h2>{escape(table.title)}</h2><table><tr>{head}</tr>\n{body}</table>{caption}"


def _html_list(title: str, lines: Sequence[str]) -> str:
    return f"<h2>{escape(title)}</h2><ul>{''.join(f'<li>{escape(line)}</li>' for line in lines)}</ul>"


def _html_figure(figure: Path) -> str:
    data = base64.b64encode(figure.read_bytes()).decode("ascii")
    title = figure.stem.replace("_", " ")
    return f'<h2>{escape(title)}</h2><p><img alt="{escape(title)}" src="data:image/png;base64,{data}"></p>'
