# SPDX-License-Identifier: BSD-3-Clause
"""``python -m coclo_vio.experiments.results [--measure demo,go1,speed]``: measure, then write results into pages."""

import argparse
import sys
from pathlib import Path

from coclo_vio.experiments.results.measuring import MEASURED, measure
from coclo_vio.experiments.results.pages import render
from coclo_vio.values.errors import CocloError


def main() -> None:
    """Measure what is named, then write all pages."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--measure", default="", help=f"some of {','.join(MEASURED)}, separated by commas")
    names = [name for name in parser.parse_args().measure.split(",") if name]
    unknown = [name for name in names if name not in MEASURED]
    if unknown:
        parser.error(f"cannot measure {unknown[0]!r}; there are: {', '.join(MEASURED)}")
    root = Path.cwd()
    try:
        for name in names:
            print(f"measuring {name}", file=sys.stderr)
            measure(name, root)
        for page in render(root):
            print(f"wrote {page}")
    except CocloError as error:
        sys.exit(f"results: {error}")


if __name__ == "__main__":
    main()
