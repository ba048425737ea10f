# SPDX-License-Identifier: BSD-3-Clause
"""The command line ``coclo-vio``: the only place that prints or exits."""

import json
import os
import sys
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import get_context
from pathlib import Path
from typing import Annotated, Any

import typer
import yaml
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeElapsedColumn
from rich.table import Table

from coclo_vio import __version__, comparison, run_folder
from coclo_vio.datasets.bag_file import check_bag_path
from coclo_vio.datasets.config import DatasetConfig
from coclo_vio.datasets.ground_truth import read_ground_truth
from coclo_vio.datasets.report import ReadTally
from coclo_vio.errors import CocloError, ConfigError, DatasetError
from coclo_vio.estimators import ESTIMATORS
from coclo_vio.evaluation.evaluate import EvaluationConfig
from coclo_vio.evaluation.evaluation import Evaluation
from coclo_vio.inspection import inspect_recording, resolve_if_known
from coclo_vio.inspection_view import drawn
from coclo_vio.robot.description import load_robot, robot_names
from coclo_vio.run_bag import write_run_bag
from coclo_vio.run_config import RunConfig, resolve
from coclo_vio.sample import sample_path

app = typer.Typer(
    name="coclo-vio",
    help="Where a legged robot is, from what it feels and what it sees.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)
_out = Console()
_err = Console(stderr=True)
_EVERY_NS = 200_000_000
_COMPARED = "coclo,coclo_paper,inekf,naive"
_ONE_THREAD = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
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

RobotOption = Annotated[str | None, typer.Option("--robot", "-r", help="Known robot, or the path of its YAML.")]
ConfigOption = Annotated[Path | None, typer.Option("--config", "-c", help="YAML configuration.")]
SetOption = Annotated[list[str] | None, typer.Option("--set", help="One value, such as filter.profile=paper.")]
OutOption = Annotated[Path, typer.Option("--output", "-o", help="Folder for the results.")]
PartialOption = Annotated[bool, typer.Option("--allow-partial", help="Use what can be read of a damaged recording.")]
JsonOption = Annotated[bool, typer.Option("--json", help="Print JSON instead of a table.")]


@app.command()
def demo(output: OutOption = Path("demo_out")) -> None:
    """Compare the estimators on the bundled walk of a six-legged Daisy: table, plots, report."""
    _compare([sample_path()], _COMPARED, resolve(robot="daisy"), output)


@app.command()
def run(
    dataset: Annotated[Path, typer.Argument(help="Recording: folder or file.")],
    mode: Annotated[str, typer.Option("--mode", "-m", help=f"One of: {', '.join(ESTIMATORS)}.")] = "coclo",
    robot: RobotOption = None,
    config: ConfigOption = None,
    settings: SetOption = None,
    allow_partial: PartialOption = False,
    output: OutOption = Path("out"),
    bag: Annotated[
        Path | None, typer.Option("--bag", help="Write the result as a rosbag too: .mcap, .bag or a folder.")
    ] = None,
) -> None:
    """Run one estimator on a recording; with ground truth, say how far it drifted."""
    if bag is not None:
        check_bag_path(bag)
    resolved = _resolve_for(dataset, robot, config, _with_partial(settings, allow_partial))
    with _progress_bar() as progress:
        told = comparison.run_all(dataset, [mode], resolved, output, progress)
    _tell_run(told, output)
    failure = told["estimators"][mode]["failure"]
    evaluations: dict[str, Evaluation] = {}
    if told["ground_truth"] is not None and told["estimators"][mode]["estimates"]:
        evaluations, failures = comparison.evaluate_run(output, resolved.evaluation)
        _print_table(evaluations, f"{dataset.resolve().name}, {resolved.robot.name}")
        _print_failures(failures)
    if bag is not None and told["estimators"][mode]["estimates"]:
        write_run_bag(bag, output, list(told["estimators"]), evaluations)
        _out.print(f"bag: {bag}", soft_wrap=True, markup=False)
    if failure:
        raise DatasetError(f"the run stopped early, its estimates up to there are in {output}: {failure}")
    if not told["estimators"][mode]["estimates"]:
        raise DatasetError(
            f"no estimate came out of the {told['estimators'][mode]['measurements']} measurements of {dataset}: {mode} "
            "needs joint samples in time order, stamped in the unit their column says; the counts above say what came"
        )


@app.command()
def compare(
    datasets: Annotated[list[Path], typer.Argument(help="Recordings with ground truth.")],
    modes: Annotated[str, typer.Option("--modes", help="Estimators, separated by commas.")] = _COMPARED,
    robot: RobotOption = None,
    config: ConfigOption = None,
    settings: SetOption = None,
    allow_partial: PartialOption = False,
    output: OutOption = Path("out"),
) -> None:
    """Run several estimators side by side against ground truth: table, plots, compare.json, report.html."""
    _compare(datasets, modes, None, output, robot, config, _with_partial(settings, allow_partial))


@app.command()
def evaluate(
    run_or_tum: Annotated[Path, typer.Argument(help="Run folder or TUM trajectory.")],
    vicon: Annotated[Path | None, typer.Option("--vicon", help="Ground truth: TUM, EuRoC or mocap CSV.")] = None,
    config: ConfigOption = None,
    settings: SetOption = None,
    as_json: JsonOption = False,
) -> None:
    """Measure trajectories against ground truth."""
    evaluation = _evaluation_config(run_or_tum, config, settings)
    truth = None if vicon is None else read_ground_truth(vicon, DatasetConfig().columns, ReadTally("ground truth", 0.1))
    failures: dict[str, str] = {}
    if run_or_tum.is_dir():
        evaluations, failures = comparison.evaluate_run(run_or_tum, evaluation, truth)
    else:
        evaluations = comparison.evaluate_tum(run_or_tum, evaluation, truth)
    if as_json:
        _print_json({name: value.to_json() for name, value in evaluations.items()})
    else:
        _print_table(evaluations, str(run_or_tum))
    _print_failures(failures)
    if not evaluations:
        raise DatasetError(f"nothing in {run_or_tum} could be evaluated")


@app.command()
def inspect(
    dataset: Annotated[Path, typer.Argument(help="Recording: folder or file.")],
    robot: RobotOption = None,
    config: ConfigOption = None,
    settings: SetOption = None,
    allow_partial: PartialOption = False,
    as_json: JsonOption = False,
) -> None:
    """Say what a recording holds: streams, gaps, clock jumps, joints, calibrations, and what is missing for a mode."""
    resolved, known = resolve_if_known(dataset, robot, config, _with_partial(settings, allow_partial))
    seen = inspect_recording(dataset, known, resolved.dataset)
    if as_json:
        _print_json(seen.to_json())
    else:
        _out.print(*drawn(seen), sep="\n")


@app.command()
def benchmark(
    as_json: JsonOption = False,
    seconds: Annotated[float, typer.Option(min=2.0, help="Length of the walk that is timed, s.")] = 8.0,
    rounds: Annotated[int, typer.Option(min=1, help="How often; the best counts.")] = 3,
) -> None:
    """Time the filter for six legs on one core, beside filterpy where that is installed."""
    from coclo_vio.benchmark import run_benchmark  # noqa: PLC0415 -- loads what it compares with

    os.environ.update(_ONE_THREAD)
    with ProcessPoolExecutor(1, get_context("spawn")) as fresh:  # NumPy takes its number of threads as it is loaded
        figures = fresh.submit(run_benchmark, seconds, rounds).result()
    if as_json:
        _print_json(figures)
        return
    table = Table("figure", "value")
    for name, value in figures.items():
        table.add_row(name, "-" if value is None else f"{value:.4g}")
    _out.print(table)


@app.command(name="config")
def show_config(
    robot: RobotOption = None,
    config: ConfigOption = None,
    settings: SetOption = None,
) -> None:
    """Print the resolved configuration as YAML; every key can be changed with --set or in a file."""
    resolved = resolve(robot, config, settings or (), guess="daisy")
    sys.stdout.write(yaml.safe_dump(resolved.model_dump(mode="json"), sort_keys=False))


@app.command()
def robots() -> None:
    """List the known robots."""
    table = Table("robot", "legs", "joints", "contact from", "URDF")
    for name in robot_names():
        known = load_robot(name)
        urdf = known.urdf if known.urdf.startswith("example-robot-data:") else Path(known.urdf).name
        table.add_row(name, ", ".join(known.leg_names), str(len(known.joint_names)), known.contact.source, urdf)
    _out.print(table)
    _out.print("Your own robot: a URDF and a few lines of YAML, given with --robot my_robot.yaml; see the README.")


def main() -> None:
    """Entry of the console script: one sentence and a status instead of a traceback for what users can mend."""
    try:
        app()
    except ConfigError as error:
        _fail(error, 2)
    except CocloError as error:
        _fail(error, 1)


def _fail(error: CocloError, status: int) -> None:
    sentence = " ".join(line.strip() for line in str(error).splitlines())  # a YAML error shows its place below
    _err.print(f"coclo-vio: {sentence}", markup=False, highlight=False, soft_wrap=True)
    sys.exit(status)


def _resolve_for(dataset: Path, robot: str | None, config: Path | None, settings: Sequence[str]) -> RunConfig:
    resolved, known = resolve_if_known(dataset, robot, config, settings)
    return resolved if known is not None else resolve(robot, config, settings)  # says that no robot is named


def _with_partial(settings: list[str] | None, allow_partial: bool) -> list[str]:
    return [*(settings or ()), *(["dataset.allow_partial=true"] if allow_partial else [])]


def _evaluation_config(run_or_tum: Path, config: Path | None, settings: list[str] | None) -> EvaluationConfig:
    """What the run was configured with, unless a file or setting says otherwise."""
    own = run_or_tum / "config.yaml"
    file = config or (own if own.is_file() else None)
    return resolve(None, file, settings or (), guess="daisy").evaluation


def _compare(
    datasets: list[Path],
    modes: str,
    resolved: RunConfig | None,
    output: Path,
    robot: str | None = None,
    config: Path | None = None,
    settings: Sequence[str] = (),
) -> None:
    names = list(dict.fromkeys(name.strip() for name in modes.split(",") if name.strip()))
    if not names:
        raise ConfigError(f"--modes names no estimator; there are: {', '.join(ESTIMATORS)}")
    compared: dict[str, Any] = {}
    fruitless: list[str] = []
    for name, dataset in zip(_distinct_names(datasets), datasets, strict=True):
        own = resolved or _resolve_for(dataset, robot, config, settings)
        folder = output if len(datasets) == 1 else output / name
        with _progress_bar() as progress:
            told = comparison.run_all(dataset, names, own, folder, progress)
        _tell_run(told, folder)
        evaluations, failures = comparison.evaluate_run(folder, own.evaluation)
        _print_table(evaluations, f"{name}, {own.robot.name}")
        stopped = {mode: one["failure"] for mode, one in told["estimators"].items() if one["failure"]}
        _print_failures(failures | stopped)
        report = comparison.write_comparison(folder, f"{name}, {own.robot.name}", evaluations, own)
        _out.print(f"report: {report}", soft_wrap=True, markup=False)
        compared[name] = {estimator: value.to_json() for estimator, value in evaluations.items()}
        if not evaluations or len(stopped) == len(names):
            fruitless.append(str(dataset))
    if len(datasets) > 1:
        with run_folder.writing(output):
            run_folder.write_json(output / "compare.json", compared)
    if fruitless:
        raise DatasetError(f"no estimator got through {', '.join(fruitless)}; what stopped each is told above")


def _distinct_names(datasets: Sequence[Path]) -> list[str]:
    """What each recording is called: its last path component, numbered where an earlier one has the same."""
    names: list[str] = []
    for dataset in datasets:
        name = plain = dataset.resolve().name
        number = 1
        while name in names:
            number += 1
            name = f"{plain}_{number}"
        names.append(name)
    return names


def _tell_run(told: Mapping[str, Any], folder: Path) -> None:
    """Say what was left out, assumed or counted, and where the results are."""
    _err.print(f"robot {told['robot']}; results in {folder}", soft_wrap=True, highlight=False, markup=False)
    reader = told.get("reader") or {}
    for note in reader.get("notes", ()):
        _err.print(f"note: {note}", soft_wrap=True, highlight=False, markup=False)
    for reason, count in (reader.get("dropped") or {}).items():
        _err.print(f"left out: {count} x {reason}", soft_wrap=True, highlight=False, markup=False)
    for name, estimator in told["estimators"].items():
        counts = ", ".join(f"{key} {value}" for key, value in estimator["counts"].items() if value)
        if counts:
            _err.print(f"{name}: {counts}", soft_wrap=True, highlight=False, markup=False)


def _print_table(evaluations: Mapping[str, Evaluation], title: str) -> None:
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
    _out.print(table)
    travelled_m = max(evaluation.path_length_m for evaluation in evaluations.values())
    covered = min(evaluation.coverage or 0.0 for evaluation in evaluations.values())
    _out.print(
        f"ground truth {travelled_m:.2f} m, covered {covered:.3f} or more; ANEES 1 is honest, above it too sure",
        highlight=False,
    )
    for note in dict.fromkeys(note for evaluation in evaluations.values() for note in evaluation.notes):
        _err.print(f"note: {note}", soft_wrap=True, highlight=False, markup=False)


def _print_json(values: Mapping[str, Any]) -> None:
    """One JSON object, never coloured or folded."""
    sys.stdout.write(json.dumps(values, indent=2, allow_nan=False) + "\n")


def _print_failures(failures: Mapping[str, str]) -> None:
    for name, reason in failures.items():
        _err.print(f"{name} stopped early or has no result: {reason}", soft_wrap=True, highlight=False, markup=False)


@contextmanager
def _progress_bar() -> Iterator[comparison.Progress]:
    """A line for each estimator with the seconds of recording it has done."""
    columns = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.completed:.1f} s"), TimeElapsedColumn())
    with Progress(*columns, console=_err, transient=True, disable=not _err.is_terminal) as bar:
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
            _err.print("stopped; what was estimated so far is in the output folder")
            raise


@app.callback(invoke_without_command=True)
def _version(version: Annotated[bool, typer.Option("--version", help="Print the version.")] = False) -> None:
    if version:
        _out.print(__version__)
        raise typer.Exit
