# SPDX-License-Identifier: BSD-3-Clause
from pathlib import Path

import pytest
from go1_walk import write_go1_walk

import coclo_vio as cv


@pytest.fixture(scope="session")
def go1_walk(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """``walk.mcap``: three seconds of a Go1 that walks in a textured room, with exact ground truth."""
    return write_go1_walk(tmp_path_factory.mktemp("go1_walk") / "walk.mcap")


@pytest.fixture(scope="session")
def naive_run(leg_log: Path) -> cv.Run:
    """The mode naive over the short leg log, in a temporary folder."""
    return cv.run(leg_log, "naive")


@pytest.fixture(scope="session")
def coclo_run(leg_log: Path) -> cv.Run:
    """The default mode over the short leg log, in a temporary folder."""
    return cv.run(leg_log)


@pytest.fixture(scope="session")
def combined_run(go1_walk: Path) -> cv.Run:
    """The mode combined over the walk of the Go1, in a temporary folder."""
    return cv.run(cv.open(go1_walk, robot="go1"), "combined")
