# SPDX-License-Identifier: BSD-3-Clause
"""Each of the paper's trials is walked to the end with three seeds, without images."""

import pytest

from coclo_vio.robot.description import load_robot
from coclo_vio.simulation.simulated_recording import simulation_config, walked_m
from coclo_vio.simulation.trial.terrain import TERRAINS
from coclo_vio.simulation.trial.trial import simulate

# A leg may touch a riser; in at most so many of a trial's control periods (about 20,000).
MOST_GROUND_CONTACTS = 40


@pytest.mark.slow
@pytest.mark.parametrize("seed", [101, 102, 103])
@pytest.mark.parametrize("name", TERRAINS)
def test_the_robot_reaches_the_end_on_its_feet(name, seed) -> None:
    trial = simulate(name, load_robot("daisy"), simulation_config(name).trial, seed)
    assert walked_m(trial.truth.trajectory) == pytest.approx(trial.terrain.path_length_m, rel=0.05)
    assert trial.truth.self_contacts == 0
    assert trial.truth.ground_contacts <= MOST_GROUND_CONTACTS
    assert trial.truth.max_penetration_m < 0.006
    assert (trial.truth.contact[-500:].sum(axis=1) == 6).all()
