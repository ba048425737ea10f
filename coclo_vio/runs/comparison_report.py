# SPDX-License-Identifier: BSD-3-Clause
"""What a comparison leaves in its run folder: numbers, figures, report."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from coclo_vio.evaluation.diagnostic_figures import plot_contacts, plot_error_bands, plot_keyframes
from coclo_vio.evaluation.evaluate import EvaluationConfig
from coclo_vio.evaluation.evaluation import Evaluation
from coclo_vio.evaluation.figure_style import NO_FIGURES, can_draw
from coclo_vio.evaluation.figures import write_figures
from coclo_vio.evaluation.html_index import Entry, write_index
from coclo_vio.evaluation.html_report import ReportContent, ReportedEvent, write_report
from coclo_vio.evaluation.ranking import end_error_m, least_drift, length_text, rank
from coclo_vio.evaluation.records import ComparisonRecord, ComparisonsRecord, RankingRecord, RankingsRecord
from coclo_vio.evaluation.table_one import TableOne
from coclo_vio.runs import run_folder
from coclo_vio.runs.keyframe_log import read_keyframes
from coclo_vio.runs.run_config import RunConfig

_SURE = ("coclo", "combined_coclo")


@dataclass(frozen=True, slots=True)
class Compared:
    """One recording of a comparison over several.

    Attributes:
        folder: its run folder, inside that of the comparison.
        evaluations: by estimator.
        config: as resolved for it.
    """

    folder: Path
    evaluations: Mapping[str, Evaluation]
    config: RunConfig


def write_comparison(folder: Path, title: str, evaluations: Mapping[str, Evaluation], config: RunConfig) -> Path:
    """``compare.json``, ``ranking.json``, figures and ``report.html`` of a run folder; the path of the report.

    Without matplotlib the report has no figures and says so.
    """
    found = rank(evaluations, config.evaluation)
    with run_folder.writing(folder):
        write_evaluations(folder / "compare.json", evaluations)
        RankingRecord.of(found).write(folder / "ranking.json")
        run = run_folder.read_run_json(folder)
        return write_report(
            folder / "report.html",
            title,
            evaluations,
            _figures(folder, evaluations, run, config.evaluation) if evaluations and can_draw() else (),
            ReportContent(
                config.model_dump(mode="json"),
                [*_summary(evaluations, config), *(() if can_draw() else (f"There are {NO_FIGURES}.",))],
                found,
                [
                    ReportedEvent(event["time_s"], mode, event["kind"], event["detail"])
                    for mode, event in told_events(run)
                ],
            ),
        )


def write_comparisons(folder: Path, title: str, compared: Mapping[str, Compared]) -> Path:
    """``compare.json``, ``ranking.json`` and ``report.html`` over several recordings, whose own reports are there.

    Args:
        folder: of the whole.
        title: of the page.
        compared: by name of the recording.

    Returns:
        The path of the page.
    """
    found = {name: rank(one.evaluations, one.config.evaluation) for name, one in compared.items()}
    evaluations = {name: one.evaluations for name, one in compared.items()}
    entries = {
        name: Entry(
            f"{one.folder.relative_to(folder).as_posix()}/report.html",
            _summary(one.evaluations, one.config),
            found[name],
            overview if (overview := one.folder / "figures" / "overview.png").is_file() else None,
        )
        for name, one in compared.items()
    }
    table = TableOne.of(evaluations)
    with run_folder.writing(folder):
        ComparisonsRecord.of(evaluations).write(folder / "compare.json")
        RankingsRecord.of(found).write(folder / "ranking.json")
        return write_index(folder / "report.html", title, table, entries)


def write_evaluations(path: Path, evaluations: Mapping[str, Evaluation]) -> None:
    """An object per estimator."""
    ComparisonRecord.of(evaluations).write(path)


def told_events(run: Mapping[str, Any]) -> Iterator[tuple[str, Mapping[str, Any]]]:
    """Mode and event of everything that estimators lived through, each once, though two answers of one mode tell it."""
    modes = {told.get("mode", name): told for name, told in run["estimators"].items()}
    for mode, told in modes.items():
        for event in told.get("events") or ():
            yield mode, event


def _summary(evaluations: Mapping[str, Evaluation], config: RunConfig) -> list[str]:
    """What a reader should know first."""
    if not evaluations:
        return ["No estimate could be compared with ground truth."]
    longest = max(evaluations.values(), key=lambda evaluation: evaluation.duration_s)
    who = "A body" if config.robot is None else f"The robot {config.robot.name}"
    first, *others = least_drift(evaluations, config.evaluation)
    near = f"; too close to tell: {', '.join(others)}" if others else ""
    end = length_text(end_error_m(evaluations[first], config.evaluation))
    faults = config.faults.model_dump(mode="json", exclude_defaults=True)
    wrong = "; ".join(
        f"{name} {' '.join(map(str, value)) if isinstance(value, list) else value}" for name, value in faults.items()
    )
    return [
        f"{who} travelled {longest.path_length_m:.2f} m in {longest.duration_s:.0f} s.",
        f"Least drift: {first}, {end} off at the end{near}.",
        *(() if config.faults.is_none else (f"Wrong on purpose: {wrong}.",)),
    ]


def _figures(
    folder: Path, evaluations: Mapping[str, Evaluation], run: Mapping[str, Any], config: EvaluationConfig
) -> list[Path]:
    """All figures, their time counted from the beginning of the recording as that of events is."""
    estimates = {name: evaluation.estimate for name, evaluation in evaluations.items()}
    references = {name: evaluation.reference for name, evaluation in evaluations.items()}
    drawn, events = folder / "figures", _stamps_by_kind(run)
    recording_ns = run.get("recording_ns")
    start_ns = None if recording_ns is None else int(recording_ns[0])
    figures = write_figures(estimates, references, drawn, events, start_ns=start_ns)
    sure = {name: estimates[name] for name in _SURE if name in estimates and estimates[name].covariance is not None}
    if sure:
        bands = plot_error_bands(
            sure,
            references,
            drawn / "error_bands.png",
            start_ns=start_ns,
            rotation_noise_rad=config.ground_truth_rotation_noise_rad,
            position_noise_m=config.ground_truth_position_noise_m,
        )
        figures.append(bands)
    keyframes = {name: read for name in evaluations if (read := read_keyframes(folder, name)) is not None}
    if keyframes:
        figures.append(plot_keyframes(keyframes, drawn / "keyframes.png", events=events, start_ns=start_ns))
    runs = (run_folder.read_estimates(folder, name) for name in evaluations)
    first = next((one for one in runs if one.leg_names), None)
    if first is not None:
        stamps_ns, stance = first.trajectory.stamps_ns, first.contact_probability
        figures.append(plot_contacts(stamps_ns, stance, first.leg_names, drawn / "contacts.png", start_ns=start_ns))
    return figures


def _stamps_by_kind(run: Mapping[str, Any]) -> dict[str, list[int]]:
    """Events of all modes, as figures mark them."""
    stamps: dict[str, list[int]] = {}
    for _, event in told_events(run):
        stamps.setdefault(f"event: {event['kind']}", []).append(int(event["stamp_ns"]))
    return stamps
