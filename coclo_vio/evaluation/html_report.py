# SPDX-License-Identifier: BSD-3-Clause
"""The report of one recording: result, numbers, ranking, figures, calibration, events, notes, configuration."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path

import yaml

from coclo_vio.evaluation import html_page, plotly_page
from coclo_vio.evaluation.evaluation import Evaluation
from coclo_vio.evaluation.evaluation_record import EvaluationRecord
from coclo_vio.evaluation.notes import merged_notes
from coclo_vio.evaluation.ranking import Ranking, resolution_sentence
from coclo_vio.evaluation.zoomable_plot import ZoomablePlot
from coclo_vio.values.outputs import Calibration

_ROWS = (
    ("drift_percent", "Drift of path length", "%", 2),
    ("rpe_1m_percent", "RPE over 1 m, median", "%", 2),
    ("ate_m", "ATE", "m", 4),
    ("ate_planar_m", "ATE in the plane", "m", 4),
    ("paper_drift_percent", "Drift, paper's definition", "%", 2),
    ("velocity_rmse_mps", "Velocity RMSE", "m/s", 3),
    ("yaw_drift_deg", "Yaw drift", "deg", 2),
    ("path_length_ratio", "Path of the estimate / ground truth", "", 3),
    ("anees_pose", "ANEES of the pose (1 is consistent, above 1 overconfident, below 1 conservative)", "", 2),
    ("realtime_factor", "Times real time", "", 1),
)
_FURTHER_ROWS = (
    ("path_length_m", "Path of the ground truth", "m", 2),
    ("coverage", "Coverage", "", 3),
    ("clock_offset_s", "Clock offset", "s", 4),
    ("clock_rate_hz", "Rate of the ground truth", "Hz", 3),
    ("clock_correlation", "Correlation of angular velocities", "", 3),
    ("clock_residual_deg", "Attitude residual on that clock", "deg", 2),
)
_LESS_IS_BETTER = {
    *("drift_percent", "rpe_1m_percent", "ate_m", "ate_planar_m", "paper_drift_percent", "velocity_rmse_mps"),
    "yaw_drift_deg",
}
_CAPTIONS = {
    "overview": "The path, and the distance of each estimate to ground truth (averaged over 0.3 s). Estimates are tied "
    "to ground truth at the start only.",
    "path": "The path from above, to scale, and from the side, its height not to scale.",
    "positions": "Position over time: standalone estimators on the left, combined ones on the right.",
    "velocities": "Velocity in the world, of a long recording 20 s from its middle. That of ground truth is the slope "
    "of its positions over 0.25 s, which flattens short peaks.",
    "position_error": "Distance to ground truth over time, averaged over 0.3 s; vertical lines mark events.",
    "error_bands": "Error along each axis in the band of three sigmas of the filter's own covariance, ground truth's "
    "noise included. A consistent filter is outside it for 0.3 % of the time; a much wider band is conservative.",
    "keyframes": "Tracked points and the residual reprojection error at each keyframe; vertical lines mark events.",
    "contacts": "Feet in stance.",
}
_MRAD_PER_RAD = 1e3


@dataclass(frozen=True, slots=True)
class ReportedEvent:
    """An event of an estimator, as the report lists it.

    Attributes:
        time_s: since the recording began, s.
        mode: of the estimator.
        kind: of the event.
        detail: a sentence.
    """

    time_s: float
    mode: str
    kind: str
    detail: str


@dataclass(frozen=True, slots=True)
class ReportContent:
    """What a report shows besides numbers and figures.

    Attributes:
        configuration: plain values as resolved for the run, shown as YAML.
        summary: the result in sentences, at the top.
        rankings: of the trajectories.
        events: of the estimators, in order of time.
        calibrations: what each trajectory's estimator learnt of the cameras.
    """

    configuration: Mapping[str, object] | None = None
    summary: Sequence[str] = ()
    rankings: Sequence[Ranking] = ()
    events: Sequence[ReportedEvent] = ()
    calibrations: Mapping[str, Calibration] | None = None


def write_report(
    path: Path,
    title: str,
    evaluations: Mapping[str, Evaluation],
    figures: Sequence[Path] = (),
    content: ReportContent | None = None,
    plots: Sequence[ZoomablePlot] = (),
) -> Path:
    """Write the report and return its path.

    Args:
        path: HTML file to write.
        title: of the page, such as the name of the data set.
        evaluations: by name of the trajectory; a column each.
        figures: PNG files, embedded; the first one is at the top.
        content: what else it shows.
        plots: zoomable ones in place of the figures; the first two are at the top. They need plotly.

    Raises:
        EvaluationError: a figure cannot be read, or the report cannot be written.
    """
    content = content or ReportContent()
    if plots:
        shown = [plotly_page.holder(plot) for plot in plots]
        shown[0] = plotly_page.tick_boxes(plots) + shown[0]
        first, others = shown[:2], shown[2:]
    else:
        shown = [_figure(figure) for figure in figures]
        first, others = shown[:1], shown[1:]
    parts = [
        *(f'<p class="lead">{escape(sentence)}</p>' for sentence in content.summary),
        *first,
        "<h2>Numbers</h2>",
        numbers_table(evaluations),
        ranking_list(content.rankings, "<h2>Ranking</h2>"),
        *(("<h2>Figures</h2>", *others) if others else ()),
        _calibrations(content.calibrations or {}),
        _events(content.events),
        _notes(evaluations),
    ]
    if content.configuration:
        text = yaml.safe_dump(dict(content.configuration), sort_keys=False)
        parts.append(
            f"<h2>Configuration</h2>{html_page.folded('as resolved for this run', f'<pre>{escape(text)}</pre>')}"
        )
    if plots:
        parts.append(plotly_page.scripts(plots))
    return html_page.write_page(path, title, parts)


def numbers_table(evaluations: Mapping[str, Evaluation]) -> str:
    """All numbers, a column for each trajectory; clock and coverage folded away."""
    columns = [EvaluationRecord.of(evaluation) for evaluation in evaluations.values()]
    head = ("", *evaluations)
    lengths = sorted({length for evaluation in evaluations.values() for length in evaluation.segment_drift_percent})
    segments = tuple(
        (f"drift_{length:g}m_percent", f"Drift over segments of {length:g} m, mean", "%", 2) for length in lengths
    )
    first = html_page.table(head, (_row(columns, *each) for each in (*_ROWS, *segments)))
    further = html_page.table(head, (_row(columns, *each) for each in _FURTHER_ROWS))
    return first + html_page.folded("clock and coverage", further)


def ranking_list(rankings: Sequence[Ranking], heading: str) -> str:
    """A line for each ranking under a heading, which is HTML; empty where there is none."""
    sentences = [*(ranking.sentence for ranking in rankings), *filter(None, [resolution_sentence(rankings)])]
    lines = html_page.items(f"{sentence}." for sentence in sentences)
    return heading + lines if lines else ""


def _row(columns: Sequence[EvaluationRecord], key: str, label: str, unit: str, decimals: int) -> str:
    values = [getattr(column, key, None) for column in columns]
    sizes = {index: abs(value) for index, value in enumerate(values) if isinstance(value, int | float)}
    best = [] if key not in _LESS_IS_BETTER or len(sizes) < 2 else [min(sizes, key=lambda index: sizes[index])]
    return html_page.row(
        f"{label} [{unit}]" if unit else label, (html_page.number(value, decimals) for value in values), best=best
    )


def _figure(file: Path) -> str:
    return html_page.picture(file, _CAPTIONS.get(file.stem, ""))


def _calibrations(calibrations: Mapping[str, Calibration]) -> str:
    """Camera rotation by axis and stereo scale with one sigma, a column for each trajectory."""
    if not calibrations:
        return ""
    learnt = calibrations.values()
    rows = [
        html_page.row(
            f"Rotation of the cameras about {axis} of the body [mrad]",
            (
                _with_sigma(_MRAD_PER_RAD * each.rotation_body[index], _MRAD_PER_RAD * each.rotation_sigma[index])
                for each in learnt
            ),
        )
        for index, axis in enumerate("xyz")
    ]
    scales = (_with_sigma(100.0 * (each.stereo_scale - 1.0), 100.0 * each.stereo_scale_sigma) for each in learnt)
    rows.append(html_page.row("Stereo scale against the recording's calibration [%]", scales))
    table = html_page.table(("", *calibrations), rows)
    return f"<h2>Calibration of the cameras, estimated</h2>{table}<p>With one sigma.</p>"


def _with_sigma(value: float, sigma: float) -> str:
    return f"{html_page.number(float(value), 2)} &plusmn; {html_page.number(float(sigma), 2)}"


def _events(events: Sequence[ReportedEvent]) -> str:
    if not events:
        return ""
    rows = (
        html_page.row(
            f"{event.time_s:.2f} s",
            (escape(cell) for cell in (event.mode, event.kind, event.detail)),
            kind="text",
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
