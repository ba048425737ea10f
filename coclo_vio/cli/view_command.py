# SPDX-License-Identifier: BSD-3-Clause
"""The view of a command that runs something, and the command that shows a run afterwards: ``view``."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import typer

from coclo_vio.api.recording import Recording
from coclo_vio.api.viewing import open_view, view_run
from coclo_vio.cli.terminal import give, say
from coclo_vio.robot.description import RobotDescription
from coclo_vio.values.errors import ConfigError
from coclo_vio.views.opening import file_suffix, usual_port
from coclo_vio.views.view import View


@contextmanager
def opened_view(
    kind: str | None, of: Recording | RobotDescription | None, file: Path | None, port: int | None
) -> Iterator[View | None]:
    """The view of the options, closed in the end; None without ``--view``.

    Args:
        kind: of ``--view``.
        of: the recording that is shown, or on a wire the robot; None: neither.
        file: of ``--view-file``.
        port: of ``--view-port``.

    Raises:
        ConfigError: a file or port without a view, or as ``open_view``.
    """
    if kind is None:
        if file is not None or port is not None:
            raise ConfigError("--view-file and --view-port belong to a view; add --view foxglove, rerun or animation")
        yield None
        return
    view = open_view(kind, of, file=file, port=port)
    if file is None or port is not None:
        say(f"view: {kind} serves at 127.0.0.1:{usual_port(kind) if port is None else port} while this runs")
    try:
        yield view
    finally:
        view.close()
        if file is not None:
            give(f"view: {file}")


def view(
    run_folder: Annotated[Path, typer.Argument(help="Folder that run or compare wrote.")],
    to: Annotated[str, typer.Option("--to", help="foxglove, rerun or animation.")] = "foxglove",
    file: Annotated[
        Path | None, typer.Option("--file", help="Default: view.mcap, .rrd or .webp in the folder.")
    ] = None,
) -> None:
    """Write a run into a file for Foxglove or Rerun, or an animated image of it."""
    give(f"view: {view_run(run_folder, to, file=file or run_folder / f'view{file_suffix(to)}')}")
