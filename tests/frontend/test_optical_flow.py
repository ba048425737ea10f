# SPDX-License-Identifier: BSD-3-Clause
import numpy as np
from textured_room import textures

from coclo_vio.frontend.optical_flow import LucasKanade, equalised

TEXTURE = textures()[1]
FLOW = LucasKanade(window_px=15, iterations=10, precision_px=0.05, forward_backward_px=1.0)
POINTS = np.stack(np.meshgrid(np.arange(60.0, 260.0, 40.0), np.arange(60.0, 260.0, 40.0)), axis=-1).reshape(-1, 2)


def cut(column: int, row: int) -> np.ndarray:
    return np.rint(TEXTURE[row : row + 300, column : column + 300]).astype(np.uint8)


def test_points_are_found_where_the_image_moved() -> None:
    places, found = FLOW.track(cut(100, 100), cut(106, 97), POINTS, POINTS, levels=2)
    assert found.all()
    np.testing.assert_allclose(places, POINTS - [6.0, -3.0], atol=0.1)


def test_far_points_need_a_seed_or_more_levels() -> None:
    moved = POINTS - [40.0, 25.0]
    inside = (moved > 10.0).all(axis=1)
    _, near = FLOW.track(cut(100, 100), cut(140, 125), POINTS, POINTS, levels=1)
    places, seeded = FLOW.track(cut(100, 100), cut(140, 125), POINTS, moved + 2.0, levels=1)
    assert near[inside].mean() < 0.3
    assert seeded[inside].all()
    np.testing.assert_allclose(places[inside], moved[inside], atol=0.1)


def test_a_point_that_left_the_image_is_lost() -> None:
    _, found = FLOW.track(cut(100, 100), cut(180, 100), POINTS, POINTS - [80.0, 0.0], levels=1)
    assert not found[POINTS[:, 0] < 80.0].any()
    assert found[POINTS[:, 0] > 90.0].all()


def test_a_point_that_fails_the_forward_backward_check_is_lost() -> None:
    _, found = FLOW.track(cut(100, 100), cut(900, 900), POINTS, POINTS, levels=1)
    assert found.mean() < 0.2


def test_equalised_images_do_not_depend_on_exposure() -> None:
    dark = np.rint(0.3 * cut(106, 97) + 4.0).astype(np.uint8)
    _, plain = FLOW.track(cut(100, 100), dark, POINTS, POINTS, levels=2)
    places, found = FLOW.track(equalised(cut(100, 100)), equalised(dark), POINTS, POINTS, levels=2)
    assert plain.mean() < 0.5
    assert found.all()
    np.testing.assert_allclose(places, POINTS - [6.0, -3.0], atol=0.2)


def test_no_points_give_no_points() -> None:
    places, found = FLOW.track(cut(0, 0), cut(0, 0), np.zeros((0, 2)), np.zeros((0, 2)), levels=1)
    assert places.shape == (0, 2)
    assert found.shape == (0,)
