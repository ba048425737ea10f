# SPDX-License-Identifier: BSD-3-Clause
"""The report of one recording: what came out, the picture, numbers, claims, figures, events, notes, configuration."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path

import yaml

from coclo_vio.evaluation import html_page
from coclo_vio.evaluation.evaluation import Evaluation
from coclo_vio.evaluation.notes import merged_notes
from coclo_vio.evaluation.ranking import Claim, what_can_be_told

_ROWS = (
    ("drift_percent", "Drift of path length", "%", 2),
    ("rpe_1m_percent", "RPE over 1 m, median", "%", 2),
    ("ate_m", "ATE", "m", 4),
    ("ate_planar_m", "ATE in the plane", "m", 4),
    ("paper_drift_percent", "Drift, paper's definition", "%", 2),
    ("velocity_rmse_mps", "Velocity RMSE", "m/s", 3),
    ("yaw_drift_deg", "Yaw drift", "deg", 2),
    ("path_length_ratio", "Path of the estimate / ground truth", "", 3),
    ("anees_pose", "ANEES of the pose (1 is honest)", "", 2),
    ("realtime_factor", "Times real time", "", 1),
)
_FURTHER_ROWS = (
    ("path_length_m", "Path of the ground truth", "m", 2),
    ("coverage", "Coverage", "", 3),
    ("clock_offset_s", "Clock offset", "s", 4),
    ("clock_rate_hz", "Rate of the ground truth", "Hz", 3),
    ("clock_correlation", "Agreement of angular velocities", "", 3),
    ("clock_residual_deg", "Attitude residual on that clock", "deg", 2),
)
_LESS_IS_BETTER = {
    *("drift_percent", "rpe_1m_percent", "ate_m", "ate_planar_m", "paper_drift_percent", "velocity_rmse_mps"),
    "yaw_drift_deg",
}
_CAPTIONS = {
    "overview": "The way, and how far each estimate is from ground truth (averaged over 0.3 s). Estimates are tied to "
    "ground truth at the start only.",
    "path": "The way from above, to scale, and from the side, its height not to scale.",
    "positions": "Position over time: alone on the left, legs and eyes together on the right.",
    "velocities": "Velocity in the world, of a long recording 20 s from its middle. That of ground truth is the slope "
    "of its positions over 0.25 s, so it misses the tops of short peaks.",
    "position_error": "Distance to ground truth over time, averaged over 0.3 s; lines across mark events.",
    "error_bands": "Error along each axis in the band of three sigmas that the filter itself gives, ground truth's "
    "noise included. An honest filter leaves it in 0.3 % of the time; a much wider band is too careful.",
    "keyframes": "What the eyes see: tracked points and what is left of their reprojection errors; lines across mark "
    "events.",
    "contacts": "Which feet stand.",
}


@dataclass(frozen=True, slots=True)
class Lived:
    """Something that happened to an estimator.

    Attributes:
        time_s: since the recording began, s.
        who: the mode.
        kind: one word.
        detail: a sentence.
    """

    time_s: float
    who: str
    kind: str
    detail: str


def write_report(
    path: Path,
    title: str,
    evaluations: Mapping[str, Evaluation],
    figures: Sequence[Path] = (),
    configuration: Mapping[str, object] | None = None,
    *,
    summary: Sequence[str] = (),
    claims: Sequence[Claim] = (),
    events: Sequence[Lived] = (),
) -> Path:
    """Write the report and return its path.

    Args:
        path: HTML file to write.
        title: of the page, such as the name of the data set.
        evaluations: by name of the estimator; a column each.
        figures: PNG files, embedded; the first one leads.
        configuration: plain values as resolved for the run, shown as YAML.
        summary: what a reader should know first, in sentences.
        claims: what the recording says of the paper's claims.
        events: what the estimators lived through.

    Raises:
        EvaluationError: a figure cannot be read, or the report cannot be written.
    """
    parts = [
        *(f'<p class="lead">{escape(sentence)}</p>' for sentence in summary),
        *(_figure(figure) for figure in figures[:1]),
        "<h2>Numbers</h2>",
        numbers_table(evaluations),
        claims_list(claims, "<h2>What this recording says</h2>"),
        *(("<h2>Figures</h2>", *(_figure(figure) for figure in figures[1:])) if figures[1:] else ()),
        _events(events),
        _notes(evaluations),
    ]
    if configuration:
        text = yaml.safe_dump(dict(configuration), sort_keys=False)
        parts.append(
            f"<h2>Configuration</h2>{html_page.folded('as resolved for this run', f'<pre>{escape(text)}</pre>')}"
        )
    return html_page.write_page(path, title, parts)


def numbers_table(evaluations: Mapping[str, Evaluation]) -> str:
    """All numbers, a column each estimator; clock and coverage folded away."""
    columns = [evaluation.to_json() for evaluation in evaluations.values()]
    head = ("", *evaluations)
    lengths = sorted({length for evaluation in evaluations.values() for length in evaluation.segment_drift_percent})
    pieces = tuple(
        (f"drift_{length:g}m_percent", f"Drift over pieces of {length:g} m, mean", "%", 2) for length in lengths
    )
    first = html_page.table(head, (_row(columns, *each) for each in (*_ROWS, *pieces)))
    further = html_page.table(head, (_row(columns, *each) for each in _FURTHER_ROWS))
    return first + html_page.folded("clock and coverage", further)


def claims_list(claims: Sequence[Claim], heading: str) -> str:
    """A line a claim under a heading, which is HTML; nothing where there is none."""
    sentences = [*(claim.sentence for claim in claims), *filter(None, [what_can_be_told(claims)])]
    lines = html_page.items(f"{sentence}." for sentence in sentences)
    return heading + lines if lines else ""


def _row(columns: Sequence[Mapping[str, object]], key: str, label: str, unit: str, decimals: int) -> str:
    values = [column.get(key) for column in columns]
    sizes = {index: abs(value) for index, value in enumerate(values) if isinstance(value, int | float)}
    best = [] if key not in _LESS_IS_BETTER or len(sizes) < 2 else [min(sizes, key=lambda index: sizes[index])]
    return html_page.row(
        f"{label} [{unit}]" if unit else label, (html_page.number(value, decimals) for value in values), best=best
    )


def _figure(file: Path) -> str:
    return html_page.picture(file, _CAPTIONS.get(file.stem, ""))


def _events(events: Sequence[Lived]) -> str:
    if not events:
        return ""
    rows = (
        html_page.row(
            f"{event.time_s:.2f} s",
            (escape(words) for words in (event.who, event.kind, event.detail)),
            kind="words",
        )
        for event in events
    )
    return f"<h2>Events</h2>{html_page.table(('time', 'mode', 'event', 'what happened'), rows)}"


def _notes(evaluations: Mapping[str, Evaluation]) -> str:
    notes = {name: (*evaluation.notes, _definitions(evaluation)) for name, evaluation in evaluations.items()}
    return f"<h2>Notes</h2>{html_page.items(merged_notes(notes))}"


def _definitions(evaluation: Evaluation) -> str:
    kinds = {
        "yaw_position": "yaw and position alignment",
        "se3": "SE(3) alignment",
        "start": "alignment at the start",
        "none": "no alignment",
    }
    instants = {"end": "at the end", "first_metre": "after the first metre"}
    sources = {"estimate": "the estimate's own", "positions": "the derivative of its positions"}
    return (
        f"ATE after {kinds[evaluation.alignment]}; drifts tied at the start only, the paper's taken "
        f"{instants[evaluation.paper_drift_at]}; velocity is {sources[evaluation.velocity_source]}; "
        f"{evaluation.poses} poses over {evaluation.duration_s:.2f} s compared."
    )
