# SPDX-License-Identifier: BSD-3-Clause
from pathlib import Path

import pytest
from trot_settings import GO1, SHORT, UNTIL_S

from coclo_vio.simulation.simulated_recording import Execution
from coclo_vio.simulation.simulated_trot import simulate_trot, trot_config
from coclo_vio.simulation.trial.motion import Motion
from coclo_vio.simulation.trial.trial import Trial
from coclo_vio.simulation.trot.trot_walk import TrotWalk


@pytest.fixture(scope="session")
def trot(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Trial, Motion]:
    """A Go1 that stands for 1 s and trots for 4 s on flat ground: its recording, the trial, the true motion."""
    folder = tmp_path_factory.mktemp("trot")
    path, motions, config, seed = folder / "go1.mcap", folder / "motions", trot_config(SHORT), 4
    execution = Execution(motions=motions)
    trial = simulate_trot(path, config, seed, images=False, until_s=UNTIL_S, execution=execution)
    return path, trial, TrotWalk.draw(GO1, config.trial, seed, UNTIL_S).motion(motions=motions)
