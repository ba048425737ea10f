# SPDX-License-Identifier: BSD-3-Clause
"""The notebook of the examples runs from top to bottom, here over the short leg log."""

from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient

pytestmark = pytest.mark.long

NOTEBOOK = Path(__file__).resolve().parents[2] / "examples" / "quick_start.ipynb"


@pytest.fixture(scope="module")
def executed(leg_log: Path, tmp_path_factory: pytest.TempPathFactory) -> nbformat.NotebookNode:
    notebook = nbformat.read(NOTEBOOK, as_version=4)
    (parameters,) = [cell for cell in notebook.cells if "parameters" in cell.metadata.get("tags", [])]
    assert parameters.source == "path = cv.sample_path()"
    parameters.source = f"path = {str(leg_log)!r}"
    folder = str(tmp_path_factory.mktemp("notebook"))
    return NotebookClient(notebook, timeout=300, resources={"metadata": {"path": folder}}).execute()


def test_the_notebook_runs_and_shows_results(executed: nbformat.NotebookNode) -> None:
    outputs = [output for cell in executed.cells for output in cell.get("outputs", [])]
    text = "".join(output.get("text", "") for output in outputs if output.get("name") == "stdout")
    assert "joints: 301 samples at 100 Hz" in text
    assert "coclo: ATE " in text
    assert "estimates; sigma of the last position" in text
    assert any("image/png" in output.get("data", {}) for output in outputs), "the figure is drawn"


def test_the_notebook_is_kept_without_outputs() -> None:
    kept = nbformat.read(NOTEBOOK, as_version=4)
    nbformat.validate(kept)
    assert [cell.id for cell in kept.cells if cell.get("outputs") or cell.get("execution_count")] == []
