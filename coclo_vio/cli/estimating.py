# SPDX-License-Identifier: BSD-3-Clause
"""The commands that estimate and measure: ``run``, ``evaluate``."""

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from coclo_vio.api.recording import Recording, open_recording
from coclo_vio.api.run import Run, load_ground_truth, load_run
from coclo_vio.api.run import run as run_recording
from coclo_vio.api.trajectory_evaluation import evaluate as evaluate_trajectory
from coclo_vio.cli.options import (
    ConfigOption,
    JsonOption,
    ModeOption,
    OutOption,
    OverwriteOption,
    PartialOption,
    ResumeOption,
    RobotOption,
    SetOption,
    ViewFileOption,
    ViewOption,
    ViewPortOption,
    existing,
    with_partial,
)
from coclo_vio.cli.printing import print_failures, print_ranking, print_run, print_table, progress_bar
from coclo_vio.cli.stopping import done_so_far, stoppable
from coclo_vio.cli.terminal import give, give_json
from coclo_vio.cli.view_command import opened_view
from coclo_vio.datasets.rosbag.writing.new_bag import check_bag_path
from coclo_vio.evaluation.evaluation_record import ComparisonRecord
from coclo_vio.runs.comparison_report import evaluation_report, report_title
from coclo_vio.runs.evaluating import evaluation_config
from coclo_vio.runs.modes.registry import mode_of
from coclo_vio.runs.result_bag import write_run_bag
from coclo_vio.runs.running import Ending
from coclo_vio.values.errors import DatasetError, EvaluationError

if TYPE_CHECKING:
    from coclo_vio.evaluation.evaluation import Evaluation


def run(
    dataset: Annotated[Path, typer.Argument(help="Recording: folder or file.")],
    mode: ModeOption = None,
    robot: RobotOption = None,
    config: ConfigOption = None,
    settings: SetOption = None,
    allow_partial: PartialOption = False,
    output: OutOption = Path("out"),
    debug_images: Annotated[
        bool, typer.Option("--debug-images", help="Draw the tracks on frames: pictures in OUT/debug_images/MODE.")
    ] = False,
    every: Annotated[int, typer.Option("--debug-images-every", min=1, help="One picture in so many frames.")] = 10,
    bag: Annotated[
        Path | None, typer.Option("--bag", help="Write the result as a rosbag too: .mcap, .bag or a folder.")
    ] = None,
    overwrite: OverwriteOption = False,
    resume: ResumeOption = False,
    view: ViewOption = None,
    view_file: ViewFileOption = None,
    view_port: ViewPortOption = None,
) -> None:
    """Run one mode on a recording; with ground truth, print its drift."""
    if bag is not None:
        check_bag_path(bag)
    earlier = existing(overwrite=overwrite, resume=resume)
    with stoppable(partial(done_so_far, output)) as stop:
        recording = open_recording(dataset, robot, config=config, settings=with_partial(settings, allow_partial))
        with opened_view(view, recording, view_file, view_port) as shown, progress_bar() as progress:
            done = run_recording(
                recording,
                mode,
                folder=output,
                progress=progress,
                pictures_every=every if debug_images else None,
                existing=Ending(earlier, stop),
                view=shown,
            )
        if not stop.is_requested:
            _show(done, recording, bag)


def _show(done: Run, recording: Recording, bag: Path | None) -> None:
    """What a run came to; its result as a bag, if one is asked for.

    Raises:
        DatasetError: it stopped early or gave nothing.
    """
    output = done.folder
    print_run(done.record, output)
    first = done.record.estimators[done.names[0]]
    evaluations: Mapping[str, Evaluation] = {}
    if done.record.ground_truth is not None and first.estimates:
        evaluations, failures = done.evaluated(config=recording.config.evaluation)
        print_table(evaluations, report_title(recording.name, recording.config))
        print_failures(failures)
    with_poses = [name for name, trajectory in done.record.estimators.items() if trajectory.estimates]
    if bag is not None and with_poses:
        write_run_bag(bag, output, with_poses, evaluations)
        give(f"bag: {bag}")
    _check(done, recording.path, output)


def _check(done: Run, dataset: Path, output: Path) -> None:
    """A run that stopped early or gave nothing is an error.

    Raises:
        DatasetError: always then.
    """
    first = done.record.estimators[done.names[0]]
    if first.failure and not first.estimates:
        raise DatasetError(f"there is no estimate: {first.failure}")
    if first.failure:
        raise DatasetError(f"the run stopped early, its estimates up to there are in {output}: {first.failure}")
    if not first.estimates:
        needed = (
            "joint samples in time order, stamped in the unit of their column"
            if mode_of(first.mode).has_legs
            else "stereo frames in time order with texture, and where it uses an IMU its readings beside them"
        )
        raise DatasetError(
            f"{first.mode} gave no estimate for the {first.measurements} measurements of {dataset}: it needs {needed}; "
            "the counts above list what came"
        )


def evaluate(
    run_or_tum: Annotated[Path, typer.Argument(help="Run folder or TUM trajectory.")],
    vicon: Annotated[Path | None, typer.Option("--vicon", help="Ground truth: TUM, EuRoC or mocap CSV.")] = None,
    config: ConfigOption = None,
    settings: SetOption = None,
    as_json: JsonOption = False,
    report: Annotated[
        bool, typer.Option("--report", help="Write report.html and figures into the run folder, as compare does.")
    ] = False,
) -> None:
    """Measure trajectories against ground truth."""
    evaluation = evaluation_config(config or run_or_tum / "config.yaml", settings or ())
    failures: Mapping[str, str] = {}
    if not run_or_tum.exists():
        raise DatasetError(f"{run_or_tum} does not exist; give a run folder or a TUM file")
    if run_or_tum.is_dir():
        evaluations, failures = load_run(run_or_tum).evaluated(vicon, config=evaluation)
    elif vicon is None:
        raise EvaluationError(f"{run_or_tum} is a trajectory without ground truth; give one with --vicon FILE")
    else:
        measured = evaluate_trajectory(run_or_tum, load_ground_truth(vicon), config=evaluation)
        evaluations = {run_or_tum.stem: measured}
    if as_json:
        give_json(ComparisonRecord.of(evaluations).to_json())
    else:
        print_table(evaluations, str(run_or_tum))
        print_ranking(evaluations, evaluation)
    print_failures(failures)
    if report and run_or_tum.is_dir():
        whole = evaluation_report(run_or_tum, evaluations)
        give(f"report: {whole}")
    if not evaluations:
        raise DatasetError(f"nothing in {run_or_tum} could be evaluated")
