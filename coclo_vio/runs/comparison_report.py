# SPDX-License-Identifier: BSD-3-Clause
"""What a comparison writes into its run folder: numbers, figures, report."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from coclo_vio.evaluation.evaluation import Evaluation
from coclo_vio.evaluation.evaluation_record import ComparisonRecord, ComparisonsRecord, RankingRecord, RankingsRecord
from coclo_vio.evaluation.figure_style import NO_FIGURES, can_draw
from coclo_vio.evaluation.html_index import Entry, write_index
from coclo_vio.evaluation.html_report import ReportContent, ReportedEvent, write_report
from coclo_vio.evaluation.plotly_page import can_zoom
from coclo_vio.evaluation.ranking import end_error_m, least_drift, length_text, rank
from coclo_vio.evaluation.table_one import TableOne
from coclo_vio.runs import run_folder
from coclo_vio.runs.drawn_run import DrawnRun
from coclo_vio.runs.output_logs import read_calibrations
from coclo_vio.runs.run_config import RunConfig
from coclo_vio.runs.run_figures import write_figures
from coclo_vio.runs.run_plots import zoomable_plots
from coclo_vio.values.config import read_yaml


@dataclass(frozen=True, slots=True)
class Compared:
    """One recording of a comparison over several.

    Attributes:
        folder: its run folder, inside that of the comparison.
        evaluations: by trajectory.
        config: as resolved for it.
    """

    folder: Path
    evaluations: Mapping[str, Evaluation]
    config: RunConfig


def write_comparison(folder: Path, title: str, evaluations: Mapping[str, Evaluation], config: RunConfig) -> Path:
    """``compare.json``, ``ranking.json``, figures and ``report.html`` of a run folder; the path of the report.

    The report has zoomable plots; without plotly it has the figures as pictures, without matplotlib too a sentence
    instead.
    """
    rankings = rank(evaluations, config.evaluation)
    with run_folder.writing(folder):
        ComparisonRecord.of(evaluations).write(folder / "compare.json")
        RankingRecord.of(rankings).write(folder / "ranking.json")
        record = run_folder.read_record(folder)
        drawn = DrawnRun(folder, record, evaluations, config.evaluation)
        return write_report(
            folder / "report.html",
            title,
            evaluations,
            write_figures(folder, record, evaluations, config.evaluation) if evaluations and can_draw() else (),
            ReportContent(
                config.model_dump(mode="json"),
                [*_summary(evaluations, config), *(() if can_draw() or can_zoom() else (f"There are {NO_FIGURES}.",))],
                rankings,
                [ReportedEvent(event.time_s, mode, event.kind, event.detail) for mode, event in record.events()],
                {name: learnt[-1] for name in record.estimators if (learnt := read_calibrations(folder, name))},
            ),
            zoomable_plots(drawn) if evaluations and can_zoom() else (),
        )


def evaluation_report(folder: Path, evaluations: Mapping[str, Evaluation]) -> Path:
    """The files of ``write_comparison`` for a run folder, however its run ended; the path of the report.

    Raises:
        ConfigError: the folder's configuration is malformed.
        DatasetError: a file cannot be written.
    """
    file = folder / "config.yaml"
    config = RunConfig.parse(read_yaml(file) if file.is_file() else {}, str(file))
    name = Path(run_folder.read_record(folder).dataset).name
    return write_comparison(folder, report_title(name, config), evaluations, config)


def write_comparisons(folder: Path, title: str, compared: Mapping[str, Compared]) -> Path:
    """``compare.json``, ``ranking.json`` and ``report.html`` over several recordings, whose own reports are there.

    Args:
        folder: of the whole.
        title: of the page.
        compared: by name of the recording.

    Returns:
        The path of the page.
    """
    rankings = {name: rank(recording.evaluations, recording.config.evaluation) for name, recording in compared.items()}
    evaluations = {name: recording.evaluations for name, recording in compared.items()}
    entries = {
        name: Entry(
            f"{recording.folder.relative_to(folder).as_posix()}/report.html",
            _summary(recording.evaluations, recording.config),
            rankings[name],
            overview if (overview := recording.folder / "figures" / "overview.png").is_file() else None,
        )
        for name, recording in compared.items()
    }
    table = TableOne.of(evaluations)
    with run_folder.writing(folder):
        ComparisonsRecord.of(evaluations).write(folder / "compare.json")
        RankingsRecord.of(rankings).write(folder / "ranking.json")
        return write_index(folder / "report.html", title, table, entries)


def _summary(evaluations: Mapping[str, Evaluation], config: RunConfig) -> list[str]:
    """The result in sentences."""
    if not evaluations:
        return ["No estimate could be compared with ground truth."]
    longest = max(evaluations.values(), key=lambda evaluation: evaluation.duration_s)
    who = "A body" if config.robot is None else f"The robot {config.robot.name}"
    first, *others = least_drift(evaluations, config.evaluation)
    near = f"; not distinguishable from it: {', '.join(others)}" if others else ""
    end = length_text(end_error_m(evaluations[first], config.evaluation))
    faults = config.faults.model_dump(mode="json", exclude_defaults=True)
    shown = "; ".join(
        f"{name} {' '.join(map(str, value)) if isinstance(value, list) else value}" for name, value in faults.items()
    )
    return [
        f"{who} travelled {longest.path_length_m:.2f} m in {longest.duration_s:.0f} s.",
        f"Least drift: {first}, {end} off at the end{near}.",
        *(() if config.faults.is_none else (f"Simulated faults: {shown}.",)),
    ]


def report_title(name: str, config: RunConfig) -> str:
    """Name of the recording, and of its robot if there is one."""
    return name if config.robot is None else f"{name}, {config.robot.name}"
