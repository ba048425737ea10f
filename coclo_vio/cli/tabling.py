# SPDX-License-Identifier: BSD-3-Clause
"""The command ``table``. MuJoCo and Dask are extras: what needs them is imported when the command runs."""

import os
import shlex
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.box import SIMPLE_HEAD
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from coclo_vio.cli.extras import check_simulator
from coclo_vio.cli.options import ConfigOption, JsonOption, OutOption, SetOption
from coclo_vio.cli.stopping import stoppable
from coclo_vio.cli.terminal import err, give, give_json, out, say
from coclo_vio.runs.run_config import resolve
from coclo_vio.values.config import parse_settings, read_yaml
from coclo_vio.values.errors import DatasetError

if TYPE_CHECKING:
    from coclo_vio.experiments.table.plan import TablePlan
    from coclo_vio.experiments.table.table_record import TableRecord
    from coclo_vio.experiments.table.text_tables import TextTable
    from coclo_vio.experiments.table.work_unit import WorkProgress

SeedsOption = Annotated[int, typer.Option(min=1, help="How many seeds of each trial.")]
FirstSeedOption = Annotated[int, typer.Option(min=0, help="The first of the seeds; the others follow.")]
TrialsOption = Annotated[str, typer.Option(help="Grounds, separated by commas.")]
ModesOption = Annotated[
    str | None, typer.Option(help="Modes, separated by commas. Default: those of the paper's table.")
]
PolicySeedsOption = Annotated[
    int, typer.Option(min=0, help="With so many of the seeds run combined with every feedback policy; 0 for none.")
]
WorkersOption = Annotated[int | None, typer.Option(min=1, help="Processes; one for each core if not given.")]
SchedulerOption = Annotated[
    str | None,
    typer.Option(
        metavar="ADDR",
        help="Work on a Dask cluster: address of its scheduler. Its workers have to see OUT and DIR under the same "
        "paths; start them with --no-nanny --nthreads 1.",
    ),
]
IdealOption = Annotated[bool, typer.Option("--ideal", help="A robot that is exactly as described.")]
RecordingsOption = Annotated[
    Path | None,
    typer.Option(metavar="DIR", help="Where recordings are, and missing ones are simulated to. Default: in OUT."),
]
KeepOption = Annotated[
    bool,
    typer.Option(
        "--keep-recordings/--no-keep-recordings", help="Whether a recording stays once all its jobs are finished."
    ),
]
FreshOption = Annotated[bool, typer.Option("--fresh", help="Forget the finished jobs in OUT and begin anew.")]


def table(
    seeds: SeedsOption = 10,
    first_seed: FirstSeedOption = 11,
    trials: TrialsOption = "flat,ramp,stairs",
    modes: ModesOption = None,
    policy_seeds: PolicySeedsOption = 3,
    workers: WorkersOption = None,
    scheduler: SchedulerOption = None,
    ideal: IdealOption = False,
    recordings: RecordingsOption = None,
    keep_recordings: KeepOption = True,
    fresh: FreshOption = False,
    settings: SetOption = None,
    config: ConfigOption = None,
    as_json: JsonOption = False,
    output: OutOption = Path("out/table"),
) -> None:
    """The paper's Table I over simulated trials; a stopped run is resumed."""
    check_simulator("a table", "sim,viz")
    from coclo_vio.experiments.table import build  # noqa: PLC0415
    from coclo_vio.experiments.table import plan as planning  # noqa: PLC0415
    from coclo_vio.experiments.table.job_store import JobStore  # noqa: PLC0415
    from coclo_vio.experiments.table.recordings import Recordings  # noqa: PLC0415
    from coclo_vio.simulation.simulated_recording import SIMULATED_ROBOT  # noqa: PLC0415 -- an extra

    plan = planning.TablePlan(
        config=resolve(SIMULATED_ROBOT, config, settings or ()),
        seeds=seeds,
        first_seed=first_seed,
        trials=planning.checked_trials(_names(trials)),
        modes=planning.default_modes() if modes is None else planning.checked_modes(_names(modes)),
        policy_seeds=policy_seeds,
        ideal=ideal,
    )
    store = JobStore(output.resolve())
    places = Recordings((recordings or output / "recordings").resolve(), plan, keep_recordings)
    work = build.unfinished(plan, places, store, fresh=fresh)
    total = sum(1 for _ in plan.jobs())
    left = sum(len(unit.jobs) for unit in work)
    if left < total:
        say(f"{total - left} of {total} jobs are finished already, in {output}")

    def done_so_far() -> Iterator[str]:
        finished = len(store.kept(plan))
        yield f"{finished} of {total} jobs are finished, in {output}; finished jobs are kept: the same command goes on"

    with stoppable(done_so_far):
        with _progress(total, total - left) as report:
            build.run_work(work, workers or os.cpu_count() or 1, scheduler, report)
        lost = build.missing(plan, store)
        if lost:
            raise DatasetError(
                f"{len(lost)} jobs have left nothing in {store.folder}, such as {lost[0].name}: do all workers see "
                "that folder? Run again, the finished jobs are kept"
            )
        given = {"set": parse_settings(settings or ()), "file": read_yaml(config) if config else {}}
        made, notes = build.write_table(plan, store, _command(plan, settings or [], config), given)
    _show(made, notes, output, as_json=as_json)


def _names(text: str) -> list[str]:
    return [name.strip() for name in text.split(",") if name.strip()]


def _command(plan: "TablePlan", settings: list[str], config: Path | None) -> str:
    """The command line that makes the same table: without where things are and how many processes work."""
    words = ["coclo-vio", "table", "--seeds", str(plan.seeds), "--first-seed", str(plan.first_seed)]
    words += ["--trials", ",".join(plan.trials), "--modes", ",".join(plan.modes)]
    words += ["--policy-seeds", str(plan.policy_seeds), *(["--ideal"] if plan.ideal else [])]
    words += [word for setting in settings for word in ("--set", setting)]
    return shlex.join([*words, *(["-c", config.name] if config else [])])


def _show(made: "TableRecord", notes: list[str], output: Path, *, as_json: bool) -> None:
    from coclo_vio.experiments.table.table_page import against_the_paper, failures  # noqa: PLC0415
    from coclo_vio.experiments.table.text_tables import text_tables  # noqa: PLC0415 -- an extra

    for line in (*failures(made), *notes):
        say(line)
    if as_json:
        give_json(made.to_json())
        return
    for each in text_tables(made.summary):
        if not each.is_wide:
            _print_table(each)
    for line in against_the_paper(made):
        give(line)
    give(f"table with spreads and figures: {output / 'table.html'}; beside it table.md and table.json")


def _print_table(text: "TextTable") -> None:
    shown = Table(title=escape(text.title), box=SIMPLE_HEAD, pad_edge=False, title_justify="left")
    for number, head in enumerate(text.head):
        shown.add_column(escape(head), justify="right" if number else "left")
    for row in text.rows:
        shown.add_row(*(escape(cell) for cell in row))
    out.print(shown)
    out.print(escape(text.caption), highlight=False)
    out.print()


@contextmanager
def _progress(total: int, finished: int) -> Iterator[Callable[["WorkProgress"], None]]:
    """A bar of jobs with what runs now; a line a job where there is no terminal."""
    columns = (BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(), TextColumn("{task.description}"))
    with Progress(*columns, console=err, transient=True, disable=not err.is_terminal) as bar:
        task = bar.add_task("", total=total, completed=finished)
        running: dict[str, str] = {}  # by recording
        done = finished

        def report(step: "WorkProgress") -> None:
            nonlocal done
            recording = "_".join(step.name.split("_")[:2])
            running.pop(recording, None)
            if step.kind in ("simulating", "running"):
                running[recording] = step.name if step.kind == "running" else f"simulating {step.name}"
            elif step.kind in ("done", "failed"):
                done += 1
                if step.kind == "failed" or not err.is_terminal:
                    say(f"{done} of {total}: {step.name}{f' failed: {step.reason}' if step.reason else ''}")
            bar.update(task, completed=done, description=escape(", ".join(running.values())))

        yield report
