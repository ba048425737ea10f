# SPDX-License-Identifier: BSD-3-Clause
"""Writes results into pages, between ``<!-- results: NAME -->`` and ``<!-- end of results -->``."""

import re
from collections.abc import Callable
from pathlib import Path

from coclo_vio.experiments.results.blocks import BLOCKS
from coclo_vio.experiments.results.result_files import ResultFiles
from coclo_vio.values.errors import DatasetError, listing

PAGES = (
    Path("README.md"),
    Path("docs") / "results.md",
    Path("docs") / "index.md",
    Path("docs") / "performance.md",
    Path("docs") / "grid.md",
    Path("docs") / "legged.md",
    Path("docs") / "diagnosis.md",
    Path("docs") / "faults.md",
    Path("docs") / "interrupted_runs.md",
)
_PLACE = re.compile(r"<!-- results: (?P<name>[a-z0-9_]+) -->\n.*?<!-- end of results -->", re.DOTALL)


def rendered(page: str, files: ResultFiles) -> str:
    """A page with every block of results as the files have it.

    Args:
        page: its text.
        files: the measured results.

    Raises:
        DatasetError: a place for a result that there is not, or a file is missing or malformed.
    """

    def fill(match: re.Match[str]) -> str:
        name = match["name"]
        block: Callable[[ResultFiles], str] | None = BLOCKS.get(name)
        if block is None:
            raise DatasetError(f"a page has a place for results {name!r}; there are: {listing(BLOCKS)}")
        return f"<!-- results: {name} -->\n{block(files).strip()}\n<!-- end of results -->"

    return _PLACE.sub(fill, page)


def render(root: Path) -> list[Path]:
    """Write the results into all pages; the pages that changed.

    Args:
        root: of the checkout.

    Raises:
        DatasetError: a file of results is missing or malformed.
    """
    changed = []
    for name in PAGES:
        path = root / name
        before = path.read_text(encoding="utf-8")
        after = rendered(before, ResultFiles(root / "docs" / "results"))
        if after != before:
            path.write_text(after, encoding="utf-8")
            changed.append(path)
    return changed
