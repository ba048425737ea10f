# SPDX-License-Identifier: BSD-3-Clause
"""Runs and their evaluations as they are shown on a terminal."""

from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from rich.box import SIMPLE_HEAD
from rich.markup import escape
from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeElapsedColumn
from rich.table import Table

from coclo_vio.cli.terminal import err, out, say
from coclo_vio.evaluation.evaluate import EvaluationConfig
from coclo_vio.evaluation.evaluation import Evaluation
from coclo_vio.evaluation.evaluation_record import EvaluationRecord
from coclo_vio.evaluation.notes import merged_notes
from coclo_vio.evaluation.paper_table import PAPER_MARK
from coclo_vio.evaluation.ranking import rank, resolution_sentence
from coclo_vio.evaluation.table_one import TableOne
from coclo_vio.evaluation.trajectory_roles import in_order
from coclo_vio.runs.observers import Progress as ProgressCallback
from coclo_vio.runs.run_record import CalibrationRecord, RunRecord, TrajectoryRecord
from coclo_vio.values.units import MRAD_PER_RAD, NS_PER_S

_EVERY_NS = 200_000_000
_SMALL_M = 0.1
_LONGEST_NAME = 24
_COLUMNS = (
    ("drift_percent", "drift", "%", 2),
    ("rpe_1m_percent", "RPE", "%/m", 2),
    ("ate_m", "ATE", "m", 3),
    ("ate_planar_m", "xy", "m", 3),
    ("velocity_rmse_mps", "speed", "m/s", 3),
    ("yaw_drift_deg", "yaw", "deg", 2),
    ("path_length_ratio", "path", "ratio", 3),
    ("anees_pose", "ANEES", "", 2),
    ("realtime_factor", "x real", "time", 1),
)


def print_run(record: RunRecord, folder: Path, *, brief: bool = False) -> None:
    """What was left out, assumed or counted, and where the results are; briefly without the counts."""
    say(f"{'no robot' if record.robot is None else f'robot {record.robot}'}; results in {folder}")
    uses_imu = any("imu" in trajectory.sensors for trajectory in record.estimators.values())
    if record.robot is not None and uses_imu and record.imu_calibration == "recording":
        say("IMU: mounting and noise of the recording; --set imu_calibration=robot takes the robot's instead")
    for finding in record.findings:
        say(f"{finding.severity} in {' and '.join(finding.streams)}: {finding.sentence}")
    if record.reader is not None:
        for note in record.reader.notes:
            say(f"note: {note}")
        for reason, count in record.reader.dropped.items():
            say(f"left out: {count} x {reason}")
    for mode, trajectory in record.by_mode().items():
        for line in _run_lines(trajectory, folder / "debug_images" / mode, brief=brief):
            say(f"{mode}: {line}")


def _run_lines(trajectory: TrajectoryRecord, pictures: Path, *, brief: bool) -> Iterator[str]:
    """What a mode read, counted and met with, in lines."""
    for stamp_ns in trajectory.resumed_ns:
        yield f"resumed after the measurement at {stamp_ns} ns"
    counts = ", ".join(f"{key} {value}" for key, value in trajectory.counts.items() if value)
    if "joints" not in trajectory.sensors and not brief:
        yield f"reads {', '.join(trajectory.sensors)}"
    if counts and not brief:
        yield counts
    keyframes = trajectory.keyframes
    if keyframes is not None and not brief:
        yield (
            f"{keyframes.count} keyframes, median of {_figure(keyframes.tracks_median, '.0f')} tracks, "
            f"{_figure(keyframes.reprojection_px_median, '.2f')} px, "
            f"{_figure(keyframes.iterations_median, '.0f')} iterations, "
            f"{_figure(keyframes.compute_ms_median, '.1f')} ms"
        )
    if trajectory.events:
        kinds = Counter(event.kind for event in trajectory.events)
        first = trajectory.events[0]
        listed = ", ".join(f"{kind} {number}" for kind, number in kinds.items())
        yield f"events {listed}; the first at {first.time_s:.2f} s: {first.detail}"
    if trajectory.slips:
        listed = ", ".join(f"{foot} {slip.count}, {slip.distance_m:.2f} m" for foot, slip in trajectory.slips.items())
        yield f"slips: {listed}"
    if trajectory.calibration is not None and not brief:
        yield _calibration_line(trajectory.calibration)
    if trajectory.pictures:
        yield f"{trajectory.pictures} pictures in {pictures}"


def _calibration_line(learnt: CalibrationRecord) -> str:
    turn = ", ".join(
        f"{MRAD_PER_RAD * value:.1f} +- {MRAD_PER_RAD * sigma:.1f}"
        for value, sigma in zip(learnt.rotation_body_rad, learnt.rotation_sigma_rad, strict=True)
    )
    scale, sigma = learnt.stereo_scale - 1.0, learnt.stereo_scale_sigma
    return f"cameras turned by ({turn}) mrad about x, y, z, stereo scale {scale:+.2%} +- {sigma:.2%} (one sigma)"


def _figure(value: float | None, form: str) -> str:
    return "-" if value is None else format(value, form)


def print_table(evaluations: Mapping[str, Evaluation], title: str) -> None:
    """A row for each trajectory, featured ones first; nothing where there is none."""
    if not evaluations:
        return
    values = {name: EvaluationRecord.of(evaluations[name]).to_json() for name in in_order(evaluations)}
    table = Table(title=escape(title), box=SIMPLE_HEAD, pad_edge=False, collapse_padding=True, title_justify="left")
    table.add_column("", no_wrap=True)
    columns = []
    for key, label, unit, decimals in _COLUMNS:
        sizes = [abs(value) for one in values.values() if isinstance(value := one[key], int | float)]
        if sizes:
            is_small = unit == "m" and max(sizes) < _SMALL_M
            columns.append((key, 1e3, 1) if is_small else (key, 1.0, decimals))
            table.add_column(f"{label}\n{'mm' if is_small else unit}", justify="right", no_wrap=True)
    for name, one in values.items():
        table.add_row(name, *(_cell(one[key], factor, decimals) for key, factor, decimals in columns))
    out.print(table)
    travelled_m = max(evaluation.path_length_m for evaluation in evaluations.values())
    covered = min(evaluation.coverage or 0.0 for evaluation in evaluations.values())
    out.print(
        f"{travelled_m:.2f} m of ground truth, {covered:.0%} of it covered; "
        "ANEES: 1 is consistent, above 1 overconfident, below 1 conservative",
        highlight=False,
    )
    for length_m in sorted({length for one in evaluations.values() for length in one.segment_drift_percent}):
        drifts = {name: one.segment_drift_percent.get(length_m) for name, one in evaluations.items()}
        listed = ", ".join(f"{name} {drift:.2f} %" for name, drift in drifts.items() if drift is not None)
        out.print(f"mean drift over all segments of {length_m:g} m: {listed}", highlight=False)
    for note in merged_notes({name: evaluation.notes for name, evaluation in evaluations.items()}):
        say(f"note: {note}")


def _cell(value: object, factor: float, decimals: int) -> str:
    return f"{factor * value:.{decimals}f}" if isinstance(value, int | float) else "-"


def print_ranking(evaluations: Mapping[str, Evaluation], config: EvaluationConfig) -> None:
    """A line for each pair of trajectories that are ranked; nothing where there is none."""
    rankings = rank(evaluations, config)
    for sentence in (*(ranking.sentence for ranking in rankings), *filter(None, [resolution_sentence(rankings)])):
        out.print(sentence, highlight=False, markup=False)


def print_table_one(table: TableOne) -> None:
    """Several recordings in the form of the paper's Table I, its own figures below."""
    shown = Table(
        title="drift % of the path / RPE % per metre",
        box=SIMPLE_HEAD,
        pad_edge=False,
        collapse_padding=True,
        title_justify="left",
    )
    shown.add_column("", no_wrap=True, overflow="ellipsis", max_width=_LONGEST_NAME)
    for header in table.headers:
        shown.add_column(header.replace(" ", "\n"), justify="right", no_wrap=True)
    last = None
    for row in table.rows:
        if last is not None and last.is_paper != row.is_paper:
            shown.add_section()
        name = f"{row.name}, paper" if row.is_paper else row.name
        shown.add_row(escape(name), *map(str, row.cells), style="dim" if row.is_paper else None)
        last = row
    out.print(shown)
    if last is not None and last.is_paper:
        out.print(f"{PAPER_MARK}: drift of the net displacement, without RPE", highlight=False)


def print_failures(failures: Mapping[str, str]) -> None:
    """Which modes stopped early, and why."""
    for name, reason in failures.items():
        say(f"{name} stopped early or has no result: {reason}")


@contextmanager
def progress_bar(total_s: float | None = None) -> Iterator[ProgressCallback]:
    """A line for each mode with the seconds of recording it has processed.

    Args:
        total_s: length of the recording, s; None where it is not known.
    """
    columns = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.completed:.1f} s"), TimeElapsedColumn())
    with Progress(*columns, console=err, transient=True, disable=not err.is_terminal) as bar:
        tasks: dict[str, tuple[TaskID, int]] = {}
        last: dict[str, int] = {}

        def update(mode: str, stamp_ns: int) -> None:
            if mode not in tasks:
                tasks[mode] = (bar.add_task(mode, total=total_s), stamp_ns)
            if stamp_ns - last.get(mode, stamp_ns - _EVERY_NS) >= _EVERY_NS:
                task, first_ns = tasks[mode]
                bar.update(task, completed=(stamp_ns - first_ns) / NS_PER_S)
                last[mode] = stamp_ns

        yield update
