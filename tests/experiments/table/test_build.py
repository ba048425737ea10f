# SPDX-License-Identifier: BSD-3-Clause
"""A table made of one short walk: figures against both references, pages, pictures of the recording in the middle."""

import json
from collections.abc import Callable

import pytest
from short_walk import MadePlan

from coclo_vio.experiments.table import build
from coclo_vio.runs import run_folder
from coclo_vio.values.errors import EvaluationError

Made = Callable[..., MadePlan]


@pytest.fixture
def worked(made: Made) -> MadePlan:
    """All jobs of one recording through two modes."""
    table = made(modes=("naive", "naive_rolling"))
    build.do(build.unfinished(table.plan, table.recordings, table.store), 1, None, lambda _: None)
    return table


def test_each_job_is_measured_against_both_and_pictures_show_all(worked: MadePlan) -> None:
    table, notes = build.write_table(worked.plan, worked.store, "coclo-vio table", {})
    assert notes == []
    assert json.loads((worked.store.folder / "table.json").read_text(encoding="utf-8")) == table
    naive, rolling = (job["estimators"][job["variant"]] for job in table["jobs"])
    assert rolling["truth"]["ate_m"] < naive["truth"]["ate_m"], "a foot that is known to roll leads less astray"
    assert (rolling["vicon"]["clock_is_estimated"], rolling["truth"]["clock_offset_s"]) == (False, 0.0)
    assert rolling["truth"]["anees_pose"] > rolling["vicon"]["anees_pose"], "no noise of Vicon excuses an error"
    figures = sorted(path.name for path in (worked.store.folder / "figures").iterdir())
    assert figures == ["flat_1_path.png", "flat_1_positions.png", "flat_1_velocities.png"]
    page = (worked.store.folder / "table.html").read_text(encoding="utf-8")
    assert page.count("data:image/png;base64,") == 3


def test_what_a_run_leaves_is_enough_to_draw_it(worked: MadePlan) -> None:
    job = next(iter(worked.plan.jobs()))
    folder = worked.store.run_of(job)
    assert run_folder.read_estimates(folder, "naive").trajectory.velocity_world is not None
    assert {path.name for path in folder.iterdir()} >= {"naive.tum", "groundtruth.tum", "run.json", "config.yaml"}


def test_without_matplotlib_the_table_is_without_pictures(worked: MadePlan, monkeypatch: pytest.MonkeyPatch) -> None:
    def draw(*_: object) -> None:
        raise EvaluationError("figures need matplotlib")

    monkeypatch.setattr(build, "draw", draw)
    _, notes = build.write_table(worked.plan, worked.store, "coclo-vio table", {})
    assert notes == ["table.html is without figures: figures need matplotlib"]
    assert "Table I" in (worked.store.folder / "table.html").read_text(encoding="utf-8")
