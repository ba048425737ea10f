# SPDX-License-Identifier: BSD-3-Clause
"""The command that diagnoses a recording: ``doctor``."""

from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table
from rich.text import Text

from coclo_vio.api.recording import open_recording
from coclo_vio.cli.options import ConfigOption, JsonOption, PartialOption, RobotOption, SetOption, with_partial
from coclo_vio.cli.terminal import give, give_json, out, say
from coclo_vio.diagnosis.diagnose import Diagnosis
from coclo_vio.runs.diagnosis_page import write_page
from coclo_vio.runs.examination import Examination, write_settings

_STYLES = {"good": "green", "warning": "yellow", "error": "red"}


def doctor(
    dataset: Annotated[Path, typer.Argument(help="Recording: folder or file.")],
    robot: RobotOption = None,
    config: ConfigOption = None,
    settings: SetOption = None,
    allow_partial: PartialOption = False,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="Folder for the page with the plots; none if not given.")
    ] = None,
    fix: Annotated[
        Path | None,
        typer.Option("--fix", help="Write the settings that certainly correct something into this YAML configuration."),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Find what physics, the recording itself or the robot's description contradict, and what corrects it."""
    recording = open_recording(dataset, robot, config=config, settings=with_partial(settings, allow_partial))
    examination = recording.diagnose()
    if as_json:
        give_json(examination.to_json())
    else:
        _show(recording.name, examination)
    if output is not None:
        say(f"page: {write_page(output, recording.name, examination)}")
    if fix is not None and not examination.settings:
        say(f"settings: nothing is certain, {fix} was not written")
    elif fix is not None:
        say(f"settings: {write_settings(fix, examination.settings)}; use it with --config {fix}")
    remaining = examination.corrected if fix is not None else examination.diagnosis
    if remaining.errors and not allow_partial:
        raise typer.Exit(1)


def _show(name: str, examination: Examination) -> None:
    out.print(Text(f"{name}: {_verdict(examination)}", style="bold"))
    out.print(_table(examination.diagnosis))
    if not examination.settings:
        return
    out.print("Settings that certainly correct something (--fix FILE writes them):")
    for setting in examination.settings:
        give(f"  --set '{setting}'")
    if examination.corrected.findings:
        out.print("Left with them:")
        out.print(_table(examination.corrected))
    else:
        out.print("With them nothing is left to correct.")


def _verdict(examination: Examination) -> str:
    errors = len(examination.diagnosis.errors)
    warnings = len(examination.diagnosis.findings) - errors
    if not errors and not warnings:
        return "nothing is wrong"
    return f"{errors} error{'s' * (errors != 1)}, {warnings} warning{'s' * (warnings != 1)}"


def _table(diagnosis: Diagnosis) -> Table:
    table = Table.grid(padding=(0, 2))
    table.add_column(style="bold", no_wrap=True)
    table.add_column(no_wrap=True)
    table.add_column(overflow="fold")
    for stage, checks in diagnosis.checked.items():
        found = diagnosis.of_stage(stage)
        measured = [each.sentence for each in diagnosis.notes if each.stage is stage]
        if not found:
            table.add_row(stage.value, Text("good", _STYLES["good"]), Text("; ".join(measured or checks), "dim"))
        for number, finding in enumerate(found):
            severity = finding.severity.value
            table.add_row(stage.value if number == 0 else "", Text(severity, _STYLES[severity]), Text(finding.sentence))
    return table
