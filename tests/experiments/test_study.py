# SPDX-License-Identifier: BSD-3-Clause
"""Results of a study: rows in order, parts of separate runs together, and a later run that continues."""

import json
from pathlib import Path

import pytest

from coclo_vio.experiments.studies.study import ResultFile, Row
from coclo_vio.values.errors import DatasetError


def summary(rows: list[Row]) -> Row:
    return {"modes": sorted({mode for row in rows for mode in row["modes"]})}


def key(row: Row) -> tuple[int, ...]:
    return (row["seed"],)


def row(seed: int, **modes: float) -> Row:
    return {"seed": seed, "modes": modes}


def test_a_later_run_continues_and_the_parts_of_a_row_add_up(tmp_path: Path) -> None:
    path = tmp_path / "new" / "study.json"
    first = ResultFile(path, summary, key, parts="modes")
    first.add(row(2, coclo=0.2))
    first.add(row(1, coclo=0.1))
    later = ResultFile(path, summary, key, parts="modes")
    later.add(row(2, coclo=0.3, vins=0.4))
    rows = [row(1, coclo=0.1), row(2, coclo=0.3, vins=0.4)]
    assert json.loads(path.read_text(encoding="utf-8")) == {"summary": {"modes": ["coclo", "vins"]}, "trials": rows}
    later.add(row(1, vins=0.5))
    assert later.rows[0] == row(1, coclo=0.1, vins=0.5)


def test_without_parts_a_new_row_replaces_the_earlier_one(tmp_path: Path) -> None:
    results = ResultFile(tmp_path / "study.json", summary, key)
    results.add(row(1, coclo=0.1))
    results.add(row(1, vins=0.2))
    assert results.rows == [row(1, vins=0.2)]


@pytest.mark.parametrize("text", ["[]", '{"rows": []}', "no JSON"])
def test_a_file_of_something_else_is_refused_with_the_next_step(text: str, tmp_path: Path) -> None:
    path = tmp_path / "other.json"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(DatasetError, match=r"other\.json.*remove it, or name another file with -o"):
        ResultFile(path, summary, key)
    assert path.read_text(encoding="utf-8") == text
