# SPDX-License-Identifier: BSD-3-Clause
"""Surfaces that are not plane: stones beside the way, and boxes that stand out from the walls. Nothing is solid."""

from collections.abc import Iterator, Sequence

import numpy as np

from coclo_vio.geometry import so3
from coclo_vio.simulation.visuals.config import SceneConfig
from coclo_vio.simulation.visuals.room import Face, RoomBounds, ground_at
from coclo_vio.values.arrays import Array

_CORRIDOR_M = 0.85  # stones lie within this distance of the edge of the walked area, where no leg comes
_BEYOND_M = 0.7  # or so far beyond it
_STONE_M = (0.02, 0.15)  # half of an edge
_SIDES = (  # rotations of a box's faces: z is the outward normal
    np.eye(3),
    np.diag([1.0, -1.0, -1.0]),
    so3.exp(np.array([0.5 * np.pi, 0.0, 0.0])),
    so3.exp(np.array([-0.5 * np.pi, 0.0, 0.0])),
    so3.exp(np.array([0.0, 0.5 * np.pi, 0.0])),
    so3.exp(np.array([0.0, -0.5 * np.pi, 0.0])),
)


def relief_faces(
    walked: RoomBounds, ground: Sequence[Face], room: Sequence[Face], config: SceneConfig, rng: np.random.Generator
) -> list[Face]:
    """The faces of all stones and boxes.

    Args:
        walked: the walked area.
        ground: faces of the terrain above the floor.
        room: faces of the room.
        config: how many.
        rng: decides where they are.
    """
    walls = [face for face in room if face.texture == "wall" and abs(face.rotation[2, 2]) < 0.5]
    faces = [face for _ in range(config.rubble) for face in _stone(walked, ground, rng)]
    for _ in range(config.wall_relief):
        wall = walls[int(rng.integers(len(walls)))]
        half = np.array([*rng.uniform(0.05, 0.4, 2), rng.uniform(0.03, 0.3)])
        place = np.append(rng.uniform(-1.0, 1.0, 2) * np.maximum(wall.half_extent - half[:2], 0.0), half[2])
        faces += box_faces(wall.center + wall.rotation @ place, half, wall.rotation, _texture(rng))
    return faces


def box_faces(center: Array, half: Array, rotation: Array, texture: str) -> Iterator[Face]:
    """The six faces of a box at any attitude.

    Args:
        center: of the box, world, m, (3,).
        half: half of its edges, own axes, m, (3,).
        rotation: its axes as columns, world, (3, 3).
        texture: name of a recipe.
    """
    for side in _SIDES:
        extent = np.abs(side.T @ half)
        turned = rotation @ side
        yield Face(center + extent[2] * turned[:, 2], extent[:2], turned, texture)


def _stone(walked: RoomBounds, ground: Sequence[Face], rng: np.random.Generator) -> Iterator[Face]:
    low, high = np.array([walked.xmin, walked.ymin]), np.array([walked.xmax, walked.ymax])
    place = 0.5 * (low + high)
    while (np.minimum(place - low, high - place) > _CORRIDOR_M).all():
        place = rng.uniform(low - _BEYOND_M, high + _BEYOND_M)
    half = np.exp(rng.uniform(np.log(_STONE_M[0]), np.log(_STONE_M[1]), 3))
    center = np.array([*place, ground_at(ground, *place)[0] + 0.6 * half[2]])
    yield from box_faces(center, half, so3.exp(rng.normal(0.0, 0.5, 3)), _texture(rng))


def _texture(rng: np.random.Generator) -> str:
    return "plain" if rng.uniform() < 0.3 else "clutter"
