# SPDX-License-Identifier: BSD-3-Clause
"""All commands under one name, and what becomes of errors: one sentence and a status instead of a traceback.

A command's module is imported when the command runs, so that ``--help`` and ``--version`` load no stage.
"""

import errno
import os
import sys
from importlib import import_module
from typing import Annotated, Any, NamedTuple

import typer
from typer.core import TyperCommand, TyperGroup
from typer.main import get_command

from coclo_vio import __version__
from coclo_vio.cli.mode_help import ModeCommand
from coclo_vio.cli.terminal import err, out
from coclo_vio.values.errors import CocloError, ConfigError, DatasetError, shortened

_THREAD_COUNTS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")  # read as NumPy is loaded


class _Entry(NamedTuple):
    """Where a command is defined, and the first line of its help."""

    module: str
    summary: str


COMMANDS = {
    "demo": _Entry(
        "comparing",
        "Compare the estimators on the bundled recording of a Daisy that climbs stairs: table, plots, report.",
    ),
    "run": _Entry("estimating", "Run one mode on a recording; with ground truth, print its drift."),
    "live": _Entry("living", "Run one mode on messages as they come: zenoh, DDS, Unitree or a growing file."),
    "play": _Entry(
        "playing", "Play a recording to one mode by its stamps, as drivers would, and measure latencies and load."
    ),
    "compare": _Entry(
        "comparing", "Run several modes side by side against ground truth: table, plots, compare.json, report.html."
    ),
    "evaluate": _Entry("estimating", "Measure trajectories against ground truth."),
    "simulate": _Entry(
        "simulating",
        "Simulate a trial: a robot walks, records and is tracked by Vicon; the truth is kept apart.",
    ),
    "table": _Entry("tabling", "The paper's Table I over simulated trials; a stopped run is resumed."),
    "inspect": _Entry(
        "showing", "List what a recording holds: streams, gaps, clock jumps, joints, calibrations, and what modes lack."
    ),
    "doctor": _Entry(
        "examining",
        "Find what physics, the recording itself or the robot's description contradict, and what corrects it.",
    ),
    "view": _Entry("view_command", "Write a run into a file for Foxglove or Rerun, or an animated image of it."),
    "adopt": _Entry("adopting", "Find the description of a robot in its URDF and a log, and write it as YAML."),
    "benchmark": _Entry("showing", "Time filter, front end and smoother on one core, beside filterpy if installed."),
    "config": _Entry("showing", "Print the resolved configuration as YAML; every key can be changed with --set."),
    "robots": _Entry("showing", "List the known robots."),
}


class _LazyGroup(TyperGroup):
    """Commands by name, each imported when it is needed."""

    _lists = False

    def list_commands(self, ctx: Any) -> list[str]:
        """All names, in the order of the table."""
        return list(COMMANDS)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """The command; in the listing of all commands only its name and summary."""
        entry = COMMANDS.get(cmd_name)
        if entry is None:
            return None
        if self._lists:
            return TyperCommand(cmd_name, help=entry.summary)
        function = getattr(import_module(f"coclo_vio.cli.{entry.module}"), cmd_name)
        single = typer.Typer(add_completion=False, pretty_exceptions_enable=False)
        single.command(cmd_name, cls=ModeCommand)(function)
        return get_command(single)

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """The listing of all commands."""
        self._lists = True
        try:
            super().format_help(ctx, formatter)
        finally:
            self._lists = False


app = typer.Typer(
    name="coclo-vio",
    cls=_LazyGroup,
    help="Estimates where a legged robot is, from its joints, its IMU and its stereo cameras.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)


def main() -> None:
    """Entry of the console script."""
    for name in _THREAD_COUNTS:
        os.environ.setdefault(name, "1")  # matrices are small: further threads would only wait for one another
    try:
        app()
    except ConfigError as error:
        _fail(error, 2)
    except CocloError as error:
        _fail(error, 1)
    except OSError as error:
        if error.errno != errno.ENAMETOOLONG:
            raise
        _fail(DatasetError(f"a path is longer than this system allows: {shortened(error.filename)}"), 1)


def _fail(error: CocloError, status: int) -> None:
    sentence = " ".join(line.strip() for line in str(error).splitlines())  # a YAML error has its place on further lines
    err.print(f"coclo-vio: {sentence}", markup=False, highlight=False, soft_wrap=True)
    sys.exit(status)


def _print_version(is_given: bool) -> None:
    if is_given:
        out.print(__version__)
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[  # eager: before typer reads any other parameter, which would load pydantic
        bool, typer.Option("--version", help="Print the version.", is_eager=True, callback=_print_version)
    ] = False,
) -> None:
    """What stands before the command."""
