# SPDX-License-Identifier: BSD-3-Clause
from pathlib import Path

import mujoco
import pytest
from floating_world import with_visuals

from coclo_vio.simulation.visuals.opengl import RenderingError, choose_backend


@pytest.fixture(scope="session")
def model() -> mujoco.MjModel:
    return with_visuals(seed=3).compile()


@pytest.fixture(scope="session")
def model_path(model: mujoco.MjModel, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("visuals") / "model.mjb"
    mujoco.mj_saveModel(model, str(path))
    return path


@pytest.fixture(scope="session")
def opengl() -> str:
    """The OpenGL backend of this machine; without one the test is skipped."""
    try:
        return choose_backend()
    except RenderingError as error:
        pytest.skip(str(error))
