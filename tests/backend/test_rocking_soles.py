# SPDX-License-Identifier: BSD-3-Clause
"""The invariant filter on a biped that walks over heels and toes: with the corners of its soles it stays level."""

from pathlib import Path

import pytest
from flat_biped import Noise, walk, write_biped

from coclo_vio.backend.inekf import InvariantLegOdometry
from coclo_vio.robot.model import RobotModel


@pytest.mark.long
@pytest.mark.parametrize(("has_corners", "within_m"), [(True, (0.0, 0.015)), (False, (0.03, 0.3))])
def test_feet_that_rock_lift_the_body_only_where_their_corners_are_unknown(
    tmp_path: Path, has_corners: bool, within_m: tuple[float, float]
) -> None:
    name = "sole" if has_corners else "plate"
    robot = RobotModel(write_biped(tmp_path, has_sole_shape=has_corners, sole_name=name))
    odometry, last_m = InvariantLegOdometry(robot), 0.0
    trial = walk(robot)
    for measurement in trial.measurements(Noise(), 1):
        state = odometry.push(measurement)
        last_m = last_m if state is None else float(state.nav.T_world_body[2, 3])
    climbed_m = trial.T_world_body[-1, 2, 3] - trial.T_world_body[0, 2, 3]
    assert within_m[0] <= abs(last_m - climbed_m) <= within_m[1]
