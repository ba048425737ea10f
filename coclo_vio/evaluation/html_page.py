# SPDX-License-Identifier: BSD-3-Clause
"""The parts of a page in one HTML file that loads nothing from the network: frame, tables, lists, pictures."""

import base64
from collections.abc import Iterable, Sequence
from html import escape
from pathlib import Path

from coclo_vio.values.errors import EvaluationError
from coclo_vio.values.whole_files import write_whole

_STYLE = """
body { font-family: system-ui, sans-serif; max-width: 70rem; margin: 2rem auto; padding: 0 1rem; color: #222;
  line-height: 1.45; }
h1 { margin-bottom: .3rem; } h2 { margin-top: 2.2rem; border-bottom: 1px solid #ccc; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; }
th, td { padding: .25rem .8rem; border-bottom: 1px solid #ddd; text-align: right; vertical-align: top; }
th:first-child, td:first-child, tr.text td { text-align: left; }
td.best { font-weight: bold; } tr.paper { color: #666; }
img { max-width: 100%; } figure { margin: 1rem 0 2rem; } figcaption { color: #555; }
summary { cursor: pointer; margin: .6rem 0; } pre { background: #f5f5f5; padding: 1rem; overflow-x: auto; }
.lead { font-size: 1.1rem; }
p, li, figcaption, td { overflow-wrap: break-word; }
div.scroll { overflow-x: auto; }
div.zoomable { width: 100%; }
#trajectories { position: sticky; top: 0; z-index: 5; background: #fffffff0; padding: .3rem 0; font-size: .9rem; }
#trajectories label { display: inline-block; margin-right: .9rem; white-space: nowrap; }
.swatch { display: inline-block; width: .9em; height: .9em; margin: 0 .3em; vertical-align: -.1em; }
@media (max-width: 40rem) {
  body { margin: .6rem auto; padding: 0 .6rem; } h1 { font-size: 1.4rem; } table { font-size: .85rem; }
  th, td { padding: .25rem .4rem; }
  table.numbers th:first-child, table.numbers td:first-child { position: sticky; left: 0; background: #fff;
    min-width: 8rem; max-width: 9rem; }
  tr.text td:last-child { min-width: 14rem; } #trajectories { font-size: .8rem; }
}
"""


def write_page(path: Path, title: str, parts: Iterable[str]) -> Path:
    """Write a page of these parts, which are HTML, under its title, which is not; returns the path.

    Raises:
        EvaluationError: the file cannot be written.
    """
    text = "\n".join(
        (
            f'<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
            f'<meta name="viewport" content="width=device-width, initial-scale=1"><title>{escape(title)}</title>',
            f"<style>{_STYLE}</style></head><body><h1>{escape(title)}</h1>",
            *parts,
            "</body></html>\n",
        )
    )
    try:
        write_whole(path, text)
    except OSError as error:
        raise EvaluationError(f"cannot write the report {path}: {error.strerror}; choose another place") from error
    return path


def table(head: Sequence[str], rows: Iterable[str]) -> str:
    """A table with these column heads and rows of ``row``; on a narrow screen it scrolls, its first column stays."""
    cells = "".join(f"<th>{escape(text)}</th>" for text in head)
    kind = "" if head[0] else ' class="numbers"'
    return "\n".join((f'<div class="scroll"><table{kind}><tr>{cells}</tr>', *rows, "</table></div>"))


def row(label: str, cells: Iterable[str], *, best: Iterable[int] = (), kind: str = "") -> str:
    """A row of a table.

    Args:
        label: its first cell, plain text.
        cells: the others, HTML.
        best: indices of cells in bold.
        kind: class of the row.
    """
    marked = set(best)
    columns = "".join(
        f'<td class="best">{cell}</td>' if index in marked else f"<td>{cell}</td>" for index, cell in enumerate(cells)
    )
    named = f' class="{kind}"' if kind else ""
    return f"<tr{named}><td>{escape(label)}</td>{columns}</tr>"


def number(value: object, decimals: int) -> str:
    """A number with so many decimals, a dash where there is none."""
    return f"{value:.{decimals}f}" if isinstance(value, int | float) else "&ndash;"


def items(lines: Iterable[str]) -> str:
    """A list of plain sentences; empty where there is none."""
    points = "".join(f"<li>{escape(line)}</li>" for line in lines)
    return f"<ul>{points}</ul>" if points else ""


def folded(title: str, inner: str) -> str:
    """A part that is closed until the reader opens it."""
    return f"<details><summary>{escape(title)}</summary>{inner}</details>"


def picture(file: Path, caption: str = "") -> str:
    """A PNG file, embedded, with its caption.

    Raises:
        EvaluationError: it cannot be read.
    """
    try:
        data = base64.b64encode(file.read_bytes()).decode("ascii")
    except OSError as error:
        raise EvaluationError(f"cannot read the figure {file}: {error.strerror}; draw it first") from error
    below = f"<figcaption>{escape(caption)}</figcaption>" if caption else ""
    return f'<figure><img alt="{escape(file.stem)}" src="data:image/png;base64,{data}">{below}</figure>'
