# SPDX-License-Identifier: BSD-3-Clause
"""Runs and their evaluations as they are shown on a terminal."""

from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.markup import escape
from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeElapsedColumn
from rich.table import Table

from coclo_vio.cli.terminal import err, out, say
from coclo_vio.evaluation.evaluate import EvaluationConfig
from coclo_vio.evaluation.evaluation import Evaluation
from coclo_vio.evaluation.notes import merged_notes
from coclo_vio.evaluation.paper_table import PAPER_MARK
from coclo_vio.evaluation.ranking import rank, resolution_sentence
from coclo_vio.evaluation.records import EvaluationRecord
from coclo_vio.evaluation.table_one import TableOne
from coclo_vio.evaluation.trajectory_roles import in_order
from coclo_vio.runs import comparison
from coclo_vio.runs.run_config import RunConfig

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


def run_title(name: str, config: RunConfig) -> str:
    """What stands above the results of a recording."""
    return name if config.robot is None else f"{name}, {config.robot.name}"


def tell_run(told: Mapping[str, Any], folder: Path, *, brief: bool = False) -> None:
    """Say what was left out, assumed or counted, and where the results are; briefly without what was counted."""
    robot = told["robot"]
    say(f"{'no robot' if robot is None else f'robot {robot}'}; results in {folder}")
    uses_imu = any("imu" in estimator["sensors"] for estimator in told["estimators"].values())
    if robot is not None and uses_imu and told.get("imu_calibration") == "recording":
        say("IMU: mounting and noise as the recording says; --set imu_calibration=robot takes the robot's instead")
    reader = told.get("reader") or {}
    for note in reader.get("notes", ()):
        say(f"note: {note}")
    for reason, count in (reader.get("dropped") or {}).items():
        say(f"left out: {count} x {reason}")
    for mode, estimator in {one["mode"]: one for one in reversed(told["estimators"].values())}.items():
        for line in _lived(estimator, folder / "debug_images" / mode, brief=brief):
            say(f"{mode}: {line}")


def _lived(estimator: Mapping[str, Any], pictures: Path, *, brief: bool) -> Iterator[str]:
    """What an estimator used, counted and lived through, in lines."""
    counts = ", ".join(f"{key} {value}" for key, value in estimator["counts"].items() if value)
    if "joints" not in estimator["sensors"] and not brief:
        yield f"sees with {', '.join(estimator['sensors'])}"
    if counts and not brief:
        yield counts
    if (keyframes := estimator["keyframes"]) and not brief:
        yield (
            f"{keyframes['count']} keyframes, in the median {_figure(keyframes, 'tracks', '.0f')} tracks, "
            f"{_figure(keyframes, 'reprojection_px', '.2f')} px, {_figure(keyframes, 'iterations', '.0f')} iterations, "
            f"{_figure(keyframes, 'compute_ms', '.1f')} ms"
        )
    if events := estimator["events"]:
        kinds = Counter(event["kind"] for event in events)
        first = f"the first at {events[0]['time_s']:.2f} s: {events[0]['detail']}"
        yield f"events {', '.join(f'{kind} {number}' for kind, number in kinds.items())}; {first}"
    if estimator["pictures"]:
        yield f"{estimator['pictures']} pictures in {pictures}"


def _figure(keyframes: Mapping[str, float | None], name: str, form: str) -> str:
    value = keyframes[f"{name}_median"]
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
        told = ", ".join(f"{name} {drift:.2f} %" for name, drift in drifts.items() if drift is not None)
        out.print(f"mean drift over all segments of {length_m:g} m: {told}", highlight=False)
    for note in merged_notes({name: evaluation.notes for name, evaluation in evaluations.items()}):
        say(f"note: {note}")


def _cell(value: object, factor: float, decimals: int) -> str:
    return f"{factor * value:.{decimals}f}" if isinstance(value, int | float) else "-"


def print_ranking(evaluations: Mapping[str, Evaluation], config: EvaluationConfig) -> None:
    """A line for each comparison of legs, eyes and both; nothing where they are not there."""
    found = rank(evaluations, config)
    for sentence in (*(ranking.sentence for ranking in found), *filter(None, [resolution_sentence(found)])):
        out.print(sentence, highlight=False, markup=False)


def print_table_one(table: TableOne) -> None:
    """Several recordings in the form of the paper's Table I, its own figures below."""
    shown = Table(
        title="drift % of the way / RPE % per metre",
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


def tell_failures(failures: Mapping[str, str]) -> None:
    """Say which estimators stopped, and why."""
    for name, reason in failures.items():
        say(f"{name} stopped early or has no result: {reason}")


@contextmanager
def progress_bar() -> Iterator[comparison.Progress]:
    """A line for each estimator with the seconds of recording it has done."""
    columns = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.completed:.1f} s"), TimeElapsedColumn())
    with Progress(*columns, console=err, transient=True, disable=not err.is_terminal) as bar:
        tasks: dict[str, tuple[TaskID, int]] = {}
        last: dict[str, int] = {}

        def tell(estimator: str, stamp_ns: int) -> None:
            if estimator not in tasks:
                tasks[estimator] = (bar.add_task(estimator, total=None), stamp_ns)
            if stamp_ns - last.get(estimator, stamp_ns - _EVERY_NS) >= _EVERY_NS:
                task, first_ns = tasks[estimator]
                bar.update(task, completed=(stamp_ns - first_ns) / 1e9)
                last[estimator] = stamp_ns

        try:
            yield tell
        except KeyboardInterrupt:
            say("stopped; what was estimated so far is in the output folder")
            raise
