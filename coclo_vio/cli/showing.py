# SPDX-License-Identifier: BSD-3-Clause
"""The commands that show: ``inspect``, ``benchmark``, ``config``, ``robots``."""

import os
import sys
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Annotated

import typer
import yaml
from rich.box import SIMPLE_HEAD
from rich.table import Table

from coclo_vio.api.recording import open_recording
from coclo_vio.cli.inspection_view import drawn
from coclo_vio.cli.options import ConfigOption, JsonOption, PartialOption, RobotOption, SetOption, with_partial
from coclo_vio.cli.terminal import give_json, out
from coclo_vio.robot.description import load_robot, robot_names
from coclo_vio.runs.run_config import resolve

_ONE_THREAD = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}


def inspect(
    dataset: Annotated[Path, typer.Argument(help="Recording: folder or file.")],
    robot: RobotOption = None,
    config: ConfigOption = None,
    settings: SetOption = None,
    allow_partial: PartialOption = False,
    as_json: JsonOption = False,
) -> None:
    """List what a recording holds: streams, gaps, clock jumps, joints, calibrations, and what modes lack."""
    changed = with_partial(settings, allow_partial)
    inspection = open_recording(dataset, robot, config=config, settings=changed).inspect()
    if as_json:
        give_json(inspection.to_json())
    else:
        out.print(*drawn(inspection), sep="\n")


def benchmark(
    as_json: JsonOption = False,
    seconds: Annotated[float, typer.Option(min=2.0, help="Length of the walk that is timed, s.")] = 8.0,
    rounds: Annotated[int, typer.Option(min=1, help="How often; the best counts.")] = 3,
    vision_seconds: Annotated[float, typer.Option(min=1.0, help="How much of the sample is tracked, s.")] = 15.0,
) -> None:
    """Time filter, front end and smoother on one core, beside filterpy if installed."""
    from coclo_vio.experiments.benchmark import run_benchmark  # noqa: PLC0415 -- loads what it compares with

    os.environ.update(_ONE_THREAD)
    with ProcessPoolExecutor(1, get_context("spawn")) as fresh:  # NumPy takes its number of threads as it is loaded
        figures = fresh.submit(run_benchmark, seconds, rounds, vision_seconds).result()
    if as_json:
        give_json(figures)
        return
    table = Table("figure", "value")
    for name, value in figures.items():
        table.add_row(name, "-" if value is None else f"{value:.4g}")
    out.print(table)


def config(
    robot: RobotOption = None,
    config: ConfigOption = None,
    settings: SetOption = None,
) -> None:
    """Print the resolved configuration as YAML; every key can be changed with --set."""
    resolved = resolve(robot, config, settings or (), guess="daisy")
    sys.stdout.write(yaml.safe_dump(resolved.model_dump(mode="json"), sort_keys=False))


def robots() -> None:
    """List the known robots."""
    table = Table("robot", "legs", "joints", "contact from", box=SIMPLE_HEAD, pad_edge=False)
    table.add_column("URDF", overflow="fold")
    for name in robot_names():
        known = load_robot(name)
        extra = " (extra robots)" if known.urdf.startswith("example-robot-data:") else ""
        urdf = f"{Path(known.urdf).name}{extra}"
        table.add_row(name, ", ".join(known.leg_names), str(len(known.joint_names)), known.contact.source, urdf)
    out.print(table)
    out.print("Your own robot: a URDF and a few lines of YAML, given with --robot my_robot.yaml; see the README.")
