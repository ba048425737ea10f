# SPDX-License-Identifier: BSD-3-Clause
"""The commands that run several modes side by side: ``demo``, ``compare``."""

from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from coclo_vio.api.comparison import ComparedRecording, Comparison
from coclo_vio.api.comparison import compare as compare_recordings
from coclo_vio.api.recording import open_recording
from coclo_vio.cli.mode_help import MODES_PLACE
from coclo_vio.cli.options import (
    ConfigOption,
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
from coclo_vio.cli.printing import (
    print_failures,
    print_ranking,
    print_run,
    print_table,
    print_table_one,
    progress_bar,
)
from coclo_vio.cli.stopping import done_so_far, stoppable
from coclo_vio.cli.terminal import give, say
from coclo_vio.cli.view_command import opened_view
from coclo_vio.datasets.sample import DURATION_S, LENGTH_M, sample_path
from coclo_vio.evaluation.figure_style import NO_FIGURES, can_draw
from coclo_vio.runs import run_folder
from coclo_vio.runs.modes.registry import mode_of, modes
from coclo_vio.values.errors import ConfigError, DatasetError


def demo(
    output: OutOption = Path("demo_out"), overwrite: OverwriteOption = False, resume: ResumeOption = False
) -> None:
    """Compare the estimators on the bundled recording of a Daisy that climbs stairs: table, plots, report."""
    recording = open_recording(sample_path(), "daisy")
    say(
        f"the bundled recording: {DURATION_S:.0f} s of a simulated hexapod Daisy that climbs stairs, {LENGTH_M:.1f} m; "
        "estimators and baselines run one after the other on one core, which takes about two minutes"
    )
    earlier = existing(overwrite=overwrite or (not resume and _is_of_demo(output)), resume=resume)
    with stoppable(partial(done_so_far, output)) as stop:
        with progress_bar(DURATION_S) as progress:
            comparison = compare_recordings(
                recording, output=output, progress=progress, done=_print, existing=earlier, stop=stop
            )
        _finish(comparison, output)


def _is_of_demo(folder: Path) -> bool:
    """Whether a folder holds an earlier demo, which the next one replaces."""
    try:
        return run_folder.read_record(folder).dataset == str(sample_path())
    except DatasetError:
        return False


def compare(
    datasets: Annotated[list[Path], typer.Argument(help="Recordings with ground truth.")],
    modes: Annotated[
        str | None,
        typer.Option("--modes", help=f"Some of {MODES_PLACE}, separated by commas. Default: by what there is."),
    ] = None,
    robot: RobotOption = None,
    config: ConfigOption = None,
    settings: SetOption = None,
    allow_partial: PartialOption = False,
    output: OutOption = Path("out"),
    overwrite: OverwriteOption = False,
    resume: ResumeOption = False,
    view: ViewOption = None,
    view_file: ViewFileOption = None,
    view_port: ViewPortOption = None,
) -> None:
    """Run several modes side by side against ground truth: table, plots, compare.json, report.html."""
    names = _mode_names(modes)
    changed = with_partial(settings, allow_partial)
    earlier = existing(overwrite=overwrite, resume=resume)
    with stoppable(partial(done_so_far, output)) as stop:
        recordings = [open_recording(dataset, robot, config=config, settings=changed) for dataset in datasets]
        if view is not None and len(recordings) > 1:
            raise ConfigError(f"--view shows one recording, not {len(recordings)}; compare one at a time")
        with opened_view(view, recordings[0], view_file, view_port) as shown, progress_bar() as progress:
            comparison = compare_recordings(
                recordings,
                names,
                output=output,
                progress=progress,
                done=_print,
                existing=earlier,
                stop=stop,
                view=shown,
            )
        _finish(comparison, output)


def _mode_names(text: str | None) -> list[str] | None:
    """The modes of ``--modes``; None without it.

    Raises:
        ConfigError: no name, or one that no mode has.
    """
    if text is None:
        return None
    names = list(dict.fromkeys(name.strip() for name in text.split(",") if name.strip()))
    if not names:
        raise ConfigError(f"--modes names no mode; there are: {', '.join(modes())}")
    for name in names:
        mode_of(name)  # a misspelt one is found before anything runs
    return names


def _print(compared: ComparedRecording) -> None:
    """What a recording came to."""
    print_run(compared.run.record, compared.run.folder, brief=True)
    print_table(compared.metrics, compared.title)
    print_ranking(compared.metrics, compared.recording.config.evaluation)
    print_failures(compared.failures)


def _finish(comparison: Comparison, output: Path) -> None:
    """The table over all where there are several, and the path of the report.

    Raises:
        DatasetError: a recording has no result.
    """
    print_failures(comparison.failures)
    if len(comparison.recordings) + len(comparison.failures) > 1:
        print_table_one(comparison.table)
    give(f"report: {output / 'report.html'}")
    if not can_draw():
        say(NO_FIGURES)
    failed = [name for name, one in comparison.recordings.items() if one.has_failed]
    without_result = [*comparison.failures, *failed]
    if without_result:
        raise DatasetError(f"no mode went through on {', '.join(without_result)}; the reasons are listed above")
