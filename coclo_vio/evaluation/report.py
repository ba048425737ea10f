# SPDX-License-Identifier: BSD-3-Clause
"""A report in one HTML file: table of numbers, notes, figures, configuration. It asks nothing of the network."""

import base64
from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path

import yaml

from coclo_vio.errors import EvaluationError
from coclo_vio.evaluation.evaluation import Evaluation

_ROWS = (
    ("ate_m", "ATE", "m", 3),
    ("ate_planar_m", "ATE in the plane", "m", 3),
    ("rpe_1m_percent", "RPE over 1 m, median", "%", 2),
    ("drift_percent", "Drift of path length", "%", 2),
    ("paper_drift_percent", "Drift, paper's definition", "%", 2),
    ("velocity_rmse_mps", "Velocity RMSE", "m/s", 3),
    ("yaw_drift_deg", "Yaw drift", "deg", 2),
    ("path_length_m", "Path of the ground truth", "m", 2),
    ("path_length_ratio", "Path of the estimate / ground truth", "", 3),
    ("coverage", "Coverage", "", 3),
    ("anees_pose", "ANEES of the pose (1 is honest)", "", 2),
    ("realtime_factor", "Times real time", "", 1),
    ("clock_offset_s", "Clock offset", "s", 4),
    ("clock_rate_hz", "Rate of the ground truth", "Hz", 3),
    ("clock_correlation", "Agreement of angular velocities", "", 3),
    ("clock_residual_deg", "Attitude residual on that clock", "deg", 2),
)
_STYLE = """
body { font-family: system-ui, sans-serif; max-width: 60rem; margin: 2rem auto; padding: 0 1rem; color: #222; }
table { border-collapse: collapse; } th, td { padding: .25rem .8rem; border-bottom: 1px solid #ddd; text-align: right; }
th:first-child, td:first-child { text-align: left; }
img { max-width: 100%; } pre { background: #f5f5f5; padding: 1rem; }
"""


def write_report(
    path: Path,
    title: str,
    evaluations: Mapping[str, Evaluation],
    figures: Sequence[Path] = (),
    configuration: Mapping[str, object] | None = None,
) -> Path:
    """Write the report and return its path.

    Args:
        path: HTML file to write.
        title: of the page, such as the name of the data set.
        evaluations: by name of the estimator; a column each.
        figures: PNG files, embedded.
        configuration: plain values as resolved for the run, shown as YAML.

    Raises:
        EvaluationError: a figure cannot be read, or the report cannot be written.
    """
    parts = [
        f'<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8"><title>{escape(title)}</title>',
        f"<style>{_STYLE}</style></head><body><h1>{escape(title)}</h1>",
        _table(evaluations),
        _notes(evaluations),
        *(_image(figure) for figure in figures),
    ]
    if configuration:
        text = yaml.safe_dump(dict(configuration), sort_keys=False)
        parts.append(f"<h2>Configuration</h2><pre>{escape(text)}</pre>")
    parts.append("</body></html>\n")
    try:
        path.write_text("\n".join(parts), encoding="utf-8")
    except OSError as error:
        raise EvaluationError(f"cannot write the report {path}: {error.strerror}; choose another place") from error
    return path


def _table(evaluations: Mapping[str, Evaluation]) -> str:
    columns = [evaluation.to_json() for evaluation in evaluations.values()]
    head = "".join(f"<th>{escape(name)}</th>" for name in evaluations)
    lines = [f"<table><tr><th></th>{head}</tr>"]
    for key, label, unit, decimals in _ROWS:
        cells = "".join(f"<td>{_number(column[key], decimals)}</td>" for column in columns)
        lines.append(f"<tr><td>{label}{f' [{unit}]' if unit else ''}</td>{cells}</tr>")
    for length_m in sorted(
        {length for evaluation in evaluations.values() for length in evaluation.segment_drift_percent}
    ):
        drifts = (evaluation.segment_drift_percent.get(length_m) for evaluation in evaluations.values())
        cells = "".join(f"<td>{_number(drift, 2)}</td>" for drift in drifts)
        lines.append(f"<tr><td>Drift over pieces of {length_m:g} m, mean [%]</td>{cells}</tr>")
    lines.append("</table>")
    return "\n".join(lines)


def _number(value: object, decimals: int) -> str:
    return f"{value:.{decimals}f}" if isinstance(value, int | float) else "&ndash;"


def _notes(evaluations: Mapping[str, Evaluation]) -> str:
    items = [
        f"<li>{escape(name)}: {escape(note)}</li>"
        for name, evaluation in evaluations.items()
        for note in (*evaluation.notes, _definitions(evaluation))
    ]
    return f"<h2>Notes</h2><ul>{''.join(items)}</ul>"


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


def _image(figure: Path) -> str:
    try:
        data = base64.b64encode(figure.read_bytes()).decode("ascii")
    except OSError as error:
        raise EvaluationError(f"cannot read the figure {figure}: {error.strerror}; draw it first") from error
    return f'<p><img alt="{escape(figure.stem)}" src="data:image/png;base64,{data}"></p>'
