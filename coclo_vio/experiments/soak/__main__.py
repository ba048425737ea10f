# SPDX-License-Identifier: BSD-3-Clause
"""``python -m coclo_vio.experiments.soak -o OUT``: play a recording round after round, write ``soak.json`` and a plot.

The end of a round is joined to the next one's start: time goes on, and the estimators take what is between as a pause
of half a second without any measurement. So the robot should stand at both ends, as it does in a whole simulated trial
(``coclo-vio simulate trot``); the bundled sample ends on a step.
"""

import argparse
import math
import sys
from pathlib import Path

from coclo_vio.datasets.dataset import open_dataset
from coclo_vio.datasets.sample import sample_path
from coclo_vio.evaluation.figure_style import NO_FIGURES, can_draw
from coclo_vio.experiments.soak.soak_figure import plot_soak
from coclo_vio.experiments.soak.soak_record import SoakRecord, soak_record
from coclo_vio.runs import run_folder
from coclo_vio.runs.inspection import resolve_if_known
from coclo_vio.runs.paced_feed import PacedFeed
from coclo_vio.runs.paced_play import play_mode
from coclo_vio.runs.paced_source import Pace
from coclo_vio.runs.run_config import RunConfig
from coclo_vio.runs.run_folder import Existing
from coclo_vio.runs.running import Ending
from coclo_vio.values.errors import CocloError
from coclo_vio.values.units import NS_PER_S

_INTERVALS = 360  # of which memory and time are kept
_SHORTEST_S = 1.0


def main() -> None:
    """Measure what the arguments ask for."""
    arguments = _arguments()
    try:
        path = arguments.recording or sample_path()
        config, _ = resolve_if_known(path, arguments.robot, None, arguments.set)
        record = soak(path, config, arguments.mode, arguments.minutes, arguments.rate, arguments.output)
        if can_draw():
            print(plot_soak(record, arguments.output / "soak.png"))
        else:
            print(NO_FIGURES)
    except CocloError as error:
        sys.exit(f"soak: {error}")
    for name, growth in (("memory", record.memory_mb), ("processor time a sample", record.cpu_ms_per_sample)):
        if growth is not None:
            print(f"{name}: {growth.early:.4g} to {growth.late:.4g}, {growth.growth_percent:+.1f} %")
    for name, spread in record.latency.trajectories.items():
        print(f"{name}: latency p50 {spread.p50_ms} ms, p95 {spread.p95_ms} ms, p99 {spread.p99_ms} ms")
    print(arguments.output / "soak.json")


def soak(path: Path, config: RunConfig, mode: str, minutes: float, rate: float, output: Path) -> SoakRecord:
    """Play a recording for so many minutes; the run folder is ``output/run``, the record ``output/soak.json``.

    Raises:
        CocloError: the recording or the robot is at fault, or the mode lacks what it needs.
    """
    report = open_dataset(path, config.robot, config.dataset).report()
    begin_ns, end_ns = min(one.start_ns for one in report.streams), max(one.end_ns for one in report.streams)
    pause_s = Pace().pause_s
    period_ns = end_ns - begin_ns + round(pause_s * NS_PER_S)
    seconds = 60.0 * minutes * rate
    pace = Pace(rate, seconds, 1 + math.ceil(seconds / (period_ns / NS_PER_S)), pause_s)
    feed = PacedFeed(pace, interval_s=max(60.0 * minutes / _INTERVALS, _SHORTEST_S))
    run, latency = play_mode(path, mode, config, output / "run", feed, ending=Ending(Existing.OVERWRITE))
    truth = run_folder.read_ground_truth(output / "run", run)
    estimates = {
        name: run_folder.read_estimates(output / "run", name).trajectory
        for name, one in run.estimators.items()
        if one.estimates
    }
    record = soak_record(path.name, latency, estimates, None if truth is None else truth.trajectory, period_ns)
    record.write(output / "soak.json")
    return record


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="python -m coclo_vio.experiments.soak", description=(__doc__ or "").partition("\n")[0]
    )
    parser.add_argument("-o", "--output", type=Path, required=True, help="folder for soak.json, soak.png and the run")
    parser.add_argument("--minutes", type=float, default=60.0, help="of wall time")
    parser.add_argument("--rate", type=float, default=1.0, help="seconds of recording per second")
    parser.add_argument("--recording", type=Path, help="the bundled sample if not given")
    parser.add_argument("--robot", help="known robot, or the path of its YAML")
    parser.add_argument("--mode", default="combined")
    parser.add_argument("--set", action="append", default=[], help="one value of the configuration")
    return parser.parse_args()


if __name__ == "__main__":
    main()
