# SPDX-License-Identifier: BSD-3-Clause
"""``python -m coclo_vio.experiments.grid run|summary``: the grid of conditions, which goes on where it was stopped.

``run`` works on two cores at most; recordings are removed after their jobs, true motions are kept in OUT/motions, and
results are in OUT/COMMIT/CELL/jobs. ``summary`` writes OUT/COMMIT/grid.json and prints a line a cell; with
``--publish`` it writes docs/results/grid.json too, which ``python -m coclo_vio.experiments.results`` shows on the page.
"""

import argparse
import shlex
import sys
from collections.abc import Callable
from pathlib import Path

from coclo_vio.experiments.grid.cells import chosen_cells
from coclo_vio.experiments.grid.grid_plan import UNTIL_S, GridPlan
from coclo_vio.experiments.grid.grid_summary import summarise
from coclo_vio.experiments.grid.grid_text import cell_rows, share_rows
from coclo_vio.experiments.results.measuring import RESULTS
from coclo_vio.experiments.results.provenance import Provenance, Provenances
from coclo_vio.experiments.resumable_jobs import commit_of_code
from coclo_vio.experiments.table.build import run_work
from coclo_vio.experiments.table.plan import checked_modes, checked_trials, default_modes
from coclo_vio.experiments.table.work_unit import WorkProgress
from coclo_vio.runs.run_config import resolve
from coclo_vio.simulation.simulated_recording import SIMULATED_ROBOT
from coclo_vio.simulation.trial.terrain import TERRAINS
from coclo_vio.values.errors import CocloError

_MOST_WORKERS = 2


def main(arguments: list[str] | None = None) -> None:
    """Run the grid, or sum it up."""
    options = _parser().parse_args(arguments)
    try:
        plan = _plan(options)
        if options.task == "run":
            work = plan.work()
            total = sum(len(unit.jobs) for unit in work)
            print(f"commit {plan.commit}: {total} jobs on {len(work)} recordings are left", file=sys.stderr)
            run_work(work, min(options.workers, _MOST_WORKERS), None, _reporter(total))
        else:
            _summary(plan, options)
    except CocloError as error:
        sys.exit(f"grid: {error}")


def _summary(plan: GridPlan, options: argparse.Namespace) -> None:
    record = summarise(plan, _command(options))
    record.write(plan.folder / plan.commit / "grid.json")
    for row in (*cell_rows(record), *share_rows(record)):
        print("  ".join(row))
    if options.publish:
        root = Path.cwd()
        record.write(root / RESULTS / "grid.json")
        known = root / RESULTS / "provenance.json"
        origin = Provenance.now(record.command, root).model_copy(update={"commit": record.commit})
        Provenances.read(known).with_entry("grid.json", origin).write(known)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="grid", description=__doc__.partition("\n")[0] if __doc__ else None)
    parser.add_argument("task", choices=("run", "summary"))
    parser.add_argument("-o", "--output", type=Path, default=Path("out/grid"), help="folder of the grid")
    parser.add_argument("--cells", default="", help="cells or groups of cells, separated by commas; all if not given")
    parser.add_argument("--seeds", type=int, default=1, help="how many seeds of each trial")
    parser.add_argument("--first-seed", type=int, default=1, help="the first of the seeds")
    parser.add_argument("--trials", default=",".join(TERRAINS), help="terrains, separated by commas")
    parser.add_argument("--modes", default=",".join(default_modes()), help="modes, separated by commas")
    parser.add_argument("--no-policies", action="store_true", help="of the feedback policies run the default one only")
    parser.add_argument("--until", type=float, default=UNTIL_S, help="end of each trial, s; 0 for whole trials")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help="a setting of the estimators")
    parser.add_argument("--commit", help="sum up the results of this commit, not of the present one")
    parser.add_argument("--workers", type=int, default=_MOST_WORKERS, help="processes, two at most")
    parser.add_argument("--publish", action="store_true", help="write docs/results/grid.json")
    return parser


def _plan(options: argparse.Namespace) -> GridPlan:
    return GridPlan(
        folder=options.output.resolve(),
        commit=options.commit or commit_of_code(),
        cells=chosen_cells(_names(options.cells)),
        seeds=options.seeds,
        first_seed=options.first_seed,
        trials=checked_trials(_names(options.trials)),
        modes=checked_modes(_names(options.modes)),
        has_policies=not options.no_policies,
        until_s=options.until or None,
        config=resolve(SIMULATED_ROBOT, settings=options.set),
    )


def _names(text: str) -> list[str]:
    return [name.strip() for name in text.split(",") if name.strip()]


def _command(options: argparse.Namespace) -> str:
    """The line that runs the same grid, without where it is and how many processes work."""
    words = ["python", "-m", "coclo_vio.experiments.grid", "run", "--seeds", str(options.seeds)]
    words += ["--first-seed", str(options.first_seed), "--trials", options.trials, "--modes", options.modes]
    words += ["--until", f"{options.until:g}", *(["--cells", options.cells] if options.cells else [])]
    words += ["--no-policies"] if options.no_policies else []
    return shlex.join([*words, *(word for setting in options.set for word in ("--set", setting))])


def _reporter(total: int) -> Callable[[WorkProgress], None]:
    done = 0

    def report(step: WorkProgress) -> None:
        nonlocal done
        if step.kind in ("done", "failed"):
            done += 1
            reason = f" failed: {step.reason}" if step.reason else ""
            print(f"{done} of {total}: {step.name}{reason}", file=sys.stderr, flush=True)

    return report


if __name__ == "__main__":
    main()
