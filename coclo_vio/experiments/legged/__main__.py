# SPDX-License-Identifier: BSD-3-Clause
"""``python -m coclo_vio.experiments.legged -o OUT``: the benchmark of legged odometry, which goes on where it stopped.

Results are in OUT/COMMIT/jobs, a file a job; simulated recordings in OUT/recordings are kept. At the end it prints the
table of what is finished. With ``--publish`` it prints the difference to the last committed record, and writes
docs/results/legged.json, the figure of impacts, and the pages.
"""

import argparse
import shlex
import sys
from pathlib import Path

from coclo_vio.evaluation.figure_style import save_png
from coclo_vio.experiments.bench.compilation import run_all_kernels
from coclo_vio.experiments.legged.impact_figure import impact_figure
from coclo_vio.experiments.legged.legged_plan import LeggedPlan
from coclo_vio.experiments.legged.legged_record import LeggedRecord
from coclo_vio.experiments.legged.legged_recording import recordings_of
from coclo_vio.experiments.legged.legged_summary import differences, summarise
from coclo_vio.experiments.legged.legged_text import (
    IMPACT_HEAD,
    failure_lines,
    impact_rows,
    overview_head,
    overview_rows,
)
from coclo_vio.experiments.results.measuring import IMAGES, RESULTS
from coclo_vio.experiments.results.pages import render
from coclo_vio.experiments.results.provenance import Provenance, Provenances, committed_text
from coclo_vio.experiments.resumable_jobs import run_units
from coclo_vio.experiments.studies.study import report
from coclo_vio.values.errors import CocloError, DatasetError

_MOST_WORKERS = 2
_FILE = "legged.json"
_FIGURE = "legged_impacts.png"


def main(arguments: list[str] | None = None) -> None:
    """Run what is left, print the table, and publish it on request."""
    options = _parser().parse_args(arguments)
    try:
        recordings = recordings_of(
            range(options.first_seed, options.first_seed + options.seeds),
            data=options.data,
            distance_m=options.distance,
            images=options.images,
            impacts=options.impacts,
        )
        plan = LeggedPlan(options.output.resolve(), tuple(recordings))
        command, work = (
            _command(options),
            plan.work(options.only, [name for name in options.estimators.split(",") if name]),
        )
        report(f"commit {plan.commit}: {sum(len(unit.jobs) for unit in work)} jobs on {len(work)} recordings are left")
        if work:
            run_all_kernels()  # compiles them, which is not to count as the time of a job
        run_units(work, Provenance.now(command, Path.cwd()), min(options.workers, _MOST_WORKERS), report)
        record = summarise(plan, command)
        _print(record)
        _write(record, plan.folder / plan.commit, plan.folder / plan.commit)
        if options.publish:
            _publish(record, Path.cwd())
    except CocloError as error:
        sys.exit(f"legged: {error}")


def _print(record: LeggedRecord) -> None:
    for row in (overview_head(record), *overview_rows(record), IMPACT_HEAD, *impact_rows(record)):
        print(" | ".join(row))
    for line in failure_lines(record):
        print(line)


def _write(record: LeggedRecord, results: Path, images: Path) -> None:
    """The record, and the figure of impacts where they were varied."""
    record.write(results / _FILE)
    if any(True for _ in impact_rows(record)):
        save_png(impact_figure(record), images / _FIGURE)


def _publish(record: LeggedRecord, root: Path) -> None:
    """Print what changed since the last committed record, then write record, figure and pages."""
    before = committed_text(root, RESULTS / _FILE)
    if before is None:
        print("there is no committed record to compare with")
    else:
        lines = differences(_read(before), record)
        print("\n".join(["since the last committed record:", *(lines or ["no difference"])]))
    _write(record, root / RESULTS, root / IMAGES)
    known = root / RESULTS / "provenance.json"
    Provenances.read(known).with_entry(_FILE, Provenance.now(record.command, root)).write(known)
    for page in render(root):
        print(f"wrote {page}")


def _read(text: str) -> LeggedRecord:
    try:
        return LeggedRecord.model_validate_json(text)
    except ValueError as error:
        raise DatasetError(
            f"the committed {_FILE} is of another release ({str(error).splitlines()[0]}); remove it, commit, and "
            "publish again"
        ) from error


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="legged", description=__doc__.partition("\n")[0] if __doc__ else None)
    parser.add_argument("-o", "--output", type=Path, required=True, help="folder of results and recordings")
    parser.add_argument("--seeds", type=int, default=1, help="how many seeds of each simulated recording")
    parser.add_argument("--first-seed", type=int, default=11, help="the first of the seeds")
    parser.add_argument("--distance", type=float, help="length of every trot, m; by its ground if not given")
    parser.add_argument("--data", type=Path, default=Path("../shared/data"), help="folder of the real logs")
    parser.add_argument("--only", default="", metavar="PATTERN", help="run only jobs whose name has this in it")
    parser.add_argument("--estimators", default="", metavar="A,B", help="run only jobs of these")
    parser.add_argument("--images", action="store_true", help="with cameras, and the modes that need them")
    parser.add_argument("--impacts", action="store_true", help="trots of softer and harder impacts too, and the figure")
    parser.add_argument("--workers", type=int, default=1, help="processes, two at most")
    parser.add_argument("--publish", action="store_true", help="print what changed; write docs/results/legged.json")
    return parser


def _command(options: argparse.Namespace) -> str:
    """The line that runs the whole benchmark, without where its files are and how many processes work."""
    words = ["python", "-m", "coclo_vio.experiments.legged", "-o", "OUT", "--seeds", str(options.seeds)]
    words += ["--first-seed", str(options.first_seed)]
    words += [] if options.distance is None else ["--distance", f"{options.distance:g}"]
    words += [*(["--images"] if options.images else []), *(["--impacts"] if options.impacts else [])]
    return shlex.join(words)


if __name__ == "__main__":
    main()
