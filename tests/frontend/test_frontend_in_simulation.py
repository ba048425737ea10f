# SPDX-License-Identifier: BSD-3-Clause
"""Rendered images with blur, noise and vignetting, against rays cast through the model."""

import cv2
import mujoco
import numpy as np
import pytest

from coclo_vio.frontend.frontend import StereoFrontend
from coclo_vio.geometry import se3, so3
from coclo_vio.simulation.visuals.cameras import OPTICAL_FROM_MUJOCO, add_cameras, pinhole, place
from coclo_vio.simulation.visuals.config import CameraConfig, SceneConfig
from coclo_vio.simulation.visuals.opengl import RenderingError, choose_backend
from coclo_vio.simulation.visuals.scene import RoomBounds, Surface, add_visuals
from coclo_vio.simulation.visuals.stereo_renderer import render_stereo
from coclo_vio.values.calibration import StereoCalibration, matrix4
from coclo_vio.values.measurements import StereoFrame, StereoTracks

FRAMES = 5
STAMPS_NS = np.arange(FRAMES, dtype=np.int64) * 66_666_667
FOCAL_PX, BASELINE_M = 385.0, 0.05
CENTRE = np.array([319.5, 239.5])
_OPTICAL = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])  # R_body_camera looking along x
_RISER = np.array([[0.0, 0.0, -1.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])


def stereo() -> StereoCalibration:
    rotation, lens = so3.exp(np.array([0.0, 0.26, 0.0])) @ _OPTICAL, pinhole(640, 480, FOCAL_PX)
    left, right = (se3.transform(rotation, np.array([0.2, y, 0.1])) for y in (0.5 * BASELINE_M, -0.5 * BASELINE_M))
    return StereoCalibration(left=lens, right=lens, body_left_camera=matrix4(left), body_right_camera=matrix4(right))


@pytest.fixture(scope="module")
def model() -> mujoco.MjModel:
    """A floor, three steps, and a room."""
    spec = mujoco.MjSpec()
    body = spec.worldbody.add_body(name="base")
    body.add_freejoint()
    body.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.1, 0.1, 0.03], mass=1.0)
    steps = []
    for number in range(3):
        x, z = 1.4 + 0.4 * number, 0.15 * (number + 1)
        steps.append(Surface(np.array([x, 0.0, z - 0.075]), np.array([0.8, 0.075]), _RISER, "riser"))
        steps.append(Surface(np.array([x + 0.2, 0.0, z]), np.array([0.2, 0.8]), np.eye(3), "tread"))
    floor = Surface(np.array([0.7, 0.0, 0.0]), np.array([1.5, 1.5]), np.eye(3), "floor")
    add_visuals(spec, [floor, *steps], SceneConfig(), 7, RoomBounds(-0.5, 2.5, -1.0, 1.0, 3.0))
    add_cameras(spec, stereo())
    return spec.compile()


def walk() -> np.ndarray:
    """A body that walks at 0.15 m/s and sways, qpos (FRAMES, 7)."""
    time_s = STAMPS_NS * 1e-9
    qpos = np.zeros((FRAMES, 7))
    qpos[:, 0], qpos[:, 2] = 0.15 * time_s, 0.25 + 0.005 * np.sin(7.0 * time_s)
    half_yaw = 0.5 * 0.03 * np.sin(5.0 * time_s)
    qpos[:, 3], qpos[:, 6] = np.cos(half_yaw), np.sin(half_yaw)
    return qpos


@pytest.fixture(scope="module")
def results(model: mujoco.MjModel, tmp_path_factory: pytest.TempPathFactory) -> list[StereoTracks]:
    try:
        choose_backend()
    except RenderingError as error:
        pytest.skip(str(error))
    path = tmp_path_factory.mktemp("front") / "model.mjb"
    mujoco.mj_saveModel(model, str(path))
    frontend, results = StereoFrontend(stereo()), []
    for encoded in render_stereo(path, walk(), STAMPS_NS, CameraConfig(), 7, workers=1):
        left, right = (
            np.asarray(cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_GRAYSCALE), dtype=np.uint8)
            for data in (encoded.left, encoded.right)
        )
        results.append(frontend.track(StereoFrame(encoded.stamp_ns, left, right)))
    return results


def camera(model: mujoco.MjModel, frame: int) -> tuple[np.ndarray, np.ndarray]:
    """R_world_camera and position of the left camera."""
    data = mujoco.MjData(model)
    place(model, data, walk()[frame], np.zeros(6))
    return data.cam_xmat[0].reshape(3, 3) @ OPTICAL_FROM_MUJOCO, data.cam_xpos[0].copy()


def points(model: mujoco.MjModel, frame: int, pixels: np.ndarray) -> np.ndarray:
    """World points (N, 3) at the left camera's pixels (N, 2)."""
    data, hit, normal = mujoco.MjData(model), np.zeros(1, dtype=np.int32), np.zeros(3)
    place(model, data, walk()[frame], np.zeros(6))
    rotation, origin = camera(model, frame)
    rays = np.column_stack(((pixels - CENTRE) / FOCAL_PX, np.ones(len(pixels)))) @ rotation.T
    body = model.body("base").id
    lengths = [mujoco.mj_ray(model, data, origin, ray, None, 1, body, hit, normal) for ray in rays]
    return np.asarray(origin + np.array(lengths)[:, None] * rays)


def projected(model: mujoco.MjModel, frame: int, world: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Pixels (N, 2) and disparities (N,) of world points (N, 3)."""
    rotation, origin = camera(model, frame)
    ahead = (world - origin) @ rotation
    return ahead[:, :2] / ahead[:, 2:] * FOCAL_PX + CENTRE, FOCAL_PX * BASELINE_M / ahead[:, 2]


def test_disparities_are_true_to_depth(model: mujoco.MjModel, results: list[StereoTracks]) -> None:
    errors, rows = [], []
    for frame, tracks in enumerate(results):
        both = np.isfinite(tracks.right_px[:, 0])
        assert both.sum() > 80
        left_px, right_px = tracks.left_px[both], tracks.right_px[both]
        _, disparity = projected(model, frame, points(model, frame, left_px))
        errors.extend((left_px[:, 0] - right_px[:, 0] - disparity).tolist())
        rows.extend((left_px[:, 1] - right_px[:, 1]).tolist())
    error = np.abs(errors)
    assert (error < 0.5).mean() >= 0.95
    assert np.median(error) < 0.12
    assert abs(np.median(errors)) < 0.03
    assert np.median(np.abs(rows)) < 0.1


def test_tracks_stay_on_their_surface_points(model: mujoco.MjModel, results: list[StereoTracks]) -> None:
    first, last = results[0], results[-1]
    _, in_first, in_last = np.intersect1d(first.track_ids, last.track_ids, return_indices=True)
    assert len(in_first) > 60
    expected, _ = projected(model, FRAMES - 1, points(model, 0, first.left_px[in_first]))
    drift = np.linalg.norm(expected - last.left_px[in_last], axis=1)
    assert np.median(drift) < 0.25
    assert (drift < 1.0).mean() > 0.9
