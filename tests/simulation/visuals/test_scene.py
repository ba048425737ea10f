# SPDX-License-Identifier: BSD-3-Clause
import mujoco
import numpy as np
import pytest
from floating_world import WALKED, floating_body, with_visuals

from coclo_vio.simulation.visuals.config import SceneConfig
from coclo_vio.simulation.visuals.room import Face, room_faces
from coclo_vio.simulation.visuals.scene import RoomBounds, Surface, add_visuals
from coclo_vio.values.errors import ConfigError

SMALL = SceneConfig(texture_px=64)


def faces_of(seed: int) -> list[Face]:
    return room_faces(WALKED, SceneConfig(), np.random.default_rng(seed))


def test_visuals_are_rendered_and_not_solid(model: mujoco.MjModel) -> None:
    bare = floating_body().compile()
    added = [geom for geom in range(model.ngeom) if model.geom(geom).name.startswith("visual_")]
    assert len(added) > 5
    assert not model.geom_contype[added].any()
    assert not model.geom_conaffinity[added].any()
    assert set(model.geom_group[added]) <= {0, 1, 2}
    np.testing.assert_array_equal(model.body_mass, bare.body_mass)
    assert (model.nq, model.nv, model.nbody) == (bare.nq, bare.nv, bare.nbody)


def test_visuals_are_added_to_a_robot_from_a_urdf() -> None:
    inertia = '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>'
    spec = mujoco.MjSpec.from_string(
        f'<robot name="r"><link name="base"><inertial><mass value="1"/>{inertia}</inertial></link></robot>'
    )
    add_visuals(spec, [], SMALL, seed=1, walked=WALKED)
    compiled = spec.compile()
    assert {"visual_floor", "visual_wall"} <= {compiled.geom(geom).name for geom in range(compiled.ngeom)}


def test_same_seed_same_scene() -> None:
    first, again, other = (with_visuals(seed, SMALL).compile() for seed in (5, 5, 6))
    for name in ("tex_data", "mesh_vert", "mesh_texcoord", "geom_pos"):
        np.testing.assert_array_equal(getattr(first, name), getattr(again, name))
    assert not np.array_equal(first.tex_data, other.tex_data)
    assert first.mesh_vert.shape != other.mesh_vert.shape or not np.array_equal(first.mesh_vert, other.mesh_vert)


def test_corners_run_counter_clockwise_about_the_normal() -> None:
    for face in faces_of(seed=1):
        first, second, third, _ = face.corners()
        normal = np.cross(second - first, third - second)
        np.testing.assert_allclose(normal / np.linalg.norm(normal), face.rotation[:, 2], rtol=0, atol=1e-9)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_walls_face_inwards_at_two_and_a_half_to_five_metres(seed: int) -> None:
    walls = [face for face in faces_of(seed) if face.texture == "wall" and abs(face.rotation[2, 2]) < 0.5]
    assert len(walls) == 4
    for wall in walls:
        axis = int(np.argmax(np.abs(wall.rotation[:, 2])))
        inwards = np.sign(wall.rotation[axis, 2])
        edge = ((WALKED.xmin, WALKED.xmax), (WALKED.ymin, WALKED.ymax))[axis][0 if inwards > 0 else 1]
        assert 2.5 <= inwards * (edge - wall.center[axis]) <= 5.0


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_the_walked_area_is_clear(seed: int) -> None:
    for face in faces_of(seed):
        corners = face.corners()
        is_low = corners[:, 2].max() > 0.0 and corners[:, 2].min() < 2.0  # neither floor nor ceiling
        assert not (is_low and any(WALKED.contains(x, y, 0.7) for x, y, _ in corners))


def test_posters_hang_in_front_of_their_wall_and_under_the_ceiling() -> None:
    posters = [face for face in faces_of(seed=4) if face.texture == "poster"]
    assert len(posters) > 4
    for poster in posters:
        assert poster.corners()[:, 2].min() > -0.31
        assert poster.corners()[:, 2].max() <= WALKED.height + 1e-9


def test_poor_texture_has_less_contrast_than_rich() -> None:
    spreads = []
    for texture in ("poor", "normal", "rich"):
        compiled = with_visuals(7, SceneConfig(texture=texture, texture_px=128)).compile()
        spreads.append(compiled.tex_data[: 128 * 128 * 3].astype(float).std())
    assert spreads == sorted(spreads)
    assert spreads[2] > 2.0 * spreads[0]


def test_surfaces_alone_locate_the_room() -> None:
    spec = floating_body()
    add_visuals(spec, [Surface(np.array([3.0, 4.0, 0.5]), np.array([1.0, 0.5]), np.eye(3), "tread")], SMALL, seed=1)
    compiled = spec.compile()
    np.testing.assert_allclose(compiled.stat.center[:2], [3.0, 4.0], rtol=0, atol=1.5)


def test_a_room_without_a_position_is_refused() -> None:
    with pytest.raises(ConfigError, match="no surfaces and no walked area"):
        add_visuals(floating_body(), [], SMALL, seed=1)
    with pytest.raises(ConfigError, match="least bound above the greatest"):
        RoomBounds(1.0, 0.0, 0.0, 1.0, 3.0)


def test_an_invalid_surface_is_refused_with_its_reason() -> None:
    half = np.array([1.0, 1.0])
    with pytest.raises(ValueError, match="half_extent must be positive"):
        Surface(np.zeros(3), np.array([1.0, 0.0]), np.eye(3), "floor")
    with pytest.raises(ValueError, match="must be a rotation"):
        Surface(np.zeros(3), half, np.diag([1.0, 1.0, -1.0]), "floor")
    with pytest.raises(ValueError, match="one of floor, ramp, tread, riser, side"):
        Surface(np.zeros(3), half, np.eye(3), "wall")  # type: ignore[arg-type]


def test_walls_nearer_than_their_least_distance_are_refused() -> None:
    with pytest.raises(ConfigError, match="wall_distance_m"):
        SceneConfig.parse({"wall_distance_m": [5.0, 2.5]}, "scene")
