# SPDX-License-Identifier: BSD-3-Clause
"""The ground of the paper's trials: collision boxes, rendered surfaces and the planner's profile agree."""

from typing import get_args

import numpy as np
import pytest

from coclo_vio.simulation.trial.terrain import TERRAINS, Box, Terrain, TerrainName, make_terrain

# Paper, section V-A: a square 6 m long (with back and forth at its last turn 8 m), a ramp and a staircase of 5 m.
LENGTHS_M = {"flat": 8.0, "ramp": 5.0, "stairs": 5.0}


@pytest.fixture(params=TERRAINS)
def terrain(request) -> Terrain:
    return make_terrain(request.param)


def top_of(box: Box, x: float) -> float:
    """Height of the upper face of a box over the position (x, 0), m; minus infinity beside it."""
    if abs(box.rotation[2, 2]) < 0.1:
        return -np.inf
    normal, face = box.rotation[:, 2], box.centre + box.half_size[2] * box.rotation[:, 2]
    z = face[2] - normal[0] / normal[2] * (x - face[0])
    along = (np.array([x, 0.0, z]) - box.centre) @ box.rotation[:, 0]
    return float(z) if abs(along) <= box.half_size[0] + 1e-9 else -np.inf


def test_every_name_has_a_terrain_of_the_papers_length() -> None:
    assert set(LENGTHS_M) == set(get_args(TerrainName))
    for name, length_m in LENGTHS_M.items():
        assert make_terrain(name).path_length_m == pytest.approx(length_m, abs=0.02)


def test_feet_stand_where_the_planner_expects_the_ground(terrain) -> None:
    last = terrain.bounds.xmax - 0.2
    for x in np.linspace(-1.4, last, 300):
        assert max(top_of(box, x) for box in terrain.boxes) == pytest.approx(terrain.height(x), abs=1e-9)


def test_the_rendered_surfaces_are_those_that_carry_the_feet(terrain) -> None:
    for surface in terrain.surfaces:
        x, _, z = surface.center
        if surface.kind == "riser":
            assert terrain.height(x - 1e-6) < z < terrain.height(x)
        else:
            assert z == pytest.approx(terrain.height(x), abs=1e-9)
            slope = (terrain.height(x + 0.01) - terrain.height(x - 0.01)) / 0.02
            np.testing.assert_allclose(surface.rotation[:, 2], np.array([-slope, 0, 1]) / np.hypot(slope, 1), atol=1e-9)


def test_the_ramp_is_as_steep_as_the_papers() -> None:
    ramp = make_terrain("ramp")
    rise = ramp.height(3.0) - ramp.height(2.0)
    assert np.degrees(np.arctan(rise)) == pytest.approx(16.35, abs=0.01)
    assert ramp.height(10.0) == pytest.approx(0.98)
    plate = next(box for box in ramp.boxes if not np.allclose(box.rotation, np.eye(3)))
    assert np.degrees(np.arccos(plate.rotation[2, 2])) == pytest.approx(16.35, abs=0.01)


def test_the_stairs_have_five_steps_of_the_papers_size() -> None:
    stairs = make_terrain("stairs")
    assert len(stairs.risers_m) == 5
    np.testing.assert_allclose(np.diff(stairs.risers_m), 0.6)
    heights = [stairs.height(x) - stairs.height(x - 1e-9) for x in stairs.risers_m]
    np.testing.assert_allclose(heights, 0.15)
    middles = np.array(stairs.risers_m) + 0.3
    on_line = np.interp(middles, stairs.body_profile[:, 0], stairs.body_profile[:, 1])
    np.testing.assert_allclose(on_line, [stairs.height(x) for x in middles])  # the body climbs through the treads


def test_the_highest_ground_between_two_positions_is_that_of_the_step_between_them() -> None:
    stairs = make_terrain("stairs")
    assert stairs.max_height(0.9, 0.95) == 0.0
    assert stairs.max_height(0.9, 1.1) == stairs.max_height(1.1, 0.9) == pytest.approx(0.15)
    assert stairs.max_height(0.9, 2.3) == pytest.approx(0.45)


def test_the_square_ends_at_its_start_with_another_heading() -> None:
    position, heading = np.zeros(2), 0.0
    for segment in make_terrain("flat").path:
        position += segment.advance_m * np.array([np.cos(heading), np.sin(heading)])
        heading += segment.turn_rad
    np.testing.assert_allclose(position, 0.0, atol=1e-12)
    assert heading == pytest.approx(1.5 * np.pi)
    backwards = [segment for segment in make_terrain("flat").path if segment.advance_m < 0.0]
    assert len(backwards) == 2


def test_the_path_stays_inside_the_room(terrain) -> None:
    position, heading = np.zeros(2), 0.0
    bounds = terrain.bounds
    for segment in terrain.path:
        position += segment.advance_m * np.array([np.cos(heading), np.sin(heading)])
        heading += segment.turn_rad
        assert bounds.xmin < position[0] < bounds.xmax
        assert bounds.ymin < position[1] < bounds.ymax
