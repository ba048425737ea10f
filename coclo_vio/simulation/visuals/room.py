# SPDX-License-Identifier: BSD-3-Clause
"""The room around a trial as textured rectangles: floor, walls with posters, ceiling, boxes and pillars.

For rendering only: nothing here is solid. Everything follows from the seed.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from coclo_vio.geometry import so3
from coclo_vio.simulation.visuals.config import SceneConfig
from coclo_vio.values.arrays import Array, checked, frozen
from coclo_vio.values.errors import ConfigError

PLAIN_SHARE: Final = {"rich": 0.1, "normal": 0.3, "poor": 0.7}  # of the clutter's faces
_POSTERS_PER_M: Final = {"rich": 0.7, "normal": 0.4, "poor": 0.12}  # of a wall
_FLOOR_BELOW_M = 5e-4  # the floor lies a little below objects on it: equal depths would flicker
_POSTER_OFF_WALL_M = 0.01
_WALL_BELOW_FLOOR_M = 0.05  # so that no gap shows between them
_UPRIGHT = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])  # x along y, y up, normal along x


@dataclass(frozen=True, slots=True)
class RoomBounds:
    """The walked area: walls are beyond it, and no clutter is on it.

    Attributes:
        xmin: least x, world, m.
        xmax: greatest x, world, m.
        ymin: least y, world, m.
        ymax: greatest y, world, m.
        height: of the ceiling above z = 0, m.
    """

    xmin: float
    xmax: float
    ymin: float
    ymax: float
    height: float

    def __post_init__(self) -> None:
        if not (self.xmin <= self.xmax and self.ymin <= self.ymax and self.height > 0.0):
            raise ConfigError(f"{self} has a least bound above the greatest, or a ceiling that is not above the floor")

    def contains(self, x: float, y: float, margin: float) -> bool:
        """Whether a point is within ``margin`` (m) of the area, measured along the axes."""
        return self.xmin - margin < x < self.xmax + margin and self.ymin - margin < y < self.ymax + margin


@dataclass(frozen=True, slots=True, eq=False)
class Face:
    """A textured rectangle, visible from the side its normal points to.

    Attributes:
        center: its middle, world, m, (3,).
        half_extent: half its sides along its own x and y, m, (2,).
        rotation: its axes as columns, world, (3, 3); z is the outward normal.
        texture: name of a recipe in ``textures.RECIPES``.
    """

    center: Array
    half_extent: Array
    rotation: Array
    texture: str

    def __post_init__(self) -> None:
        frozen(self, "center", checked("Face.center", self.center, (3,)))
        frozen(self, "half_extent", checked("Face.half_extent", self.half_extent, (2,)))
        frozen(self, "rotation", checked("Face.rotation", self.rotation, (3, 3)))

    def corners(self) -> Array:
        """Its corners counter-clockwise about the normal, world, m, (4, 3)."""
        signs = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
        placed: Array = self.center + (signs * self.half_extent) @ self.rotation[:, :2].T
        return placed


def ground_at(faces: Sequence[Face], x: float, y: float) -> tuple[float, Array]:
    """Height (m) and upward normal (3,) of the highest face that looks upwards at a point; the floor beside all."""
    highest, upward = 0.0, np.array([0.0, 0.0, 1.0])
    for face in faces:
        normal = face.rotation[:, 2]
        if normal[2] > 0.2:
            z = face.center[2] - (normal[0] * (x - face.center[0]) + normal[1] * (y - face.center[1])) / normal[2]
            local = face.rotation.T @ (np.array([x, y, z]) - face.center)
            if z > highest and (np.abs(local[:2]) <= face.half_extent).all():
                highest, upward = float(z), normal
    return highest, upward


def room_faces(walked: RoomBounds, config: SceneConfig, rng: np.random.Generator) -> list[Face]:
    """All faces of a room around the walked area."""
    room = _room_around(walked, config, rng)
    center_x, center_y = 0.5 * (room.xmin + room.xmax), 0.5 * (room.ymin + room.ymax)
    half = np.array([0.5 * (room.xmax - room.xmin), 0.5 * (room.ymax - room.ymin)])
    down = np.diag([1.0, -1.0, -1.0])
    faces = [
        Face(np.array([center_x, center_y, -_FLOOR_BELOW_M]), half, np.eye(3), "floor"),
        Face(np.array([center_x, center_y, room.height]), half, down, "wall"),
    ]
    for normal_yaw, (x, y), half_width in (
        (0.0, (room.xmin, center_y), half[1]),
        (0.5 * np.pi, (center_x, room.ymin), half[0]),
        (np.pi, (room.xmax, center_y), half[1]),
        (-0.5 * np.pi, (center_x, room.ymax), half[0]),
    ):
        wall = Face(
            np.array([x, y, 0.5 * (room.height - _WALL_BELOW_FLOOR_M)]),
            np.array([half_width, 0.5 * (room.height + _WALL_BELOW_FLOOR_M)]),
            so3.about_z(normal_yaw) @ _UPRIGHT,
            "wall",
        )
        faces += [wall, *_posters(wall, config, rng)]
    return faces + list(_clutter(walked, room, config, rng))


def _room_around(walked: RoomBounds, config: SceneConfig, rng: np.random.Generator) -> RoomBounds:
    west, east, south, north = rng.uniform(*config.wall_distance_m, 4)
    return RoomBounds(
        walked.xmin - west,
        walked.xmax + east,
        walked.ymin - south,
        walked.ymax + north,
        walked.height,
    )


def _posters(wall: Face, config: SceneConfig, rng: np.random.Generator) -> Iterator[Face]:
    """Rectangles hung on a wall; they may overlap, so each is a little further from the wall."""
    width = 2.0 * wall.half_extent[0]
    for number in range(round(_POSTERS_PER_M[config.texture] * width)):
        half = np.minimum(rng.uniform(0.2, 0.7, 2), 0.4 * wall.half_extent)
        along = rng.uniform(-1.0, 1.0) * (wall.half_extent[0] - half[0])
        height = min(rng.uniform(0.4, 2.2), 2.0 * wall.half_extent[1] - half[1]) - wall.half_extent[1]
        off = _POSTER_OFF_WALL_M * (1 + number)
        yield Face(wall.center + wall.rotation @ np.array([along, height, off]), half, wall.rotation, "poster")


def _clutter(walked: RoomBounds, room: RoomBounds, config: SceneConfig, rng: np.random.Generator) -> Iterator[Face]:
    """Boxes and pillars between the walked area and the walls."""
    plain_share = PLAIN_SHARE[config.texture]
    for _ in range(config.clutter):
        is_pillar = rng.uniform() < 0.25
        half = np.append(rng.uniform(0.12, 0.25, 2), 0.5 * room.height) if is_pillar else rng.uniform(0.12, 0.45, 3)
        x, y = rng.uniform(room.xmin, room.xmax), rng.uniform(room.ymin, room.ymax)
        yaw = rng.uniform(-np.pi, np.pi)
        textures = np.where(rng.uniform(size=5) < plain_share, "plain", "clutter")
        if not walked.contains(x, y, config.clearance_m + float(np.hypot(half[0], half[1]))):
            yield from _box(np.array([x, y, half[2]]), half, yaw, textures.tolist())


def _box(center: Array, half: Array, yaw: float, textures: list[str]) -> Iterator[Face]:
    """The four sides and the top of an upright box."""
    turn = so3.about_z(yaw)
    for side, texture in enumerate(textures[:4]):
        rotation = turn @ so3.about_z(0.5 * np.pi * side) @ _UPRIGHT
        out, across = (half[0], half[1]) if side % 2 == 0 else (half[1], half[0])
        yield Face(center + out * rotation[:, 2], np.array([across, half[2]]), rotation, texture)
    yield Face(center + np.array([0.0, 0.0, half[2]]), half[:2], turn, textures[4])
