# SPDX-License-Identifier: BSD-3-Clause
"""Results on pages are those of the files, and every file has its origin."""

from pathlib import Path

import pytest

from coclo_vio.experiments.results.blocks import BLOCKS
from coclo_vio.experiments.results.pages import PAGES, rendered
from coclo_vio.experiments.results.provenance import Provenance, Provenances
from coclo_vio.experiments.results.result_files import ResultFiles
from coclo_vio.values.errors import DatasetError

_ROOT = Path(__file__).resolve().parents[2]
_FILES = ResultFiles(_ROOT / "docs" / "results")


@pytest.mark.parametrize("page", PAGES, ids=str)
def test_a_page_shows_what_its_files_hold(page: Path) -> None:
    text = (_ROOT / page).read_text(encoding="utf-8")
    assert rendered(text, _FILES) == text, "write the results into the pages: make results MEASURE="


def test_every_block_is_shown_somewhere() -> None:
    shown = "".join((_ROOT / page).read_text(encoding="utf-8") for page in PAGES)
    assert [name for name in BLOCKS if f"<!-- results: {name} -->" not in shown] == []


def test_every_file_of_results_has_its_origin() -> None:
    folder = _ROOT / "docs" / "results"
    noted = Provenances.read(folder / "provenance.json").root
    assert {file.name for file in folder.glob("*.json")} - {"provenance.json"} == set(noted)
    for name, origin in noted.items():
        assert origin.commit
        assert origin.date.startswith("20"), name
        assert not origin.commit.endswith("+"), f"{name} was measured with changes that were not committed"


def test_another_number_in_a_file_changes_the_page(tmp_path: Path) -> None:
    origin = Provenance(commit="abc1234", date="2026-01-02", machine="one", versions={}, command="a command")
    Provenances({"demo.json": origin}).write(tmp_path / "provenance.json")
    (tmp_path / "demo.json").write_text('{"printed": "drift 0.5"}', encoding="utf-8")
    page = "before\n<!-- results: demo -->\nold\n<!-- end of results -->\nafter"
    written = rendered(page, ResultFiles(tmp_path))
    assert "drift 0.5" in written
    assert "Commit abc1234, 2026-01-02, one: `a command`" in written
    assert "old" not in written
    assert written.startswith("before\n")
    assert written.endswith("\nafter")
    assert rendered(written, ResultFiles(tmp_path)) == written


def test_an_unknown_place_names_those_there_are(tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match="'speeed'; there are: bench"):
        rendered("<!-- results: speeed -->\n<!-- end of results -->", ResultFiles(tmp_path))


def test_a_file_without_origin_is_refused(tmp_path: Path) -> None:
    Provenances({}).write(tmp_path / "provenance.json")
    (tmp_path / "demo.json").write_text('{"printed": ""}', encoding="utf-8")
    with pytest.raises(DatasetError, match=r"no entry for demo\.json; measure again"):
        rendered("<!-- results: demo -->\n<!-- end of results -->", ResultFiles(tmp_path))
