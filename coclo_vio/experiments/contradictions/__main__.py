# SPDX-License-Identifier: BSD-3-Clause
"""The table of contradictions: ``python -m coclo_vio.experiments.contradictions [-o FILE] [--publish]``.

Each member is written from the bundled sample and given to inspect, run and doctor; what they say goes into a JSON
file. With ``--publish`` the file is docs/results/contradictions.json, and the page is written anew.
"""

import argparse
import json
import sys
import tempfile
from pathlib import Path

from coclo_vio.experiments.contradictions.examined import examined
from coclo_vio.experiments.contradictions.members import MEMBERS
from coclo_vio.experiments.results.pages import render
from coclo_vio.experiments.results.provenance import Provenance, Provenances

_COMMAND = "python -m coclo_vio.experiments.contradictions --publish"


def main() -> None:
    """Make the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-o", "--output", type=Path, default=Path("out") / "contradictions.json")
    parser.add_argument("--publish", action="store_true", help="into docs/results, with the page")
    arguments = parser.parse_args()
    root = Path.cwd()
    results = root / "docs" / "results"
    output = results / "contradictions.json" if arguments.publish else arguments.output
    rows = []
    for member in MEMBERS:
        with tempfile.TemporaryDirectory() as folder:
            row = examined(member, Path(folder))
        rows.append(row)
        sys.stdout.write(f"{row['kind']}, {row['name']} ({row['form']}): {row['says']}\n")
    output.parent.mkdir(parents=True, exist_ok=True)
    output.write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")
    if arguments.publish:
        origins = Provenances.read(results / "provenance.json")
        entry = Provenance.now(_COMMAND, root)
        origins.with_entry(output.name, entry).write(results / "provenance.json")
        render(root)
    silent = [row["name"] for row in rows if not row["is_named"]]
    sys.exit(f"not named: {', '.join(silent)}" if silent else 0)


if __name__ == "__main__":
    main()
