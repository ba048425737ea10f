# SPDX-License-Identifier: BSD-3-Clause
"""``python -m coclo_vio.experiments.faults -o OUT``: faults by modes, a matrix that goes on where it stopped.

Results are in OUT/COMMIT/jobs, a file a job; recordings in OUT/recordings are simulated where they are missing, and
kept. At the end it prints the table of what is finished. With ``--publish`` it writes docs/results/faults.json and the
pages.
"""

import argparse
import shlex
import sys
from dataclasses import replace
from pathlib import Path

from coclo_vio.experiments.bench.compilation import run_all_kernels
from coclo_vio.experiments.faults.fault_cases import MODES
from coclo_vio.experiments.faults.fault_plan import FaultPlan
from coclo_vio.experiments.faults.fault_record import FaultsRecord
from coclo_vio.experiments.faults.fault_recording import ROBOTS
from coclo_vio.experiments.faults.fault_summary import summarise
from coclo_vio.experiments.faults.fault_text import (
    amiss_lines,
    counts_sentence,
    event_head,
    event_rows,
    figure_head,
    figure_rows,
)
from coclo_vio.experiments.results.measuring import RESULTS
from coclo_vio.experiments.results.pages import render
from coclo_vio.experiments.results.provenance import Provenance, Provenances
from coclo_vio.experiments.resumable_jobs import run_units
from coclo_vio.experiments.studies.study import report
from coclo_vio.runs.modes.registry import mode_of
from coclo_vio.values.errors import CocloError

_MOST_WORKERS = 2
_FILE = "faults.json"


def main(arguments: list[str] | None = None) -> None:
    """Run what is left, print the tables, and publish them on request."""
    options = _parser().parse_args(arguments)
    try:
        for mode in options.modes.split(","):
            mode_of(mode)  # a misspelt one is found before anything runs
        seeds = range(options.first_seed, options.first_seed + options.seeds)
        robots, modes = tuple(options.robots.split(",")), tuple(options.modes.split(","))
        plan = FaultPlan(options.output.resolve(), robots, tuple(seeds), modes)
        command = _command(options)
        if options.finished_by is None:
            _run(plan, command, options)
        else:
            plan = replace(plan, commit=options.finished_by)
        record = summarise(plan, command)
        _print(record)
        record.write(plan.folder / plan.commit / _FILE)
        if options.publish:
            _publish(record, plan.finished()[-1].origin, Path.cwd())
    except CocloError as error:
        sys.exit(f"faults: {error}")


def _run(plan: FaultPlan, command: str, options: argparse.Namespace) -> None:
    """Run what is left of a plan."""
    work = plan.work(options.only)
    report(f"commit {plan.commit}: {sum(len(unit.jobs) for unit in work)} jobs are left")
    if work:
        run_all_kernels()  # compiles them once, not in each worker
    origin, workers = Provenance.now(command, Path.cwd()), min(options.workers, _MOST_WORKERS)
    for is_nominal in (True, False):  # runs without a fault come first: the others are compared with them
        run_units([unit for unit in work if unit.is_nominal is is_nominal], origin, workers, report)


def _print(record: FaultsRecord) -> None:
    for robot in record.seeds:
        print(f"\n{robot}")
        for row in (figure_head(record, robot), *figure_rows(record, robot)):
            print(" | ".join(row))
        for row in (event_head(record, robot), *event_rows(record, robot)):
            print(" | ".join(row))
    for line in (*amiss_lines(record), counts_sentence(record)):
        print(line)


def _publish(record: FaultsRecord, origin: Provenance, root: Path) -> None:
    """Write record and pages; the origin is that of the last job."""
    record.write(root / RESULTS / _FILE)
    known = root / RESULTS / "provenance.json"
    Provenances.read(known).with_entry(_FILE, origin).write(known)
    for page in render(root):
        print(f"wrote {page}")


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="faults", description=__doc__.partition("\n")[0] if __doc__ else None)
    parser.add_argument("-o", "--output", type=Path, required=True, help="folder of results and recordings")
    parser.add_argument("--seeds", type=int, default=1, help="how many seeds of each recording")
    parser.add_argument("--first-seed", type=int, default=1, help="the first of the seeds")
    parser.add_argument("--robots", default=",".join(ROBOTS), help="separated by commas")
    parser.add_argument("--modes", default=",".join(MODES), help="separated by commas")
    parser.add_argument("--only", default="", metavar="PATTERN", help="run only jobs whose name has this in it")
    parser.add_argument("--workers", type=int, default=1, help="processes, two at most")
    parser.add_argument("--finished-by", metavar="COMMIT", help="run nothing: show the jobs that this commit finished")
    parser.add_argument("--publish", action="store_true", help="write docs/results/faults.json and the pages")
    return parser


def _command(options: argparse.Namespace) -> str:
    """The line that runs the matrix, without where its files are and how many processes work."""
    words = ["python", "-m", "coclo_vio.experiments.faults", "-o", "OUT", "--seeds", str(options.seeds)]
    words += [] if options.first_seed == 1 else ["--first-seed", str(options.first_seed)]
    words += [] if options.robots == ",".join(ROBOTS) else ["--robots", options.robots]
    words += [] if options.modes == ",".join(MODES) else ["--modes", options.modes]
    return shlex.join(words)


if __name__ == "__main__":
    main()
