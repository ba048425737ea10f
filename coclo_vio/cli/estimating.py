# SPDX-License-Identifier: BSD-3-Clause
"""The commands that estimate and measure: ``run``, ``evaluate``."""

from pathlib import Path
from typing import Annotated

import typer

from coclo_vio.cli.options import (
    ConfigOption,
    JsonOption,
    OutOption,
    PartialOption,
    RobotOption,
    SetOption,
    with_partial,
)
from coclo_vio.cli.printing import print_ranking, print_table, progress_bar, run_title, tell_failures, tell_run
from coclo_vio.cli.terminal import give, give_json
from coclo_vio.datasets.config import DatasetConfig
from coclo_vio.datasets.ground_truth import read_ground_truth
from coclo_vio.datasets.read_report import ReadTally
from coclo_vio.datasets.rosbag.writing.new_bag import check_bag_path
from coclo_vio.evaluation.evaluate import EvaluationConfig
from coclo_vio.evaluation.evaluation import Evaluation
from coclo_vio.evaluation.records import ComparisonRecord
from coclo_vio.runs import comparison
from coclo_vio.runs.equipment import default_mode
from coclo_vio.runs.estimators import ESTIMATORS
from coclo_vio.runs.inspection import resolve_if_known
from coclo_vio.runs.result_bag import write_run_bag
from coclo_vio.runs.run_config import resolve
from coclo_vio.values.errors import DatasetError


def run(
    dataset: Annotated[Path, typer.Argument(help="Recording: folder or file.")],
    mode: Annotated[
        str | None,
        typer.Option(
            "--mode",
            "-m",
            help=f"One of: {', '.join(ESTIMATORS)}. Default: combined, or coclo or vins by what there is.",
        ),
    ] = None,
    robot: RobotOption = None,
    config: ConfigOption = None,
    settings: SetOption = None,
    allow_partial: PartialOption = False,
    output: OutOption = Path("out"),
    debug_images: Annotated[
        bool, typer.Option("--debug-images", help="Draw what the eyes follow: pictures in OUT/debug_images/MODE.")
    ] = False,
    every: Annotated[int, typer.Option("--debug-images-every", min=1, help="One picture in so many frames.")] = 10,
    bag: Annotated[
        Path | None, typer.Option("--bag", help="Write the result as a rosbag too: .mcap, .bag or a folder.")
    ] = None,
) -> None:
    """Run one estimator on a recording; with ground truth, say how far it drifted."""
    if bag is not None:
        check_bag_path(bag)
    resolved, _ = resolve_if_known(dataset, robot, config, with_partial(settings, allow_partial))
    mode = mode or default_mode(dataset, resolved)
    with progress_bar() as progress:
        pictures_every = every if debug_images else None
        told = comparison.run_all(dataset, [mode], resolved, output, progress, pictures_every)
    tell_run(told, output)
    main = next(iter(told["estimators"].values()))
    failure = main["failure"]
    evaluations: dict[str, Evaluation] = {}
    if told["ground_truth"] is not None and main["estimates"]:
        evaluations, failures = comparison.evaluate_run(output, resolved.evaluation)
        print_table(evaluations, run_title(dataset.resolve().name, resolved))
        tell_failures(failures)
    if bag is not None and main["estimates"]:
        write_run_bag(bag, output, list(told["estimators"]), evaluations)
        give(f"bag: {bag}")
    if failure and not main["estimates"]:
        raise DatasetError(f"no estimate came out: {failure}")
    if failure:
        raise DatasetError(f"the run stopped early, its estimates up to there are in {output}: {failure}")
    if not main["estimates"]:
        needed = (
            "joint samples in time order, stamped in the unit their column says"
            if ESTIMATORS[mode].has_legs
            else "stereo frames in time order that show something, and where it uses an IMU its readings beside them"
        )
        raise DatasetError(
            f"no estimate came out of the {main['measurements']} measurements of {dataset}: {mode} "
            f"needs {needed}; the counts above say what came"
        )


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
        give_json(ComparisonRecord.of(evaluations).to_json())
    else:
        print_table(evaluations, str(run_or_tum))
        print_ranking(evaluations, evaluation)
    tell_failures(failures)
    if not evaluations:
        raise DatasetError(f"nothing in {run_or_tum} could be evaluated")


def _evaluation_config(run_or_tum: Path, config: Path | None, settings: list[str] | None) -> EvaluationConfig:
    """What the run was configured with, unless a file or setting says otherwise."""
    own = run_or_tum / "config.yaml"
    file = config or (own if own.is_file() else None)
    return resolve(None, file, settings or (), guess="daisy").evaluation
