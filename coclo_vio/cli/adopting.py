# SPDX-License-Identifier: BSD-3-Clause
"""The command that finds a robot's description: ``adopt``."""

import shlex
from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from coclo_vio.api.robot_adoption import adopt as adopt_robot
from coclo_vio.cli.options import SetOption
from coclo_vio.cli.terminal import give, out, say


def adopt(
    urdf: Annotated[Path, typer.Argument(help="The robot's URDF file.")],
    recording: Annotated[Path, typer.Argument(help="A log of its joints and IMU: a stand, some steps, a turn.")],
    output: Annotated[Path, typer.Option("--output", "-o", help="YAML file for the description.")] = Path("robot.yaml"),
    settings: SetOption = None,
) -> None:
    """Find the description of a robot in its URDF and a log, and write it as YAML."""
    adoption = adopt_robot(urdf, recording, output, settings=settings or ())
    table = Table("field", "value", "confidence", "from")
    for field in adoption.fields:
        mark = "" if field.is_sure else " ?"
        table.add_row(field.key, field.value, f"{field.confidence:.2f}{mark}", field.reason)
    out.print(table)
    for note in adoption.notes:
        say(f"check: {note}")
    for link, reason in adoption.ignored.items():
        say(f"no leg: {link}, {reason}")
    unsure = len(adoption.questions)
    give(f"{output} written; {unsure} of {len(adoption.fields)} fields are marked with ? and have to be checked.")
    needed = "".join(f" --set {shlex.quote(setting)}" for setting in (*(settings or ()), *adoption.settings))
    give(f"coclo-vio run {shlex.quote(str(recording))} --robot {shlex.quote(str(output))}{needed}")
