# SPDX-License-Identifier: BSD-3-Clause
"""A slippery tile: its position, feet slide on it, and nothing is different elsewhere."""

from itertools import pairwise

import mujoco
import numpy as np
import pytest

from coclo_vio.robot.description import load_robot
from coclo_vio.robot.model import RobotModel
from coclo_vio.simulation.simulated_recording import IDEAL_ROBOT, simulation_config
from coclo_vio.simulation.trial.gait_controller import planned_path
from coclo_vio.simulation.trial.slippery_tile import SIDE_M, SlipperyTile
from coclo_vio.simulation.trial.terrain import TERRAINS, make_terrain
from coclo_vio.simulation.trial.trial import Trial, simulate
from coclo_vio.values.arrays import Array
from coclo_vio.values.units import NS_PER_S

DAISY = load_robot("daisy")
IS_LEFT = RobotModel(DAISY).hip_position_body[:, 1] > 0.0
UNTIL_S = 3.0
LEFT_FEET = SlipperyTile(np.array([0.0, 0.5 * SIDE_M]), 0.0, 0.05)


def walk(**changes: float) -> Trial:
    """Two seconds of walking on level ground."""
    config = simulation_config("flat", IDEAL_ROBOT, {"trial": {"stand_s": 1.0, **changes}})
    return simulate("flat", DAISY, config.trial, 1, until_s=UNTIL_S)


def walk_on(tile: SlipperyTile, monkeypatch: pytest.MonkeyPatch) -> Trial:
    """The same with this tile."""
    monkeypatch.setattr(SlipperyTile, "on_path", classmethod(lambda *_: tile))
    return walk(slippery_tile=tile.friction)


@pytest.fixture(scope="module")
def plain() -> Trial:
    return walk()


def feet_m(trial: Trial) -> Array:
    """Middles of the feet at the frames' times, world, m, (F, legs, 3)."""
    model = trial.spec.compile()
    data = mujoco.MjData(model)
    feet = [model.geom(leg.foot_frame).id for leg in DAISY.legs]
    places = []
    for qpos in trial.frame_qpos:
        data.qpos[:] = qpos
        mujoco.mj_kinematics(model, data)
        places.append(data.geom_xpos[feet])
    return np.array(places)


def distance_in_contact_m(trial: Trial) -> Array:
    """How far each foot's middle moves while it touches the ground: it rolls, and slides, (legs,)."""
    steps = np.linalg.norm(np.diff(feet_m(trial), axis=0), axis=2)
    rows = (trial.frame_ns - trial.truth.contact_ns[0]) // 1_000_000
    touches = [trial.truth.contact[first:last].all(axis=0) for first, last in pairwise(rows)]
    return np.asarray((steps * touches).sum(axis=0))


def test_feet_slide_on_the_tile_and_not_beside_it(plain: Trial, monkeypatch: pytest.MonkeyPatch) -> None:
    slid = distance_in_contact_m(walk_on(LEFT_FEET, monkeypatch)) - distance_in_contact_m(plain)
    assert slid[IS_LEFT].sum() > 0.02
    assert abs(slid[~IS_LEFT].sum()) < 0.1 * slid[IS_LEFT].sum()


@pytest.mark.long
def test_before_the_first_step_on_the_tile_the_trial_is_identical(
    plain: Trial, monkeypatch: pytest.MonkeyPatch
) -> None:
    foremost_m = feet_m(plain)[0, :, 0].max()
    ahead = walk_on(SlipperyTile(np.array([foremost_m + 0.5 * SIDE_M + 0.01, 0.0]), 0.0, 0.05), monkeypatch)
    on_tile_s = ahead.truth.on_tile_s
    assert on_tile_s is not None
    assert 1.5 < on_tile_s[0] < on_tile_s[1] <= UNTIL_S
    is_before = ahead.frame_ns - ahead.frame_ns[0] <= on_tile_s[0] * NS_PER_S
    np.testing.assert_array_equal(ahead.frame_qpos[is_before], plain.frame_qpos[is_before])
    assert not np.array_equal(ahead.frame_qpos, plain.frame_qpos)


@pytest.mark.parametrize("name", TERRAINS)
def test_it_lies_left_of_the_path_at_half_of_its_time(name) -> None:
    gait = simulation_config(name).trial.gait
    path = planned_path(make_terrain(name), gait)
    tile = SlipperyTile.on_path(path, 0.3)
    body = path.pose_at(0.5 * path.duration_s)
    here, left, right, ahead = (
        body[:3, 3] + body[:3, :3] @ [x, y, 0.0] for x, y in ((0.0, 0.0), (0.0, 0.4), (0.0, -0.4), (0.6, 0.4))
    )
    np.testing.assert_allclose(np.linalg.norm(tile.centre - here[:2]), 0.5 * SIDE_M)
    assert tile.contains(np.array([left, right, ahead])).tolist() == [True, False, False]
    assert tile.friction == 0.3
