# SPDX-License-Identifier: BSD-3-Clause
"""A table of one short walk: figures against both references, pages, figures of the median recording."""

from collections.abc import Callable

import pytest
from short_walk import MadePlan

from coclo_vio.experiments.table import build
from coclo_vio.experiments.table.table_record import TableRecord
from coclo_vio.runs import run_folder
from coclo_vio.values.errors import EvaluationError

Made = Callable[..., MadePlan]


@pytest.fixture
def worked(made: Made) -> MadePlan:
    """All jobs of one recording through two modes."""
    table = made(modes=("naive", "naive_rolling"))
    build.run_work(build.unfinished(table.plan, table.recordings, table.store), 1, None, lambda _: None)
    return table


def test_each_job_is_evaluated_against_both_references_and_drawn(worked: MadePlan) -> None:
    table, notes = build.write_table(worked.plan, worked.store, "coclo-vio table", {})
    assert notes == []
    assert TableRecord.read(worked.store.folder / "table.json") == table
    naive, rolling = (job.estimators[job.variant] for job in table.jobs)
    assert naive.vicon is not None
    assert naive.truth is not None
    assert rolling.vicon is not None
    assert rolling.truth is not None
    assert rolling.truth.ate_m < naive.truth.ate_m, "a rolling contact is the better model"
    assert (rolling.vicon.clock_is_estimated, rolling.truth.clock_offset_s) == (False, 0.0)
    assert rolling.truth.anees_pose is not None
    assert rolling.vicon.anees_pose is not None
    assert rolling.truth.anees_pose > rolling.vicon.anees_pose, "the truth has no noise that is added"
    figures = sorted(path.name for path in (worked.store.folder / "figures").iterdir())
    assert figures == ["flat_1_path.png", "flat_1_positions.png", "flat_1_velocities.png"]
    page = (worked.store.folder / "table.html").read_text(encoding="utf-8")
    assert page.count("data:image/png;base64,") == 3


def test_a_run_folder_is_enough_to_draw_it(worked: MadePlan) -> None:
    job = next(iter(worked.plan.jobs()))
    folder = worked.store.run_of(job)
    assert run_folder.read_estimates(folder, "naive").trajectory.velocity_world is not None
    assert {path.name for path in folder.iterdir()} >= {"naive.tum", "groundtruth.tum", "run.json", "config.yaml"}


def test_without_matplotlib_the_table_is_without_figures(worked: MadePlan, monkeypatch: pytest.MonkeyPatch) -> None:
    def draw(*_: object) -> None:
        raise EvaluationError("figures need matplotlib")

    monkeypatch.setattr(build, "draw", draw)
    _, notes = build.write_table(worked.plan, worked.store, "coclo-vio table", {})
    assert notes == ["table.html is without figures: figures need matplotlib"]
    assert "Table I" in (worked.store.folder / "table.html").read_text(encoding="utf-8")
