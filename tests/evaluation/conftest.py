# SPDX-License-Identifier: BSD-3-Clause
"""Walks whose pose is known at any time, and kinds of trajectories that belong to no mode of the package."""

from collections.abc import Callable, Iterator

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from coclo_vio.geometry import se3
from coclo_vio.values.arrays import Array
from coclo_vio.values.trajectory import Trajectory
from coclo_vio.values.trajectory_kind import (
    TrajectoryKind,
    register_trajectory_kind,
    registered_trajectory_kinds,
    unregister_trajectory_kind,
)

Walk = Callable[..., Trajectory]
KINDS = (
    TrajectoryKind(
        "legs", "Legs", "#0000ff", is_featured=True, paper_drift_percent={"flat": 1.0, "ramp": 6.0, "stairs": 7.0}
    ),
    TrajectoryKind("vision", "Vision", "#ff8000", is_featured=True, paper_drift_percent={"flat": 2.0, "ramp": 22.0}),
    TrajectoryKind(
        "fused_legs",
        "fused Legs",
        "#00a000",
        layer=6,
        standalone="legs",
        is_featured=True,
        paper_drift_percent={"flat": 1.5},
    ),
    TrajectoryKind("fused_vision", "fused Vision", "#c000c0", layer=5, standalone="vision", is_featured=True),
    TrajectoryKind("naive", line_style="--", layer=2),
)


@pytest.fixture(autouse=True)
def kinds() -> Iterator[tuple[TrajectoryKind, ...]]:
    """``KINDS`` are registered and no others: the evaluation depends on registered kinds, not on existing modes."""
    registered = dict(registered_trajectory_kinds())
    for name in registered:
        unregister_trajectory_kind(name)
    for kind in KINDS:
        register_trajectory_kind(kind)
    yield KINDS
    for name in dict(registered_trajectory_kinds()):
        unregister_trajectory_kind(name)
    for kind in registered.values():
        register_trajectory_kind(kind)


def _pose(seconds: Array, seed: int) -> Array:
    """A square of about 3 m, at rest for the first 2 s, with corners at seeded times and trot-like rocking."""
    rng = np.random.default_rng(seed)
    corners = 2.0 + np.cumsum(rng.uniform(3.5, 5.5, 4))
    fine = np.arange(-5.0, 60.0, 0.005)
    heading = sum(0.25 * np.pi * (1.0 + np.tanh(2.0 * (fine - corner))) for corner in corners)
    speed = 0.35 * (1.0 + np.tanh(3.0 * (fine - 2.5))) * (fine < 24.0)
    x = np.cumsum(speed * np.cos(heading)) * 0.005
    y = np.cumsum(speed * np.sin(heading)) * 0.005
    is_walking = (seconds > 2.5) & (seconds < 24.0)
    rocking = 0.03 * np.sin(2.0 * np.pi * 1.7 * seconds + rng.uniform(0.0, 6.0)) * is_walking
    nod = 0.02 * np.sin(2.0 * np.pi * 1.1 * seconds) * is_walking
    angles = np.stack((np.interp(seconds, fine, heading), nod, rocking), axis=1)
    position = np.stack((np.interp(seconds, fine, x), np.interp(seconds, fine, y), 0.3 + 0.1 * rocking), axis=1)
    return se3.transform(Rotation.from_euler("ZYX", angles).as_matrix(), position)


@pytest.fixture
def walk() -> Walk:
    """``walk(seconds, seed, clock_s=0)``: the trajectory at these times, stamped ``seconds - clock_s``."""

    def make(seconds: Array, seed: int = 0, clock_s: float = 0.0) -> Trajectory:
        stamps_ns = np.rint((seconds - clock_s) * 1e9).astype(np.int64)
        return Trajectory(stamps_ns, _pose(seconds, seed))

    return make


@pytest.fixture
def line() -> Walk:
    """``line(metres, seconds, scale=1)``: uniform motion along x at 100 Hz after no rest, facing along x."""

    def make(metres: float, seconds: float = 10.0, scale: float = 1.0) -> Trajectory:
        count = round(seconds * 100) + 1
        position = np.zeros((count, 3))
        position[:, 0] = np.linspace(0.0, metres * scale, count)
        stamps_ns = np.arange(count, dtype=np.int64) * 10_000_000
        return Trajectory(stamps_ns, se3.transform(np.tile(np.eye(3), (count, 1, 1)), position))

    return make
