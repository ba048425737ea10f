# SPDX-License-Identifier: BSD-3-Clause
"""Frames between rows without stamps, counted from the smoothness of the tracked motion."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from coclo_vio.evaluation.frame_counts import frame_numbers
from coclo_vio.geometry import se3
from coclo_vio.values.arrays import Array, IntArray
from coclo_vio.values.trajectory import Trajectory

FRAMES_HZ, FRAMES = 120.0, 2400
SHARES = {1: 0.35, 2: 0.35, 3: 0.2, 4: 0.07, 8: 0.03}


def trot(seed: int, rest_s: float = 0.0) -> Array:
    """Poses of a body that rests, and then walks in a circle, bounces and rocks at 4 Hz, with noise of a tracker."""
    rng = np.random.default_rng(seed)
    times = np.maximum(np.arange(FRAMES) / FRAMES_HZ - rest_s, 0.0)
    yaw, bounce = 0.4 * times, np.sin(2.0 * np.pi * 4.0 * times)
    position = np.stack((1.5 * np.sin(yaw), 1.5 - 1.5 * np.cos(yaw), 0.01 * bounce), axis=1)
    attitude = Rotation.from_euler("ZYX", np.stack((yaw, 0.03 * bounce, 0.02 * np.cos(9.0 * times)), axis=1))
    noisy = attitude * Rotation.from_rotvec(2e-4 * rng.normal(size=(FRAMES, 3)))
    return se3.transform(noisy.as_matrix(), position + 1e-4 * rng.normal(size=(FRAMES, 3)))


def logged(poses: Array, rows: IntArray) -> Trajectory:
    return Trajectory(np.arange(len(rows)) * 10_000_000, poses[rows])


def uneven(seed: int) -> IntArray:
    rng = np.random.default_rng(100 + seed)
    gaps = rng.choice(list(SHARES), p=list(SHARES.values()), size=FRAMES)
    rows = np.append(0, np.cumsum(gaps))
    return np.asarray(rows[rows < FRAMES])


@pytest.mark.parametrize("seed", range(3))
def test_frames_of_uneven_rows_are_counted(seed: int) -> None:
    rows = uneven(seed)
    frames = frame_numbers(logged(trot(seed), rows))
    assert frames is not None
    assert np.mean(np.diff(frames) == np.diff(rows)) > 0.97
    assert np.abs(frames - rows).max() < 0.01 * FRAMES


@pytest.mark.parametrize("every", [1, 3])
def test_nothing_is_found_in_even_rows(every: int) -> None:
    assert frame_numbers(logged(trot(1), np.arange(0, FRAMES, every))) is None


def test_rows_at_rest_are_taken_as_even() -> None:
    rows = uneven(4)
    frames = frame_numbers(logged(trot(4, rest_s=5.0), rows))
    assert frames is not None
    walks = rows > 5.2 * FRAMES_HZ
    assert np.mean(np.diff(frames)[walks[:-1]] == np.diff(rows)[walks[:-1]]) > 0.95
    at_rest = np.diff(frames)[rows[:-1] < 4.5 * FRAMES_HZ]
    assert at_rest.max() - at_rest.min() <= 1  # of a mean that is no whole number


@pytest.mark.parametrize("rows", [2, 60])
def test_too_few_rows_tell_nothing(rows: int) -> None:
    assert frame_numbers(logged(trot(1), uneven(1)[:rows])) is None


def test_a_body_at_rest_tells_nothing() -> None:
    assert frame_numbers(logged(trot(1, rest_s=1e3), uneven(1))) is None
