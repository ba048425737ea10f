# SPDX-License-Identifier: BSD-3-Clause
"""All commands under one name, and what becomes of errors: one sentence and a status instead of a traceback."""

import sys
from typing import Annotated

import typer

from coclo_vio import __version__
from coclo_vio.cli import comparing, estimating, showing, simulating, tabling
from coclo_vio.cli.terminal import err, out
from coclo_vio.values.errors import CocloError, ConfigError

app = typer.Typer(
    name="coclo-vio",
    help="Where a legged robot is, from what it feels and what it sees.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)
for _command in (
    comparing.demo,
    estimating.run,
    comparing.compare,
    estimating.evaluate,
    simulating.simulate,
    tabling.table,
    showing.inspect,
    showing.benchmark,
    showing.config,
    showing.robots,
):
    app.command()(_command)


def main() -> None:
    """Entry of the console script."""
    try:
        app()
    except ConfigError as error:
        _fail(error, 2)
    except CocloError as error:
        _fail(error, 1)


def _fail(error: CocloError, status: int) -> None:
    sentence = " ".join(line.strip() for line in str(error).splitlines())  # a YAML error shows its place below
    err.print(f"coclo-vio: {sentence}", markup=False, highlight=False, soft_wrap=True)
    sys.exit(status)


@app.callback(invoke_without_command=True)
def _version(version: Annotated[bool, typer.Option("--version", help="Print the version.")] = False) -> None:
    if version:
        out.print(__version__)
        raise typer.Exit
