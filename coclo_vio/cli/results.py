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

from coclo_vio import comparison
from coclo_vio.cli.terminal import err, out, say
from coclo_vio.evaluation.evaluation import Evaluation

_EVERY_NS = 200_000_000
_COLUMNS = (
    ("ate_m", "ATE\nm", ".3f"),
    ("ate_planar_m", "xy\nm", ".3f"),
    ("rpe_1m_percent", "RPE\n%/m", ".2f"),
    ("drift_percent", "drift\n%", ".2f"),
    ("velocity_rmse_mps", "speed\nm/s", ".3f"),
    ("yaw_drift_deg", "yaw\ndeg", ".2f"),
    ("path_length_ratio", "path\nratio", ".3f"),
    ("anees_pose", "ANEES\n", ".2f"),
    ("realtime_factor", "real\ntime", ".1f"),
)


def tell_run(told: Mapping[str, Any], folder: Path) -> None:
    """Say what was left out, assumed or counted, and where the results are."""
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
    for name, estimator in told["estimators"].items():
        if "joints" not in estimator["sensors"]:
            say(f"{name}: sees with {', '.join(estimator['sensors'])}")
        counts = ", ".join(f"{key} {value}" for key, value in estimator["counts"].items() if value)
        if counts:
            say(f"{name}: {counts}")
        for line in _seen(estimator, folder / "debug_images" / name):
            say(f"{name}: {line}")


def _seen(estimator: Mapping[str, Any], pictures: Path) -> Iterator[str]:
    """What a visual estimator lived through, in lines."""
    if keyframes := estimator["keyframes"]:
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
    """A row for each estimator; nothing where there is none."""
    if not evaluations:
        return
    table = Table(title=escape(title), box=SIMPLE_HEAD, pad_edge=False, collapse_padding=True, title_justify="left")
    table.add_column("", no_wrap=True)
    for _, label, _ in _COLUMNS:
        table.add_column(label, justify="right", no_wrap=True)
    for name, evaluation in evaluations.items():
        values = evaluation.to_json()
        cells = ("-" if values[key] is None else format(values[key], form) for key, _, form in _COLUMNS)
        table.add_row(name, *cells)
    out.print(table)
    travelled_m = max(evaluation.path_length_m for evaluation in evaluations.values())
    covered = min(evaluation.coverage or 0.0 for evaluation in evaluations.values())
    out.print(
        f"ground truth {travelled_m:.2f} m, covered {covered:.3f} or more; ANEES 1 is honest, above it too sure",
        highlight=False,
    )
    for length_m in sorted({length for one in evaluations.values() for length in one.segment_drift_percent}):
        drifts = {name: one.segment_drift_percent.get(length_m) for name, one in evaluations.items()}
        told = ", ".join(f"{name} {drift:.2f} %" for name, drift in drifts.items() if drift is not None)
        out.print(f"mean drift over all pieces of {length_m:g} m: {told}", highlight=False)
    for note in dict.fromkeys(note for evaluation in evaluations.values() for note in evaluation.notes):
        say(f"note: {note}")


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
