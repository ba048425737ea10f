# SPDX-License-Identifier: BSD-3-Clause
"""The page of ``coclo-vio doctor``: verdicts, sentences, settings and the plots that prove them, in one HTML file."""

from collections.abc import Iterator
from html import escape
from pathlib import Path

from coclo_vio.diagnosis.diagnose import Diagnosis
from coclo_vio.diagnosis.diagnosis_figures import figures
from coclo_vio.evaluation import html_page
from coclo_vio.evaluation.figure_style import NO_FIGURES, can_draw, save_png
from coclo_vio.runs.examination import Examination
from coclo_vio.values.errors import EvaluationError


def write_page(folder: Path, name: str, examination: Examination) -> Path:
    """Write ``diagnosis.html`` and its figures into a folder; returns the page's path.

    Args:
        folder: is made if needed.
        name: of the recording.
        examination: what was found.

    Raises:
        EvaluationError: a file cannot be written.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        parts = list(_parts(folder, examination))
    except OSError as error:
        raise EvaluationError(f"cannot write into {folder}: {error.strerror}; choose another folder") from error
    return html_page.write_page(folder / "diagnosis.html", f"Diagnosis of {name}", parts)


def _parts(folder: Path, examination: Examination) -> Iterator[str]:
    diagnosis = examination.diagnosis
    count = len(examination.findings)
    yield f'<p class="lead">{"Nothing is wrong." if not count else f"{count} findings."}</p>'
    yield "<h2>Stages</h2>"
    yield _stages(diagnosis)
    if examination.settings:
        yield "<h2>Settings that certainly correct something</h2>"
        yield html_page.items(examination.settings)
        left = examination.corrected.findings
        yield f"<p>With them {'nothing is left to correct' if not left else 'this is left'}:</p>"
        yield html_page.items(f"{finding.severity.value}: {finding.sentence}" for finding in left)
    yield "<h2>Figures</h2>"
    if not can_draw():
        yield f"<p>{escape(NO_FIGURES)}</p>"
        return
    yield "<p>As configured.</p>"
    for stem, caption, figure in figures(examination.evidence):
        yield html_page.picture(save_png(figure, folder / f"diagnosis_{stem}.png"), caption)


def _stages(diagnosis: Diagnosis) -> str:
    rows = []
    for stage, checks in diagnosis.checked.items():
        found = diagnosis.of_stage(stage)
        verdict = "error" if any(each.is_error for each in found) else "warning" if found else "good"
        sentences = "<br>".join(escape(f"{each.severity.value}: {each.sentence}") for each in found)
        measured = "; ".join(each.sentence for each in diagnosis.notes if each.stage is stage)
        said = "<br>".join(filter(None, (sentences, escape(measured)))) or escape(", ".join(checks))
        rows.append(html_page.row(stage.value, (verdict, said), kind="text"))
    return html_page.table(("stage", "verdict", "findings, or what was checked"), rows)
