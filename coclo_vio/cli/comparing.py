# SPDX-License-Identifier: BSD-3-Clause
"""The commands that hold estimators side by side: ``demo``, ``compare``."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from coclo_vio.cli.options import (
    ConfigOption,
    OutOption,
    PartialOption,
    RobotOption,
    SetOption,
    with_partial,
)
from coclo_vio.cli.printing import (
    print_ranking,
    print_table,
    print_table_one,
    progress_bar,
    run_title,
    tell_failures,
    tell_run,
)
from coclo_vio.cli.terminal import give, say
from coclo_vio.datasets.dataset import open_dataset
from coclo_vio.datasets.sample import DURATION_S, sample_path
from coclo_vio.evaluation.figure_style import NO_FIGURES, can_draw
from coclo_vio.evaluation.table_one import TableOne
from coclo_vio.runs import comparison
from coclo_vio.runs.equipment import compared_modes
from coclo_vio.runs.estimators import ESTIMATORS, estimator_kind
from coclo_vio.runs.inspection import resolve_if_known
from coclo_vio.runs.run_config import RunConfig, resolve
from coclo_vio.values.errors import CocloError, ConfigError, DatasetError


def demo(output: OutOption = Path("demo_out")) -> None:
    """Compare the estimators on the bundled bag of a Daisy at the stairs: table, plots, report."""
    say(
        f"the bundled recording: {DURATION_S:.0f} s of a simulated hexapod Daisy that walks up to stairs and sets its "
        "feet on them; this takes about a minute"
    )
    config = resolve(robot="daisy")
    plan = _Plan(sample_path().name, sample_path(), config, compared_modes(sample_path(), config), output)
    _finish([_compare_one(plan)], output)


def compare(
    datasets: Annotated[list[Path], typer.Argument(help="Recordings with ground truth.")],
    modes: Annotated[
        str | None, typer.Option("--modes", help="Estimators, separated by commas. Default: by what there is.")
    ] = None,
    robot: RobotOption = None,
    config: ConfigOption = None,
    settings: SetOption = None,
    allow_partial: PartialOption = False,
    output: OutOption = Path("out"),
) -> None:
    """Run several estimators side by side against ground truth: table, plots, compare.json, report.html."""
    asked, settings = _asked(modes), with_partial(settings, allow_partial)
    plans = []
    for name, dataset in zip(_distinct_names(datasets), datasets, strict=True):
        resolved, _ = resolve_if_known(dataset, robot, config, settings)
        plans.append(_planned(name, dataset, asked, resolved, output if len(datasets) == 1 else output / name))
    outcomes, failed = [], []
    for plan in plans:
        try:
            outcomes.append(_compare_one(plan))
        except CocloError as error:
            if len(plans) == 1:
                raise
            tell_failures({plan.name: str(error)})
            failed.append(str(plan.dataset))
    _finish(outcomes, output, failed)


@dataclass(frozen=True, slots=True)
class _Plan:
    """A recording that is going to be compared.

    Attributes:
        name: what it is called.
        dataset: where it is.
        config: as resolved for it.
        modes: what to run.
        folder: where the results go.
    """

    name: str
    dataset: Path
    config: RunConfig
    modes: Sequence[str]
    folder: Path


@dataclass(frozen=True, slots=True)
class _Outcome:
    """A recording that has been compared.

    Attributes:
        plan: what was asked.
        compared: what came out.
        report: its page.
        is_fruitless: whether no estimator got through.
    """

    plan: _Plan
    compared: comparison.Compared
    report: Path
    is_fruitless: bool


def _asked(modes: str | None) -> list[str] | None:
    """The modes that were asked for by name; None where none were."""
    if modes is None:
        return None
    asked = list(dict.fromkeys(name.strip() for name in modes.split(",") if name.strip()))
    if not asked:
        raise ConfigError(f"--modes names no estimator; there are: {', '.join(ESTIMATORS)}")
    for name in asked:
        estimator_kind(name)  # a misspelt one is found before anything runs
    return asked


def _planned(name: str, dataset: Path, asked: Sequence[str] | None, config: RunConfig, folder: Path) -> _Plan:
    """Everything that can be wrong before an estimator runs, is found here."""
    names = asked or compared_modes(dataset, config)
    if open_dataset(dataset, config.robot, config.dataset).ground_truth() is None:
        raise DatasetError(
            f"{dataset} has no ground truth to compare with: that stands in groundtruth.tum or mocap.csv beside a log, "
            f"in a pose topic of a bag; coclo-vio run {dataset} does without"
        )
    return _Plan(name, dataset, config, names, folder)


def _compare_one(plan: _Plan) -> _Outcome:
    """Run, measure, tell, and write the report of one recording."""
    title = run_title(plan.name, plan.config)
    with progress_bar() as progress:
        told = comparison.run_all(plan.dataset, plan.modes, plan.config, plan.folder, progress)
    tell_run(told, plan.folder, brief=True)
    evaluations, failures = comparison.evaluate_run(plan.folder, plan.config.evaluation)
    print_table(evaluations, title)
    print_ranking(evaluations, plan.config.evaluation)
    stopped = {mode: one["failure"] for mode, one in told["estimators"].items() if one["failure"]}
    tell_failures(failures | stopped)
    report = comparison.write_comparison(plan.folder, title, evaluations, plan.config)
    is_fruitless = not evaluations or len(stopped) == len(told["estimators"])
    return _Outcome(plan, comparison.Compared(plan.folder, evaluations, plan.config), report, is_fruitless)


def _finish(outcomes: Sequence[_Outcome], output: Path, failed: Sequence[str] = ()) -> None:
    """The table over all where there are several, and where the report is."""
    compared = {outcome.plan.name: outcome.compared for outcome in outcomes}
    if len(outcomes) + len(failed) > 1 and outcomes:
        print_table_one(TableOne.of({name: one.evaluations for name, one in compared.items()}))
        title = "1 recording" if len(outcomes) == 1 else f"{len(outcomes)} recordings"
        give(f"report: {comparison.write_comparisons(output, title, compared)}")
    elif outcomes:
        give(f"report: {outcomes[0].report}")
    if outcomes and not can_draw():
        say(NO_FIGURES)
    fruitless = [*failed, *(str(outcome.plan.dataset) for outcome in outcomes if outcome.is_fruitless)]
    if fruitless:
        raise DatasetError(f"no estimator got through {', '.join(fruitless)}; what stopped each is told above")


def _distinct_names(datasets: Sequence[Path]) -> list[str]:
    """What each recording is called: its last path component, numbered where an earlier one has the same."""
    names: list[str] = []
    for dataset in datasets:
        name = plain = dataset.resolve().name
        number = 1
        while name in names:
            number += 1
            name = f"{plain}_{number}"
        names.append(name)
    return names
