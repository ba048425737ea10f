# SPDX-License-Identifier: BSD-3-Clause
"""Errors of vision that last in the covariance of a path, against paths that have them."""

import numpy as np
import pytest

from coclo_vio.backend.window.lasting_errors import LastingErrors
from coclo_vio.geometry import so3
from coclo_vio.values.arrays import Array

SCALE, TURNED_RAD, HEADING = 0.005, 0.004, 0.002
FORWARDS = np.array([0.1, 0.0, 0.0])


def followed(errors: LastingErrors, R: Array, position: Array, velocity: Array) -> Array:
    """The covariance at the next frame."""
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R, position
    errors.follow(T)
    return errors.covariance(T, velocity)


def walked(errors: LastingErrors, turns: Array) -> tuple[Array, Array]:
    """The last covariance, and the last rotation, of a walk of 0.1 m a frame with headings ``turns``, rad."""
    position, R = np.array([1.0, 2.0, 3.0]), np.eye(3)
    covariance = followed(errors, R, position, np.zeros(3))
    np.testing.assert_array_equal(covariance, 0.0)
    for heading in turns:
        R = so3.exp(np.array([0.0, 0.0, heading]))
        position = position + R @ FORWARDS
        covariance = followed(errors, R, position, R @ FORWARDS)
    return covariance, R


def test_a_straight_way_is_wrong_by_constant_shares() -> None:
    covariance, _ = walked(LastingErrors(scale_sigma=SCALE, rotation_sigma_rad=TURNED_RAD), np.zeros(50))
    np.testing.assert_allclose(np.sqrt(np.diag(covariance)[3:6]), [5.0 * SCALE, 5.0 * TURNED_RAD, 5.0 * TURNED_RAD])
    np.testing.assert_allclose(np.sqrt(np.diag(covariance)[6:]), [0.1 * SCALE, 0.1 * TURNED_RAD, 0.1 * TURNED_RAD])
    np.testing.assert_array_equal(covariance[:3], 0.0)


def test_a_closed_loop_is_wrong_by_the_height_alone() -> None:
    turns = 2.0 * np.pi * np.arange(1, 61) / 60.0
    covariance, _ = walked(LastingErrors(scale_sigma=SCALE, rotation_sigma_rad=TURNED_RAD), turns)
    np.testing.assert_allclose(np.sqrt(np.diag(covariance)[3:6]), [0.0, 0.0, 6.0 * TURNED_RAD], atol=1e-9)


@pytest.mark.parametrize("seed", range(3))
def test_it_is_the_body_on_cameras_that_are_turned_with_their_imu(seed: int) -> None:
    """A level path of the cameras, and a body that is turned in it, seen from the body's first heading."""
    random = np.random.default_rng(seed)
    turns = np.cumsum(random.normal(scale=0.3, size=40))
    covariance = np.zeros((9, 9))
    errors = LastingErrors(rotation_sigma_rad=TURNED_RAD, imu_on_cameras=True)
    rotations = [so3.exp(np.array([0.0, 0.0, heading])) for heading in (0.0, *turns)]
    ways = np.cumsum([R @ FORWARDS for R in rotations], axis=0)
    for R, way in zip(rotations, ways, strict=True):
        covariance = followed(errors, R, way, R @ FORWARDS)
    R, way, found = rotations[-1], ways[-1] - ways[0], []
    for rotation in random.normal(scale=TURNED_RAD, size=(4000, 3)):
        to_heading = so3.exp(np.array([0.0, 0.0, -rotation[2]]))
        turned = to_heading @ R @ so3.exp(rotation)
        found.append(
            np.concatenate(
                (so3.log(R.T @ turned), R.T @ (to_heading @ way - way), to_heading @ R @ FORWARDS - R @ FORWARDS)
            )
        )
    np.testing.assert_allclose(np.cov(np.array(found).T), covariance, atol=0.1 * covariance.max())


@pytest.mark.parametrize(
    ("seed", "errors"),
    [
        *((seed, {"rotation_sigma_rad": TURNED_RAD}) for seed in range(3)),
        (3, {"direction_sigma_rad": TURNED_RAD}),
        (4, {"direction_sigma_rad": TURNED_RAD, "imu_on_cameras": True}),
    ],
)
def test_it_is_the_path_of_displacements_that_are_turned(seed: int, errors: dict[str, float]) -> None:
    """By cameras that are turned on the body, or by depths that depend on the place, in the mean over draws."""
    random = np.random.default_rng(seed)
    turns = np.cumsum(random.normal(scale=0.1, size=40))
    covariance, R_last = walked(LastingErrors(**errors), turns)
    ends = []
    for rotation in random.normal(scale=TURNED_RAD, size=(4000, 3)):
        turned = so3.exp(rotation)
        rotations = [so3.exp(np.array([0.0, 0.0, heading])) for heading in turns]
        ends.append(R_last.T @ sum(R @ (turned @ FORWARDS - FORWARDS) for R in rotations))
    np.testing.assert_allclose(np.cov(np.array(ends).T), covariance[3:6, 3:6], atol=0.1 * covariance[3:6, 3:6].max())


def test_a_heading_is_wrong_by_a_share_of_the_turn_and_the_path_with_it() -> None:
    """Two rounds whose headings are all wrong by the same share, by finite difference."""
    turns = np.linspace(0.0, 4.0 * np.pi, 800)
    covariance, R = walked(LastingErrors(heading_sigma=HEADING), turns)
    np.testing.assert_allclose(np.sqrt(np.diag(covariance)[:3]), [0.0, 0.0, 4.0 * np.pi * HEADING], atol=1e-12)

    def end(share: float) -> Array:
        headings = (1.0 + share) * turns
        return np.sum([so3.exp(np.array([0.0, 0.0, each])) @ FORWARDS for each in headings], axis=0)

    off = R.T @ (end(1e-6) - end(-1e-6)) / 2e-6 * HEADING
    np.testing.assert_allclose(np.sqrt(np.diag(covariance)[3:6]), np.abs(off), atol=1e-3 * np.abs(off).max())
