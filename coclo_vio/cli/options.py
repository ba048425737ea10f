# SPDX-License-Identifier: BSD-3-Clause
"""Options that several commands share."""

from pathlib import Path
from typing import Annotated

import typer

from coclo_vio.cli.mode_help import DEFAULTS_PLACE, MODES_PLACE
from coclo_vio.runs.run_folder import Existing
from coclo_vio.values.errors import ConfigError

ModeOption = Annotated[
    str | None,
    typer.Option("--mode", "-m", help=f"One of: {MODES_PLACE}. Default: {DEFAULTS_PLACE}, by what there is."),
]
RobotOption = Annotated[str | None, typer.Option("--robot", "-r", help="Known robot, or the path of its YAML.")]
ConfigOption = Annotated[Path | None, typer.Option("--config", "-c", help="YAML configuration.")]
SetOption = Annotated[list[str] | None, typer.Option("--set", help="One value, such as filter.profile=paper.")]
OutOption = Annotated[Path, typer.Option("--output", "-o", help="Folder for the results.")]
PartialOption = Annotated[
    bool,
    typer.Option(
        "--allow-partial", help="Use what can be read of a damaged recording, and readings that contradict physics."
    ),
]
OverwriteOption = Annotated[
    bool, typer.Option("--overwrite", help="Replace the results of an earlier run in the folder.")
]
ResumeOption = Annotated[
    bool, typer.Option("--resume", help="Go on with a run in the folder that was killed or stopped.")
]
ViewOption = Annotated[
    str | None,
    typer.Option("--view", help="Show it while it runs: foxglove or rerun (extra view); or animation, a file only."),
]
ViewFileOption = Annotated[
    Path | None,
    typer.Option("--view-file", help="What the view writes: .mcap of foxglove, .rrd of rerun, .webp of animation."),
]
ViewPortOption = Annotated[
    int | None, typer.Option("--view-port", help="Where the view serves; without file and port the usual one.")
]
JsonOption = Annotated[bool, typer.Option("--json", help="Print JSON instead of a table.")]


def existing(*, overwrite: bool, resume: bool) -> Existing:
    """What becomes of results that are in the folder already.

    Raises:
        ConfigError: both options are given.
    """
    if overwrite and resume:
        raise ConfigError("--overwrite begins anew and --resume goes on: give one of the two")
    return Existing.OVERWRITE if overwrite else Existing.RESUME if resume else Existing.REFUSE


def with_partial(settings: list[str] | None, allow_partial: bool) -> list[str]:
    """The settings, and that of ``--allow-partial`` where that is given."""
    return [*(settings or ()), *(["dataset.allow_partial=true"] if allow_partial else [])]
