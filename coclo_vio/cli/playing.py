# SPDX-License-Identifier: BSD-3-Clause
"""The command ``play``: a recording fed by its stamps, and what that takes in time."""

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Annotated

import typer
from rich.box import SIMPLE_HEAD
from rich.table import Table

from coclo_vio.api.play import Play
from coclo_vio.api.play import play as play_recording
from coclo_vio.api.recording import Recording, open_recording
from coclo_vio.cli.options import (
    ConfigOption,
    JsonOption,
    ModeOption,
    OutOption,
    OverwriteOption,
    PartialOption,
    RobotOption,
    SetOption,
    ViewFileOption,
    ViewOption,
    ViewPortOption,
    existing,
    with_partial,
)
from coclo_vio.cli.printing import print_failures, print_run, print_table, progress_bar
from coclo_vio.cli.stopping import done_so_far, stoppable
from coclo_vio.cli.terminal import give_json, out, say
from coclo_vio.cli.view_command import opened_view
from coclo_vio.runs.comparison_report import report_title
from coclo_vio.runs.latency import LatencyRecord, Spread
from coclo_vio.runs.paced_feed import MAX_LAG_S
from coclo_vio.runs.paced_play import LATENCY_JSON, paced_feed
from coclo_vio.runs.running import Ending
from coclo_vio.values.errors import DatasetError


def play(
    dataset: Annotated[Path, typer.Argument(help="Recording: folder or file.")],
    mode: ModeOption = None,
    rate: Annotated[float, typer.Option("--rate", help="Seconds of recording per second.")] = 1.0,
    seconds: Annotated[float | None, typer.Option("--seconds", help="Play so much of the recording, s.")] = None,
    max_lag_s: Annotated[
        float, typer.Option("--max-lag", help="Leave out an image that has waited for longer, s.")
    ] = MAX_LAG_S,
    robot: RobotOption = None,
    config: ConfigOption = None,
    settings: SetOption = None,
    allow_partial: PartialOption = False,
    output: OutOption = Path("out"),
    overwrite: OverwriteOption = False,
    view: ViewOption = None,
    view_file: ViewFileOption = None,
    view_port: ViewPortOption = None,
    as_json: JsonOption = False,
) -> None:
    """Play a recording to one mode by its stamps, as drivers would, and measure latencies and load."""
    feed = paced_feed(rate, seconds, max_lag_s=max_lag_s)
    with stoppable(partial(done_so_far, output, can_resume=False)) as stop:
        recording = open_recording(dataset, robot, config=config, settings=with_partial(settings, allow_partial))
        ending = Ending(existing(overwrite=overwrite, resume=False), stop)
        with opened_view(view, recording, view_file, view_port) as shown, progress_bar() as progress:
            played = play_recording(
                recording, mode, rate=feed, folder=output, sink=shown, progress=progress, existing=ending
            )
    _show(played, recording, output, as_json=as_json)


def _show(played: Play, recording: Recording, output: Path, *, as_json: bool) -> None:
    """What was played and its times.

    Raises:
        DatasetError: it stopped early.
    """
    done, latency = played.run, played.latency
    if as_json:
        give_json(latency.to_json())
    else:
        print_run(done.record, output)
        _print_latency(latency)
        first = done.record.estimators[done.names[0]]
        if done.record.ground_truth is not None and first.estimates:
            evaluations, failures = done.evaluated(config=recording.config.evaluation)
            print_table(evaluations, report_title(recording.name, recording.config))
            print_failures(failures)
    say(f"times: {output / LATENCY_JSON}")
    failure = done.record.estimators[done.names[0]].failure
    if failure:
        raise DatasetError(f"the run stopped early, its estimates up to there are in {output}: {failure}")


def _print_latency(latency: LatencyRecord) -> None:
    """Latencies and pushes as one table, then load and what was left out."""
    table = Table(box=SIMPLE_HEAD, title=f"times of {latency.mode} at rate {latency.rate:g}, ms")
    table.add_column("from due to")
    table.add_column("of")
    for name in ("number", "p50", "p95", "p99", "max"):
        table.add_column(name, justify="right")
    for what, spreads in (
        ("estimate", latency.trajectories),
        ("push done", latency.streams),
        ("(push alone)", latency.pushes),
        ("(its processor time)", latency.pushes_cpu),
    ):
        _add_rows(table, what, spreads)
    out.print(table)
    say(
        f"waited at most: {latency.waiting_most} measurements; left out before the estimator: {latency.left_out} "
        f"images, {latency.joints_left_out} joint samples"
    )
    for name in dict.fromkeys(name for one in latency.intervals for name in one.processes):  # some end before others
        loads = [one.processes[name] for one in latency.intervals if name in one.processes]
        cpu = sum(load.cpu_percent for load in loads) / len(loads)
        say(f"process {name}: {cpu:.0f} % of a core, {loads[0].rss_mb:.0f} to {loads[-1].rss_mb:.0f} MiB")


def _add_rows(table: Table, what: str, spreads: Mapping[str, Spread]) -> None:
    for name, spread in spreads.items():
        cells = (spread.p50_ms, spread.p95_ms, spread.p99_ms, spread.max_ms)
        figures = ["-" if cell is None else f"{cell:.2f}" for cell in cells]
        table.add_row(what, name, str(spread.count), *figures)
