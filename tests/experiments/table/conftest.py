# SPDX-License-Identifier: BSD-3-Clause
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from short_walk import MadePlan, plan_of, write_walk

from coclo_vio.experiments.table.job_store import JobStore
from coclo_vio.experiments.table.plan import TablePlan
from coclo_vio.experiments.table.recordings import Recordings
from coclo_vio.runs.modes.registry import modes


@pytest.fixture(scope="session", autouse=True)
def _registered_modes() -> None:
    """Pages label and order trajectories by the kinds that modes declare."""
    modes()


@pytest.fixture(scope="session")
def walk(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three seconds of a Daisy that stands and walks, and its truth beside it, as a flat trial."""
    folder = tmp_path_factory.mktemp("walk")
    write_walk(folder / "flat_1", plan_of())
    return folder


@pytest.fixture
def made(walk: Path, tmp_path: Path) -> Callable[..., MadePlan]:
    """A table in ``tmp_path`` whose recordings are all that one walk."""

    def make(**changes: Any) -> MadePlan:
        plan: TablePlan = plan_of(**changes)
        recordings = Recordings(tmp_path / "recordings", plan)
        for seed in range(plan.first_seed, plan.first_seed + plan.seeds):
            for suffix in ("", "_truth"):
                path = recordings.folder / f"flat_{seed}{suffix}"
                if not path.exists():
                    shutil.copytree(walk / f"flat_1{suffix}", path)
        return MadePlan(plan, recordings, JobStore(tmp_path / "out"))

    return make
