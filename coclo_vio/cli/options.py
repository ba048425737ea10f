# SPDX-License-Identifier: BSD-3-Clause
"""Options that several commands share."""

from pathlib import Path
from typing import Annotated

import typer

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
JsonOption = Annotated[bool, typer.Option("--json", help="Print JSON instead of a table.")]


def with_partial(settings: list[str] | None, allow_partial: bool) -> list[str]:
    """The settings, and that of ``--allow-partial`` where that is given."""
    return [*(settings or ()), *(["dataset.allow_partial=true"] if allow_partial else [])]
