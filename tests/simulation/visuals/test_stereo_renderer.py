# SPDX-License-Identifier: BSD-3-Clause
"""Rendered images against rays cast through the model: a reference without OpenGL."""

import itertools
import multiprocessing
from pathlib import Path

import cv2
import mujoco
import numpy as np
import pytest
from floating_world import BASELINE_M, LENS, floating_body, stereo_pair

from coclo_vio.simulation.visuals.cameras import OPTICAL_FROM_MUJOCO, add_cameras, place
from coclo_vio.simulation.visuals.config import CameraConfig
from coclo_vio.simulation.visuals.opengl import BACKENDS, RenderingError, works
from coclo_vio.simulation.visuals.stereo_renderer import render_stereo
from coclo_vio.values.measurements import EncodedStereoFrame

SEED = 11
FRAMES = 6
STAMPS_NS = np.arange(FRAMES, dtype=np.int64) * 66_666_667
FOCAL_PX = LENS.focal_px[0]


def walk() -> np.ndarray:
    """A body that walks at 0.15 m/s and sways, qpos (FRAMES, 7)."""
    time_s = STAMPS_NS * 1e-9
    qpos = np.zeros((FRAMES, 7))
    qpos[:, 0] = 0.15 * time_s
    qpos[:, 2] = 0.25 + 0.005 * np.sin(7.0 * time_s)
    half_yaw = 0.5 * 0.03 * np.sin(5.0 * time_s)
    qpos[:, 3], qpos[:, 6] = np.cos(half_yaw), np.sin(half_yaw)
    return qpos


def render(path: Path, workers: int = 1, seed: int = SEED, **config: object) -> list[EncodedStereoFrame]:
    return list(render_stereo(path, walk(), STAMPS_NS, CameraConfig.parse(config, "camera"), seed, workers))


def decoded(data: bytes) -> np.ndarray:
    return np.asarray(cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED))


@pytest.fixture(scope="module")
def frames(opengl: str, model_path: Path) -> list[EncodedStereoFrame]:
    return render(model_path)


class RayCaster:
    """True depths and positions by casting rays from the left camera at one frame."""

    def __init__(self, model: mujoco.MjModel, frame: int) -> None:
        self._model, self._data = model, mujoco.MjData(model)
        place(model, self._data, walk()[frame], np.zeros(6))

    def pose(self, side: int) -> tuple[np.ndarray, np.ndarray]:
        """R_world_camera and position of the left (0) or right (1) camera."""
        return self._data.cam_xmat[side].reshape(3, 3) @ OPTICAL_FROM_MUJOCO, self._data.cam_xpos[side].copy()

    def points(self, pixels: np.ndarray) -> np.ndarray:
        """World points (n, 3) on the rays of the left camera's pixels (n, 2)."""
        rotation, origin = self.pose(0)
        ahead = np.column_stack(((pixels - LENS.principal_point_px) / FOCAL_PX, np.ones(len(pixels)))) @ rotation.T
        hit, normal = np.zeros(1, dtype=np.int32), np.zeros(3)
        body = self._model.body("base").id
        lengths = [mujoco.mj_ray(self._model, self._data, origin, ray, None, 1, body, hit, normal) for ray in ahead]
        assert min(lengths) > 0.0  # the room has no hole
        return origin + np.array(lengths)[:, None] * ahead

    def pixels(self, points: np.ndarray, side: int) -> np.ndarray:
        """Projections (n, 2) of world points (n, 3), px."""
        rotation, origin = self.pose(side)
        in_camera = (points - origin) @ rotation
        return FOCAL_PX * in_camera[:, :2] / in_camera[:, 2:] + LENS.principal_point_px

    def faces_camera(self, pixels: np.ndarray) -> np.ndarray:
        """Whether disparity is even (within 0.3 px) over the window about each pixel: a face seen from the front."""
        disparities = [
            (window - self.pixels(self.points(window), 1))[:, 0]
            for window in (pixels + np.array([dx, dy]) for dx, dy in itertools.product((-10.0, 10.0), repeat=2))
        ]
        return np.ptp(disparities, axis=0) < 0.3


def track(before: np.ndarray, after: np.ndarray, corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Pyramidal Lucas-Kanade there and back: pixels (n, 2) and whether they are kept."""
    there, found, _ = cv2.calcOpticalFlowPyrLK(before, after, corners[:, None], None, winSize=(21, 21), maxLevel=3)
    back, returned, _ = cv2.calcOpticalFlowPyrLK(after, before, there, None, winSize=(21, 21), maxLevel=3)
    closes = np.linalg.norm(back[:, 0] - corners, axis=1) < 0.5
    return there[:, 0], (found[:, 0] > 0) & (returned[:, 0] > 0) & closes


def corners_of(image: np.ndarray) -> np.ndarray:
    return np.asarray(cv2.goodFeaturesToTrack(image, 150, 0.01, 25))[:, 0]


def centroid(image: np.ndarray, about: np.ndarray) -> list[float]:
    """Middle (column, row) of the light within 10 px of a pixel."""
    column, row = np.rint(about).astype(int) - 10
    patch = image[row : row + 21, column : column + 21]
    assert patch.sum() > 1000.0
    share = patch / patch.sum()
    steps = np.arange(21)
    return [column + share.sum(axis=0) @ steps, row + share.sum(axis=1) @ steps]


def test_frames_come_in_order_with_their_stamps(frames: list[EncodedStereoFrame]) -> None:
    assert [frame.stamp_ns for frame in frames] == STAMPS_NS.tolist()
    for frame in frames:
        assert decoded(frame.left).shape == decoded(frame.right).shape == (480, 640)


def test_images_are_neither_black_nor_saturated(frames: list[EncodedStereoFrame]) -> None:
    for frame in frames:
        for image in (decoded(frame.left), decoded(frame.right)):
            assert 60.0 < image.mean() < 150.0
            assert (image > 250).mean() < 0.02
            assert (image < 5).mean() < 0.02


@pytest.mark.long
def test_same_seed_same_bytes_whatever_the_number_of_processes(
    frames: list[EncodedStereoFrame], model_path: Path
) -> None:
    assert render(model_path, workers=2) == frames


@pytest.mark.long
def test_another_seed_has_other_noise(frames: list[EncodedStereoFrame], model_path: Path) -> None:
    other = render(model_path, seed=SEED + 1)
    assert all(a.left != b.left and a.right != b.right for a, b in zip(frames, other, strict=True))


def test_disparity_is_true_to_depth(frames: list[EncodedStereoFrame], model: mujoco.MjModel) -> None:
    errors = []
    for number in (0, FRAMES - 1):
        left, right = decoded(frames[number].left), decoded(frames[number].right)
        corners, caster = corners_of(left), RayCaster(model, number)
        matched, kept = track(left, right, corners)
        good = kept & caster.faces_camera(corners)
        errors.append((matched - caster.pixels(caster.points(corners), 1))[good])
    error = np.concatenate(errors)
    assert len(error) > 50
    assert (np.linalg.norm(error, axis=1) < 0.5).mean() > 0.9
    assert np.abs(np.median(error, axis=0)).max() < 0.06


def test_depth_is_focal_length_times_baseline_over_disparity(model: mujoco.MjModel) -> None:
    caster = RayCaster(model, 0)
    pixels = np.array([[100.0, 300.0], [320.0, 240.0], [500.0, 400.0]])
    points = caster.points(pixels)
    rotation, origin = caster.pose(0)
    disparity = (pixels - caster.pixels(points, 1))[:, 0]
    np.testing.assert_allclose(disparity, FOCAL_PX * BASELINE_M / ((points - origin) @ rotation)[:, 2], rtol=1e-9)


def test_a_point_is_rendered_at_its_pinhole_projection(opengl: str, tmp_path: Path) -> None:
    """Shining balls in the dark: an error of half a pixel in the principal point would fail the test."""
    spec = floating_body()
    add_cameras(spec, stereo_pair())
    spec.visual.headlight.active = 0
    spec.add_material(name="shining", emission=1.0, rgba=[1.0, 1.0, 1.0, 1.0])
    balls = np.array([[1.5, 0.5, 0.2], [1.5, -0.4, 0.7], [2.0, 0.1, -0.1]])
    for ball in balls:
        spec.worldbody.add_geom(size=[0.01, 0.0, 0.0], pos=ball, material="shining", contype=0, conaffinity=0)
    model = spec.compile()
    path = tmp_path / "balls.mjb"
    mujoco.mj_saveModel(model, str(path))
    imager = {"full_well_e": 1e6, "read_noise_e": 0, "pattern_noise": 0, "vignetting": 0, "lens_blur_px": 0}
    frame = render(path, imager=imager, exposure={"white_level": 0.5, "nominal_s": 1e-5})[0]
    for side, data in enumerate((frame.left, frame.right)):
        image, expected = decoded(data).astype(float), RayCaster(model, 0).pixels(balls, side)
        rendered = np.array([centroid(image, pixel) for pixel in expected])
        np.testing.assert_allclose(rendered, expected, rtol=0, atol=0.1)


def test_features_survive_to_the_next_frame_but_not_all(
    frames: list[EncodedStereoFrame], model: mujoco.MjModel
) -> None:
    kept_shares, errors = [], []
    for number in range(FRAMES - 1):
        before, after = decoded(frames[number].left), decoded(frames[number + 1].left)
        corners = corners_of(before)
        tracked, kept = track(before, after, corners)
        kept_shares.append(kept.mean())
        truth = RayCaster(model, number + 1).pixels(RayCaster(model, number).points(corners), 0)
        errors.append(np.linalg.norm(tracked - truth, axis=1)[kept])
    assert 0.88 < np.mean(kept_shares) < 0.99
    assert np.median(np.concatenate(errors)) < 0.25


@pytest.mark.parametrize("backend", BACKENDS)
def test_every_available_backend_renders_the_same_bytes(
    backend: str, frames: list[EncodedStereoFrame], model_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("MUJOCO_GL", backend)
    if works(backend):
        assert render(model_path) == frames
    else:
        with pytest.raises(RenderingError, match=f"MUJOCO_GL={backend} is set"):
            render(model_path)


def test_a_blackout_darkens_its_frames_only(opengl: str, model_path: Path) -> None:
    blackouts = [{"start_s": 0.1, "duration_s": 0.1}]
    means = [decoded(frame.left).mean() for frame in render(model_path, lighting={"blackouts": blackouts})]
    assert np.array(means[2:3]).max() < 10.0
    assert means[0] > 60.0
    assert means[4] > 60.0


def test_progress_counts_and_closing_leaves_no_process(opengl: str, model_path: Path) -> None:
    reports: list[int] = []
    rendering = render_stereo(model_path, walk(), STAMPS_NS, CameraConfig(), SEED, 1, reports.append)
    for _ in range(3):
        next(rendering)
    rendering.close()
    assert multiprocessing.active_children() == []
    assert reports == [1, 2]  # the third is counted when the fourth is requested


def test_a_model_without_cameras_is_refused_in_one_sentence(opengl: str, tmp_path: Path) -> None:
    path = tmp_path / "bare.mjb"
    mujoco.mj_saveModel(floating_body().compile(), str(path))
    with pytest.raises(RenderingError, match="no camera 'left_camera'"):
        render(path)
    with pytest.raises(RenderingError, match="there is no model file"):
        render(tmp_path / "missing.mjb")


def test_rows_that_do_not_fit_are_refused(opengl: str, model_path: Path) -> None:
    with pytest.raises(RenderingError, match=r"frames must have a row of 7 for each of 6 stamps, got \(5, 7\)"):
        list(render_stereo(model_path, walk()[:5], STAMPS_NS, CameraConfig(), SEED, 1))
    with pytest.raises(ValueError, match="must ascend"):
        render_stereo(model_path, walk(), STAMPS_NS[::-1], CameraConfig(), SEED, 1)
