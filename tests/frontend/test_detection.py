# SPDX-License-Identifier: BSD-3-Clause
import numpy as np
import pytest
from textured_room import textures

from coclo_vio.frontend.config import DetectionConfig
from coclo_vio.frontend.detection import CornerDetector, _median

ROWS, COLUMNS = 360, 480
IMAGE = np.rint(textures()[0][:ROWS, :COLUMNS]).astype(np.uint8)
EVERYWHERE = np.full((ROWS, COLUMNS), 255, dtype=np.uint8)
NONE = np.zeros((0, 2))


def detector(valid: np.ndarray = EVERYWHERE, **config: object) -> CornerDetector:
    return CornerDetector(DetectionConfig.parse(config, "detection"), valid)


def distances(points: np.ndarray, others: np.ndarray) -> np.ndarray:
    return np.linalg.norm(points[:, None] - others[None], axis=2)


def test_the_configured_number_of_points_keeps_the_minimum_distance() -> None:
    points = detector().find(IMAGE, NONE)
    assert len(points) == 150
    gaps = distances(points, points) + 1e9 * np.eye(150)
    assert gaps.min() >= 15.0


def test_new_points_keep_the_minimum_distance_from_existing_ones() -> None:
    existing = detector().find(IMAGE, NONE)[:90]
    fresh = detector().find(IMAGE, existing)
    assert len(fresh) > 40
    assert distances(fresh, existing).min() >= 14.0


def test_points_are_spread_over_the_image() -> None:
    """The left half has twice the contrast, so corners four times as strong, and gets no more than half the points."""
    image = IMAGE.astype(float)
    image[:, : COLUMNS // 2] = 120.0 + 0.5 * (image[:, : COLUMNS // 2] - 120.0)
    points = detector(tracks=80).find(np.rint(image).astype(np.uint8), NONE)
    assert 0.35 < (points[:, 0] < COLUMNS // 2).mean() < 0.65


def test_weak_corners_are_taken_only_where_strong_ones_are_missing() -> None:
    image = IMAGE.astype(float)
    image[:, : COLUMNS // 2] = 120.0 + 0.2 * (image[:, : COLUMNS // 2] - 120.0)
    noisy = np.rint(image + 2.0 * np.random.default_rng(0).standard_normal(image.shape)).clip(0, 255).astype(np.uint8)
    few, many = (detector(tracks=tracks).find(noisy, NONE) for tracks in (50, 200))
    assert (few[:, 0] < COLUMNS // 2).mean() < 0.1
    assert (many[:, 0] < COLUMNS // 2).sum() > 20


def test_empty_cells_are_filled_first() -> None:
    left = detector().find(IMAGE, NONE)
    existing = left[left[:, 0] < COLUMNS // 2]
    fresh = detector(tracks=len(existing) + 15).find(IMAGE, existing)
    assert len(fresh) == 15
    assert (fresh[:, 0] > COLUMNS // 2 - 10).all()


def test_with_enough_points_none_are_detected() -> None:
    existing = detector().find(IMAGE, NONE)
    assert len(detector().find(IMAGE, existing[:148])) == 0


def test_no_point_is_detected_at_the_border_or_outside_the_valid_area() -> None:
    valid = EVERYWHERE.copy()
    valid[:, :120] = 0
    finder = detector(valid)
    points = finder.find(IMAGE, NONE)
    assert len(points) > 50
    assert points[:, 0].min() >= 120 + 8
    assert points[:, 1].min() >= 8
    assert points[:, 1].max() < ROWS - 8
    assert finder.is_allowed(points).all()
    outside = np.array([[60.0, 100.0], [124.0, 100.0], [300.0, 3.0], [-5.0, 10.0], [1e5, 1e5]])
    assert not finder.is_allowed(outside).any()


def test_a_blank_image_has_no_corners() -> None:
    assert len(detector().find(np.full((ROWS, COLUMNS), 80, dtype=np.uint8), NONE)) == 0


def test_noise_has_few_corners() -> None:
    noise = np.clip(120.0 + 3.0 * np.random.default_rng(0).standard_normal((ROWS, COLUMNS)), 0, 255).astype(np.uint8)
    assert len(detector().find(noise, NONE)) < 15


def test_detectors_agree() -> None:
    first, second = detector(), detector()
    for _ in range(3):
        np.testing.assert_array_equal(first.find(IMAGE, NONE), second.find(IMAGE, NONE))


@pytest.mark.parametrize("count", [1, 2, 7, 1000])
@pytest.mark.parametrize("most", [0, 3, 510])
def test_the_median_by_counting_is_the_median(count: int, most: int) -> None:
    values = np.random.default_rng(count).integers(0, most + 1, (1, count)).astype(np.uint16)
    assert _median(values) == np.median(values)
