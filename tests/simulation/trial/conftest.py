# SPDX-License-Identifier: BSD-3-Clause
from collections.abc import Callable

import pytest

from coclo_vio.robot.description import load_robot
from coclo_vio.simulation.simulated_recording import simulation_config
from coclo_vio.simulation.trial.terrain import TerrainName
from coclo_vio.simulation.trial.trial import Trial, simulate

DAISY = load_robot("daisy")


@pytest.fixture(scope="session")
def walk() -> Callable[..., Trial]:
    """Simulates the first seconds of a trial; further arguments change its configuration. Each is simulated once."""
    walked: dict[str, Trial] = {}

    def make(name: TerrainName, *changes, until_s: float, seed: int = 1) -> Trial:
        key = repr((name, changes, until_s, seed))
        if key not in walked:
            config = simulation_config(name, *changes).trial
            walked[key] = simulate(name, DAISY, config, seed, until_s=until_s)
        return walked[key]

    return make
