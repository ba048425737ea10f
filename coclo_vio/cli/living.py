# SPDX-License-Identifier: BSD-3-Clause
"""The command that runs on a wire: ``live``."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Event
from typing import Annotated

import typer

from coclo_vio.cli.mode_help import MODES_PLACE
from coclo_vio.cli.options import (
    ConfigOption,
    OutOption,
    OverwriteOption,
    RobotOption,
    SetOption,
    ViewFileOption,
    ViewOption,
    ViewPortOption,
)
from coclo_vio.cli.terminal import give
from coclo_vio.cli.view_command import opened_view
from coclo_vio.live.latency_histogram import LatencyRecord
from coclo_vio.live.live_record import LiveRecord
from coclo_vio.live.open_wire import configured_for, open_wire
from coclo_vio.live.preparation import given_calibrations
from coclo_vio.live.session import LiveSettings, run_live
from coclo_vio.runs import run_folder
from coclo_vio.runs.modes.registry import mode_of
from coclo_vio.runs.observers import Observers
from coclo_vio.runs.run_config import resolve
from coclo_vio.runs.run_record import RunRecord
from coclo_vio.runs.warm_up import warm_up
from coclo_vio.values.errors import DatasetError


def live(
    source: Annotated[str, typer.Option("--source", "-s", help="One of: zenoh, dds, unitree, file.")],
    mode: Annotated[str, typer.Option("--mode", "-m", help=f"One of: {MODES_PLACE}.")],
    endpoint: Annotated[
        str | None, typer.Option("--endpoint", help="Of zenoh, such as tcp/localhost:7447; or the growing file.")
    ] = None,
    domain: Annotated[int, typer.Option("--domain", min=0, max=232, help="ROS_DOMAIN_ID.")] = 0,
    robot: RobotOption = None,
    calibration: Annotated[
        Path | None, typer.Option("--calibration", help="A recording with calibrations, or a camchain of Kalibr.")
    ] = None,
    config: ConfigOption = None,
    settings: SetOption = None,
    output: OutOption = Path("out"),
    overwrite: OverwriteOption = False,
    seconds: Annotated[
        float | None, typer.Option("--seconds", min=0.0, help="End after this time; otherwise at Ctrl-C.")
    ] = None,
    view: ViewOption = None,
    view_file: ViewFileOption = None,
    view_port: ViewPortOption = None,
) -> None:
    """Run one mode on messages as they come: zenoh, DDS, Unitree or a growing file.

    Odometry, tf and diagnostics go out on the same wire.
    """
    chosen = mode_of(mode)
    if not overwrite:
        run_folder.check_free(output, run_folder.WITHOUT_RESUME)
    resolved = configured_for(source, resolve(robot, config, settings or ()))
    given, resolved = given_calibrations(calibration, resolved)
    if chosen.has_legs:
        warm_up(resolved)
    with opened_view(view, resolved.robot, view_file, view_port) as shown, _stopped_by_signals() as stop:
        wire = open_wire(source, endpoint, domain, resolved)
        give(f"waiting for {wire.source.name}")
        observers = Observers(view=shown)
        run_settings = LiveSettings(chosen, resolved, output, given, seconds, stop.event.is_set, observers)
        record, counted = run_live(wire.source, wire.sinks, wire.types, run_settings)
    _print(record, counted, output)
    first = record.estimators[chosen.trajectory_names[0]]
    if first.failure:
        raise DatasetError(f"the run stopped early, its estimates up to there are in {output}: {first.failure}")
    if stop.number is not None:
        raise typer.Exit(128 + stop.number)
    if not first.estimates:
        raise DatasetError(f"{mode} gave no estimate for the {first.measurements} samples of {wire.source.name}")


class _Stop:
    """Whether a signal asked for the end, and which."""

    def __init__(self) -> None:
        self.event = Event()
        self.number: int | None = None

    def by(self, number: int, _frame: object) -> None:
        """A signal came; a second one ends the process as usual."""
        self.number = number
        self.event.set()
        signal.signal(number, signal.SIG_DFL)


@contextmanager
def _stopped_by_signals() -> Iterator[_Stop]:
    stop = _Stop()
    before = {number: signal.signal(number, stop.by) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield stop
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _print(record: RunRecord, counted: LiveRecord, output: Path) -> None:
    for topic, came in counted.topics.items():
        refused = sum(came.refused.values())
        give(
            f"{topic}: {came.received} received, {came.lost} lost, {came.late} late, {came.dropped} dropped, "
            f"{refused} refused; {_text(came.latency)} under way"
        )
    for name, latency in counted.estimates.items():
        give(f"{name}: estimates {_text(latency)} after their samples")
    for name, trajectory in record.estimators.items():
        give(f"{name}: {trajectory.estimates} estimates")
    give(f"run folder: {output}")


def _text(latency: LatencyRecord | None) -> str:
    if latency is None:
        return "an unknown time"
    return f"{latency.p50_ms:.2f} ms (median), {latency.p99_ms:.2f} ms (99 %)"
