# SPDX-License-Identifier: BSD-3-Clause
"""What makes vision hard in a simulated room: each option adds what it names, and nothing where it is off."""

from pathlib import Path

import cv2
import mujoco
import numpy as np
import pytest
from floating_world import LENS, WALKED, with_visuals

from coclo_vio.geometry import se3, so3
from coclo_vio.simulation.visuals.bareness import bareness
from coclo_vio.simulation.visuals.camera_model import CameraModel
from coclo_vio.simulation.visuals.config import CameraConfig, LightingConfig, SceneConfig
from coclo_vio.simulation.visuals.exposure import Exposure, exposures
from coclo_vio.simulation.visuals.illumination import Illumination, View
from coclo_vio.simulation.visuals.moving import place_walkers
from coclo_vio.simulation.visuals.patterns import bricks, tiles
from coclo_vio.simulation.visuals.relief import relief_faces
from coclo_vio.simulation.visuals.room import Face, RoomBounds, ground_at, room_faces
from coclo_vio.simulation.visuals.stereo_renderer import render_stereo
from coclo_vio.simulation.visuals.textures import RECIPES

SEED = 3
STEP = Face(np.array([1.0, 0.0, 0.3]), np.array([0.4, 1.0]), np.eye(3), "tread")
DOWN = np.array([[0.0, -1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])  # R_world_camera looking at the floor


def view_of_floor(x: float, height: float, T_world_body: np.ndarray | None = None) -> View:
    """A camera above the floor that looks straight down."""
    inverse_depth = np.full((LENS.height_px, LENS.width_px), 1.0 / height, dtype=np.float32)
    body = np.eye(4) if T_world_body is None else T_world_body
    return View(se3.transform(DOWN, np.array([x, 0.0, height])), body, inverse_depth, LENS.focal_px[0])


def seen_at(light: np.ndarray, view: View, x: float, y: float) -> float:
    """The light on a point of the floor in a view from above."""
    local = view.T_world_camera[:3, :3].T @ (np.array([x, y, 0.0]) - view.T_world_camera[:3, 3])
    column, row = view.focal_px * local[:2] / local[2] + np.array(LENS.principal_point_px)
    return float(light[round(row), round(column)])


def test_tiles_repeat_one_motif() -> None:
    tile = tiles(RECIPES["floor"], 960, 0.002, 1.0, SEED).astype(float)
    assert np.corrcoef(tile[:, :-80].ravel(), tile[:, 80:].ravel())[0, 1] > 0.9
    assert abs(np.corrcoef(tile[:, :-37].ravel(), tile[:, 37:].ravel())[0, 1]) < 0.5


def test_bricks_are_shifted_by_half_a_brick_from_row_to_row() -> None:
    tile = bricks(RECIPES["wall"], 1000, 0.002, 1.0, SEED).astype(float)
    first, second = tile[20:40].mean(axis=0), tile[70:90].mean(axis=0)
    assert np.corrcoef(first, np.roll(second, 50))[0, 1] > 0.4
    assert abs(np.corrcoef(first, second)[0, 1]) < 0.2


def test_the_ground_at_a_point_is_the_highest_face() -> None:
    slope = Face(np.array([1.0, 0.0, 0.2]), np.array([1.0, 1.0]), so3.exp(np.array([0.0, -0.3, 0.0])), "ramp")
    assert ground_at([STEP, slope], 0.7, 0.0)[0] == pytest.approx(0.3)
    height, normal = ground_at([slope], 1.2, 0.0)
    assert height == pytest.approx(0.2 + 0.2 * np.tan(0.3))
    assert normal @ [0.0, 0.0, 1.0] == pytest.approx(np.cos(0.3))
    assert ground_at([STEP], 3.0, 0.0)[0] == 0.0


def test_stones_lie_on_the_ground_beside_the_way_and_boxes_on_the_walls() -> None:
    walked = RoomBounds(-1.5, 4.0, -1.5, 1.5, 3.0)
    config = SceneConfig(rubble=40, wall_relief=10)
    room = room_faces(walked, config, np.random.default_rng(1))
    faces = relief_faces(walked, [STEP], room, config, np.random.default_rng(2))
    assert len(faces) == 6 * 50
    stones = np.array([face.center for face in faces[:240]]).reshape(40, 6, 3).mean(axis=1)
    inside = (np.abs(stones[:, 1]) < 0.6) & (stones[:, 0] > -0.6) & (stones[:, 0] < 3.1)
    assert not inside.any()
    assert stones[:, 2].max() < 0.45
    plain = relief_faces(walked, [STEP], room, SceneConfig(), np.random.default_rng(2))
    assert plain == []


def test_walkers_walk_to_and_fro_at_a_walking_speed_and_change_no_coordinate_of_the_robot() -> None:
    model = with_visuals(SEED, SceneConfig(moving=3)).compile()
    plain = with_visuals(SEED).compile()
    assert (model.nq, model.nv, plain.nmocap) == (plain.nq, plain.nv, 0)
    data, places = mujoco.MjData(model), []
    for time_s in np.arange(0.0, 30.0, 0.1):
        place_walkers(model, data, time_s)
        places.append(data.mocap_pos.copy())
    steps = np.linalg.norm(np.diff(places, axis=0), axis=2) / 0.1
    assert 0.2 < np.median(steps) < 0.95
    assert steps.max() < 0.95
    assert np.ptp(np.array(places), axis=0).max() > 0.8
    x, y = np.array(places)[..., 0], np.array(places)[..., 1]
    assert x.min() >= WALKED.xmin
    assert x.max() <= WALKED.xmax
    assert np.abs(y).max() <= WALKED.ymax


def test_specular_patches_lie_on_the_ground() -> None:
    model = with_visuals(SEED, SceneConfig(mirrors=5, mirror_share=0.4)).compile()
    patches = [model.geom(f"mirror_{number}") for number in range(5)]
    for patch in patches:
        assert min(abs(patch.pos[2] - height) for height in (0.0, 0.15, 0.3, 0.45)) < 1e-9
        assert model.mat_reflectance[patch.matid[0]] == pytest.approx(0.4)
    assert not (with_visuals(SEED).compile().mat_reflectance > 0.0).any()


def test_surfaces_are_bare_on_the_last_part_of_the_way() -> None:
    model = with_visuals(SEED, SceneConfig(bare_from=0.6)).compile()
    stamps = np.arange(101, dtype=np.int64) * 100_000_000
    qpos = np.zeros((101, 7))
    qpos[:, 0] = np.linspace(0.0, 2.0, 101)
    bare = bareness(model, qpos, stamps)
    assert bare[:54].max() == 0.0
    assert bare[61:].min() > 0.9
    assert (np.diff(bare) >= -1e-12).all()
    assert (bareness(with_visuals(SEED).compile(), qpos, stamps) == 0.0).all()


@pytest.mark.long
def test_images_of_bare_surfaces_have_little_gradient(opengl: str, tmp_path: Path) -> None:
    path = tmp_path / "model.mjb"
    mujoco.mj_saveModel(with_visuals(SEED, SceneConfig(bare_from=0.5, texture="rich")).compile(), str(path))
    stamps = np.array([0, 1, 2], dtype=np.int64) * 1_000_000_000
    qpos = np.zeros((3, 7))
    qpos[:, 0], qpos[:, 2], qpos[:, 3] = [0.0, 0.02, 0.03], 0.25, 1.0
    config = CameraConfig.parse({"imager": {"read_noise_e": 0, "full_well_e": 1e6, "pattern_noise": 0}}, "camera")
    frames = list(render_stereo(path, qpos, stamps, config, SEED, 1))
    images = [cv2.imdecode(np.frombuffer(frame.left, np.uint8), cv2.IMREAD_GRAYSCALE) for frame in frames]
    smooth = [cv2.GaussianBlur(image.astype(np.float32), (0, 0), 1.5) for image in images]
    strength = [float(np.median(np.abs(cv2.Sobel(image, cv2.CV_32F, 1, 0)))) for image in smooth]
    assert strength[0] > 4.0 * strength[2]
    assert strength[0] > 4.0 * strength[1]


def test_stripes_of_shade_stay_where_they_are() -> None:
    even = Illumination(LightingConfig(), SEED)
    assert even.is_even
    light = Illumination(LightingConfig(bars=0.6), SEED)
    assert not light.is_even
    first, second = view_of_floor(0.0, 2.0), view_of_floor(0.3, 1.6)
    one, other = light.on(first), light.on(second)
    assert one.min() == pytest.approx(0.4)
    assert one.max() == pytest.approx(1.0)
    points = np.random.default_rng(1).uniform(-0.4, 0.6, (200, 2))
    pairs = np.array([(seen_at(one, first, *point), seen_at(other, second, *point)) for point in points])
    assert np.mean(np.abs(pairs[:, 0] - pairs[:, 1]) < 0.05) > 0.9


def test_the_robots_shadow_moves_with_it() -> None:
    light = Illumination(LightingConfig(own_shadow=0.5), SEED)
    first, second = np.eye(4), np.eye(4)
    first[:3, 3], second[:3, 3] = [-0.3, 0.0, 0.2], [0.2, 0.0, 0.2]
    one, other = (light.on(view_of_floor(0.0, 2.5, body)) for body in (first, second))
    assert one.min() == pytest.approx(0.5)
    shadows = [np.argwhere(image < 0.75).mean(axis=0) for image in (one, other)]
    assert np.linalg.norm(shadows[1] - shadows[0]) == pytest.approx(0.5 * LENS.focal_px[0] / 2.5, rel=0.05)


def test_a_lamp_lights_what_is_near_and_in_the_middle() -> None:
    light = Illumination(LightingConfig(lamp=1.0), SEED)
    near, far = light.on(view_of_floor(0.0, 0.8)), light.on(view_of_floor(0.0, 1.6))
    middle = (LENS.height_px // 2, LENS.width_px // 2)
    assert near[middle] == pytest.approx(1.0, abs=0.01)
    assert far[middle] == pytest.approx(0.25, abs=0.01)
    assert near[0, 0] < 0.5 * near[middle]


def test_the_gain_jumps_from_level_to_level() -> None:
    stamps = np.arange(3000, dtype=np.int64) * 66_666_667

    def gains(**exposure: float) -> np.ndarray:
        config = CameraConfig.parse({"exposure": {"drift": 0.0, **exposure}}, "camera")
        return np.log([each.gain for each in exposures(stamps, config, SEED)])

    assert np.ptp(gains()) == 0.0
    jumping = gains(jump=0.5, jump_every_s=2.0)
    changes = np.flatnonzero(np.diff(jumping))
    assert 60 < len(changes) < 140  # 200 s
    assert np.std(jumping[changes]) == pytest.approx(0.5, rel=0.25)


def test_a_rolling_shutter_slants_an_edge_while_the_camera_turns() -> None:
    image = np.full((240, 320), 40, dtype=np.uint8)
    image[:, 160:] = 200
    perfect = {"full_well_e": 1e6, "read_noise_e": 0, "pattern_noise": 0, "vignetting": 0, "lens_blur_px": 0}
    config = CameraConfig.parse({"imager": {"gain_mismatch": 0, **perfect, "readout_s": 0.02}}, "camera")
    rate = np.array([0.0, 1.0, 0.0, 0.0, 0.0, 0.0])  # to the right: what is seen moves to the left
    exposure = Exposure(duration_s=1e-5, gain=1.5, brightness=1.0)
    depth = np.ones((240, 320), dtype=np.float32)
    recorded = CameraModel(config, 0, 320, 240, 190.0, 1).record(image, depth, rate, exposure, 0).astype(float)
    edges = (200.0 - recorded).sum(axis=1) / 160.0
    assert edges[0] - edges[-1] == pytest.approx(190.0 * 0.02, rel=0.05)
    still = CameraModel(config, 0, 320, 240, 190.0, 1).record(image, depth, np.zeros(6), exposure, 0).astype(float)
    assert np.ptp((200.0 - still).sum(axis=1)) < 160.0 * 0.2
