# SPDX-License-Identifier: BSD-3-Clause
"""The tables as Markdown, and as one HTML file with its figures in it that asks nothing of the network."""

import base64
from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

from coclo_vio.experiments.table.text_tables import Grid, grids, sentences

TITLE = "Table I over simulated trials"
_STYLE = """
body { font-family: system-ui, sans-serif; max-width: 72rem; margin: 2rem auto; padding: 0 1rem; color: #222; }
table { border-collapse: collapse; } th, td { padding: .25rem .8rem; border-bottom: 1px solid #ddd; text-align: right; }
th:first-child, td:first-child { text-align: left; } p.caption { color: #555; max-width: 60rem; }
img { max-width: 100%; } pre { background: #f5f5f5; padding: 1rem; white-space: pre-wrap; }
"""


def markdown(table: Mapping[str, Any]) -> str:
    """The page as Markdown.

    Args:
        table: what ``table.json`` holds.
    """
    parts = [f"# {TITLE}", f"`{table['command']}`", *(_markdown_grid(grid) for grid in grids(table["summary"]))]
    parts += ["## The paper's claims", "\n".join(f"* {line}" for line in sentences(table["summary"]["claims"]))]
    parts += [f"## Failures\n\n{lines}" for lines in ["\n".join(f"* {line}" for line in failures(table))] if lines]
    return "\n\n".join(parts) + "\n"


def html(table: Mapping[str, Any], figures: Sequence[Path] = ()) -> str:
    """The page as one HTML file.

    Args:
        table: what ``table.json`` holds.
        figures: PNG files, embedded.
    """
    lists = {"The paper's claims": sentences(table["summary"]["claims"]), "Failures": failures(table)}
    parts = [
        f'<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8"><title>{escape(TITLE)}</title>',
        f"<style>{_STYLE}</style></head><body><h1>{escape(TITLE)}</h1>",
        f"<pre>{escape(table['command'])}</pre>",
        *(_html_grid(grid) for grid in grids(table["summary"])),
        *(_html_list(title, lines) for title, lines in lists.items() if lines),
        *(_html_figure(figure) for figure in figures),
        "</body></html>\n",
    ]
    return "\n".join(parts)


def failures(table: Mapping[str, Any]) -> list[str]:
    """Which estimators failed on which recording, and why."""
    return [
        f"{job['trial']} {job['seed']} {job['variant']}, {name}: {told['failure']}"
        for job in table["jobs"]
        for name, told in job["estimators"].items()
        if told["failure"] is not None
    ]


def _markdown_grid(grid: Grid) -> str:
    def line(cells: Sequence[str]) -> str:
        return f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in cells)} |"

    ruler = f"| --- |{' ---: |' * (len(grid.head) - 1)}"
    lines = [f"## {grid.title}", "", line(grid.head), ruler, *(line(row) for row in grid.rows), "", grid.caption]
    return "\n".join(lines).rstrip()


def _html_grid(grid: Grid) -> str:
    head = "".join(f"<th>{escape(cell)}</th>" for cell in grid.head)
    rows = ("".join(f"<td>{escape(cell)}</td>" for cell in row) for row in grid.rows)
    body = "\n".join(f"<tr>{row}</tr>" for row in rows)
    caption = f'<p class="caption">{escape(grid.caption)}</p>'
    return f"<h2>{escape(grid.title)}</h2><table><tr>{head}</tr>\n{body}</table>{caption}"


def _html_list(title: str, lines: Sequence[str]) -> str:
    return f"<h2>{escape(title)}</h2><ul>{''.join(f'<li>{escape(line)}</li>' for line in lines)}</ul>"


def _html_figure(figure: Path) -> str:
    data = base64.b64encode(figure.read_bytes()).decode("ascii")
    title = figure.stem.replace("_", " ")
    return f'<h2>{escape(title)}</h2><p><img alt="{escape(title)}" src="data:image/png;base64,{data}"></p>'
