# SPDX-License-Identifier: BSD-3-Clause
from collections.abc import Iterator
from pathlib import Path

import pytest
from stand_in_modes import STAND_INS
from tiny_recordings import write_film

from coclo_vio.runs.modes.registry import register_mode, unregister_mode


@pytest.fixture(scope="session")
def film(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two seconds of dark images at 10 Hz, four of an IMU and of a body at rest; no robot."""
    folder = tmp_path_factory.mktemp("film")
    write_film(folder)
    return folder


@pytest.fixture
def stand_ins() -> Iterator[None]:
    """The modes of ``stand_in_modes`` beside the others."""
    for mode in STAND_INS:
        register_mode(mode)
    yield
    for mode in STAND_INS:
        unregister_mode(mode.name)
