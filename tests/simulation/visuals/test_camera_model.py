# SPDX-License-Identifier: BSD-3-Clause
import cv2
import numpy as np
import pytest

from coclo_vio.simulation.visuals.camera_model import CameraModel
from coclo_vio.simulation.visuals.config import CameraConfig
from coclo_vio.simulation.visuals.exposure import Exposure

WIDTH, HEIGHT, FOCAL_PX = 320, 240, 190.0
STILL = np.zeros(6)
FLAT = np.full((HEIGHT, WIDTH), 100, dtype=np.uint8)
METRE = np.ones((HEIGHT, WIDTH), dtype=np.float32)
PERFECT = {"full_well_e": 1e6, "read_noise_e": 0, "pattern_noise": 0, "vignetting": 0, "lens_blur_px": 0}
NOMINAL = Exposure(duration_s=0.0085, gain=1.5, brightness=1.0)


def camera(side: int = 0, seed: int = 1, **imager: float) -> CameraModel:
    config = CameraConfig.parse({"imager": {"gain_mismatch": 0, **imager}}, "camera")
    return CameraModel(config, side, WIDTH, HEIGHT, FOCAL_PX, seed)


def step_edge() -> np.ndarray:
    """Dark on the left, bright on the right of the middle."""
    image = np.full((HEIGHT, WIDTH), 40, dtype=np.uint8)
    image[:, WIDTH // 2 :] = 200
    return image


@pytest.mark.parametrize(("gain", "grey"), [(1.5, 60), (1.5, 120), (8.0, 60)])
def test_noise_follows_the_photon_transfer_curve(gain: float, grey: int) -> None:
    imager = camera(pattern_noise=0, vignetting=0)
    image = np.full_like(FLAT, grey)
    frames = [imager.record(image, METRE, STILL, Exposure(0.0085, gain, 1.0), frame) for frame in (0, 1)]
    difference = frames[0].astype(float) - frames[1]
    scale = 255.0 * gain / 6300.0
    expected = scale * grey + (2.5 * scale) ** 2 + 1.0 / 12.0  # shot, read, eight bits
    assert difference.var() / 2.0 == pytest.approx(expected, rel=0.02)
    assert np.mean(frames) == pytest.approx(grey, abs=0.1)


def test_middle_greys_have_two_to_three_levels_of_noise() -> None:
    recorded = camera(vignetting=0).record(FLAT, METRE, STILL, NOMINAL, 0).astype(float)
    assert 2.0 < recorded.std() < 3.0


def test_without_light_there_is_read_noise_only() -> None:
    recorded = camera().record(FLAT, METRE, STILL, Exposure(0.02, 15.9, 1e-6), 0)
    assert recorded.mean() < 2.0
    assert recorded.any()


def test_corners_are_darker_by_the_vignetting() -> None:
    recorded = camera(**{**PERFECT, "vignetting": 0.4}).record(FLAT, METRE, STILL, NOMINAL, 0)
    assert int(recorded[HEIGHT // 2, WIDTH // 2]) == pytest.approx(100, abs=1)
    for row, column in ((0, 0), (0, -1), (-1, 0), (-1, -1)):
        assert int(recorded[row, column]) == pytest.approx(60, abs=1)


def test_same_seed_frame_and_camera_same_bytes_and_any_other_differs() -> None:
    def recorded(side: int = 0, seed: int = 1, frame: int = 2) -> bytes:
        return camera(side, seed).record(FLAT, METRE, STILL, NOMINAL, frame).tobytes()

    assert recorded() == recorded()
    assert len({recorded(), recorded(side=1), recorded(seed=2), recorded(frame=3)}) == 4


def test_pattern_is_fixed_to_the_camera() -> None:
    imager = camera(**{**PERFECT, "pattern_noise": 0.02})
    first, second = (imager.record(FLAT, METRE, STILL, NOMINAL, frame).astype(float) for frame in (0, 1))
    other = camera(side=1, **{**PERFECT, "pattern_noise": 0.02}).record(FLAT, METRE, STILL, NOMINAL, 0)
    assert np.corrcoef(first.ravel(), second.ravel())[0, 1] > 0.8
    assert abs(np.corrcoef(first.ravel(), other.ravel())[0, 1]) < 0.05


def edge_width_px(image: np.ndarray) -> float:
    """Width of the ramp that a step became, in the middle row: its height over its area beyond the ideal step."""
    row = (image[HEIGHT // 2].astype(float) - 40.0) / 160.0
    return float(4.0 * np.abs(row - (np.arange(WIDTH) >= WIDTH // 2)).sum())


@pytest.mark.parametrize(
    ("twist", "width_px"),
    [
        ([0.0, 1.5, 0.0, 0.0, 0.0, 0.0], 1.5 * 0.02 * FOCAL_PX),  # yaw moves the middle by the focal length
        ([0.0, 0.0, 0.0, 0.8, 0.0, 0.0], 0.8 * 0.02 * FOCAL_PX / 0.5),  # sideways: over the depth of 0.5 m
        ([1.5, 0.0, 0.0, 0.0, 0.8, 0.0], 0.0),  # up and down moves along the edge
        ([0.0, 1.5, 0.0, -0.75, 0.0, 0.0], 0.0),  # a turn to the right and a step to the left hold the edge still
        ([0.0] * 6, 0.0),
    ],
)
def test_an_edge_is_smeared_by_the_way_it_moves_during_the_exposure(twist: list[float], width_px: float) -> None:
    recorded = camera(**PERFECT).record(step_edge(), 2.0 * METRE, np.array(twist), Exposure(0.02, 1.0, 1.0), 0)
    assert edge_width_px(recorded) == pytest.approx(width_px, rel=0.12, abs=0.25)


def test_blur_does_not_move_the_image() -> None:
    """The stamp is the middle of the exposure: the smeared edge is where the sharp one was."""
    recorded = camera(**PERFECT).record(
        step_edge(), METRE, np.array([0.0, 1.5, 0.0, 0.0, 0.0, 0.0]), Exposure(0.02, 1.0, 1.0), 0
    )
    area = ((recorded[HEIGHT // 2].astype(float) - 40.0) / 160.0).sum()
    assert area == pytest.approx(WIDTH / 2, abs=0.1)


def test_png_keeps_every_bit_and_jpeg_nearly() -> None:
    recorded = camera().record(step_edge(), METRE, STILL, NOMINAL, 0)

    def read_back(encoding: str) -> np.ndarray:
        config = CameraConfig.parse({"encoding": encoding}, "camera")
        data = CameraModel(config, 0, WIDTH, HEIGHT, FOCAL_PX, 1).encode(recorded)
        return np.asarray(cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED))

    np.testing.assert_array_equal(read_back("png"), recorded)
    error = read_back("jpeg").astype(float) - recorded
    assert 0.0 < error.std() < 3.0


@pytest.mark.skipif(not hasattr(cv2, "IMWRITE_PNG_FILTER"), reason="OpenCV before 4.12 cannot choose the filter")
def test_png_files_of_noisy_images_are_smaller_than_opencvs_default_ones() -> None:
    x, y = np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT))
    scene = (128.0 + 60.0 * np.sin(0.2 * x) * np.cos(0.15 * y)).astype(np.float32)
    model = camera()
    recorded = model.record(scene, METRE, STILL, NOMINAL, 0)
    _, plain = cv2.imencode(".png", recorded)
    assert len(model.encode(recorded)) < 0.98 * len(plain)


def test_jpeg_files_are_smaller_than_opencvs_default_ones_and_hold_the_same_pixels() -> None:
    recorded = camera().record(step_edge(), METRE, STILL, NOMINAL, 0)
    config = CameraConfig.parse({"encoding": "jpeg", "jpeg_quality": 40}, "camera")
    ours = np.frombuffer(CameraModel(config, 0, WIDTH, HEIGHT, FOCAL_PX, 1).encode(recorded), np.uint8)
    _, plain = cv2.imencode(".jpg", recorded, [cv2.IMWRITE_JPEG_QUALITY, 40])
    assert len(ours) < len(plain)
    np.testing.assert_array_equal(cv2.imdecode(ours, cv2.IMREAD_UNCHANGED), cv2.imdecode(plain, cv2.IMREAD_UNCHANGED))
