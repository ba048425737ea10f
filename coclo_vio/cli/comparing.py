# SPDX-License-Identifier: BSD-3-Clause
"""The commands that run several modes side by side: ``demo``, ``compare``."""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

from coclo_vio.api.comparison import (
    ComparedRecording,
    Comparison,
    check_comparable,
    compare_one,
    distinct_names,
    result_folders,
)
from coclo_vio.api.recording import Recording, open_recording
from coclo_vio.cli.mode_help import MODES_PLACE
from coclo_vio.cli.options import (
    ConfigOption,
    OutOption,
    PartialOption,
    RobotOption,
    SetOption,
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
from coclo_vio.cli.terminal import give, say
from coclo_vio.datasets.sample import DURATION_S, LENGTH_M, sample_path
from coclo_vio.evaluation.figure_style import NO_FIGURES, can_draw
from coclo_vio.runs.modes.registry import mode_of, modes
from coclo_vio.values.errors import CocloError, ConfigError, DatasetError


def demo(output: OutOption = Path("demo_out")) -> None:
    """Compare the estimators on the bundled recording of a Daisy that climbs stairs: table, plots, report."""
    recording = open_recording(sample_path(), "daisy")
    say(
        f"the bundled recording: {DURATION_S:.0f} s of a simulated hexapod Daisy that climbs stairs, {LENGTH_M:.1f} m; "
        f"{len(recording.modes)} estimators run one after the other on one core, which takes one to two minutes"
    )
    compared = _compare_and_print(recording, None, recording.name, output, DURATION_S)
    _finish([compared], output)


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
) -> None:
    """Run several modes side by side against ground truth: table, plots, compare.json, report.html."""
    names = _mode_names(modes)
    changed = with_partial(settings, allow_partial)
    recordings = [open_recording(dataset, robot, config=config, settings=changed) for dataset in datasets]
    for recording in recordings:
        check_comparable(recording, names)
    compared, failed = [], []
    folders, titles = result_folders(recordings, output), distinct_names(recordings)
    for recording, name, folder in zip(recordings, titles, folders, strict=True):
        try:
            compared.append(_compare_and_print(recording, names, name, folder))
        except CocloError as error:
            if len(recordings) == 1:
                raise
            print_failures({name: str(error)})
            failed.append(str(recording.path))
    _finish(compared, output, failed)


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


def _compare_and_print(
    recording: Recording, names: Sequence[str] | None, name: str, folder: Path, total_s: float | None = None
) -> ComparedRecording:
    """Run, measure, print, and write the report of one recording."""
    with progress_bar(total_s) as progress:
        compared = compare_one(recording, names, name=name, folder=folder, progress=progress)
    print_run(compared.run.record, folder, brief=True)
    print_table(compared.metrics, compared.title)
    print_ranking(compared.metrics, recording.config.evaluation)
    print_failures(compared.failures)
    compared.write_report()
    return compared


def _finish(compared: Sequence[ComparedRecording], output: Path, failed: Sequence[str] = ()) -> None:
    """The table over all where there are several, and the path of the report.

    Raises:
        DatasetError: a recording has no result.
    """
    comparison = Comparison.of(compared)
    if len(compared) + len(failed) > 1 and compared:
        print_table_one(comparison.table)
        give(f"report: {comparison.write_index(output)}")
    elif compared:
        give(f"report: {compared[0].run.folder / 'report.html'}")
    if compared and not can_draw():
        say(NO_FIGURES)
    without_result = [*failed, *(str(one.recording.path) for one in compared if one.has_failed)]
    if without_result:
        raise DatasetError(f"no mode went through on {', '.join(without_result)}; the reasons are listed above")
