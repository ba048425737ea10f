# SPDX-License-Identifier: BSD-3-Clause
"""Images of a wall are those of a pinhole camera."""

import numpy as np
import pytest

from coclo_vio.experiments.bench.rectified_pair import FOCAL_PX, LOOKS_LEFT, rectified_pair
from coclo_vio.simulation.body_motion import BodyStates
from coclo_vio.simulation.visuals.wall_images import frames_along_wall

PAIR = rectified_pair(LOOKS_LEFT, 0.06)


def test_images_of_the_wall_fit_the_pinhole_model() -> None:
    """Between two poses of a camera that faces the wall, its image moves by f t / depth."""
    pair = PAIR
    moved_m = 0.1
    at = np.array([[0.0, 0.0, 0.0], [moved_m, 0.0, 0.0]])
    still = np.zeros((2, 3))
    body = BodyStates(at, still, still, np.tile(np.eye(3), (2, 1, 1)), still, still)
    one, other = frames_along_wall(PAIR, np.array([0, 100_000_000]), body)
    depth_m = 2.5 - pair.T_body_left_camera[1, 3]
    rows = slice(150, 330)
    for image, moved, shift_m in ((one.left, other.left, moved_m), (one.left, one.right, pair.baseline_m)):
        shift_px = FOCAL_PX * shift_m / depth_m
        found = min(range(40), key=lambda px: difference(image[rows, 100:500], moved[rows, 100 - px : 500 - px]))
        assert found == pytest.approx(shift_px, abs=0.6)


def difference(one: np.ndarray, other: np.ndarray) -> float:
    return float(np.abs(one.astype(float) - other).mean())
