# SPDX-License-Identifier: BSD-3-Clause
"""The ground of a trot: solid boxes, their rendered faces, and a height map that the robot's controller knows."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from scipy import ndimage

from coclo_vio.geometry import so3
from coclo_vio.simulation.trial.terrain import Box
from coclo_vio.simulation.trot.loop_path import LoopPath
from coclo_vio.simulation.visuals.room import RoomBounds
from coclo_vio.simulation.visuals.scene import Surface
from coclo_vio.values.arrays import Array, BoolArray, IntArray

GroundName = Literal["flat", "rough", "ramp", "stairs", "slippery"]
GROUNDS: tuple[GroundName, ...] = get_args(GroundName)

STEP_HEIGHT_M, STEP_DEPTH_M, STEPS = 0.09, 0.4, 4
RAMP_RISE_M, RAMP_RUN_M = 0.40, 2.0  # 11.3 deg
_PLATFORM_M = 1.2
_OBSTACLE_FROM_M = 0.9  # from the start to where ramp or stairs begin
_HALF_WIDTH_M = 0.9
_CORNER_M, _SHORT_M, _LONG_M = 1.2, 1.2, 4.0
_THICKNESS_M = 0.5
_MARGIN_M = 0.7  # of the walked area around the path; walls stand beyond it
_CEILING_M = 2.8
_CELL_M = 0.01
_STONES_PER_M, _STONE_STRIP_M, _STONE_CLEAR_M = 7.0, 0.5, 0.7
_FOOTHOLD_M, _LEVEL_M = 0.04, 0.025  # around a foothold the height differs by less than this
_CALF_M, _RISER_M = 0.12, 0.05  # a lower link leans back so far, where no riser may be: risers are along x only
_SEARCH_M = 0.14  # of a better foothold
_UPRIGHT = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])  # x along y, y up, normal along x


@dataclass(frozen=True, slots=True, eq=False)
class HeightMap:
    """Heights on a grid of 1 cm.

    Attributes:
        origin: x and y of the first cell, m, (2,).
        height: of each cell, m, (nx, ny).
        highest: within a few centimetres of each cell, m, (nx, ny).
        is_level: where a foot can stand, (nx, ny).
    """

    origin: Array
    height: Array
    highest: Array
    is_level: BoolArray

    @classmethod
    def of(cls, boxes: Sequence[Box], low: Array, high: Array) -> "HeightMap":
        """The map of upright boxes, turned about z or pitched, between two corners (2,)."""
        shape = np.ceil((high - low) / _CELL_M).astype(int) + 1
        x, y = (low[axis] + _CELL_M * np.arange(shape[axis]) for axis in (0, 1))
        height = np.zeros(tuple(shape))
        for box in boxes:
            reach = float(np.linalg.norm(box.half_size)) + _CELL_M
            rows, columns = (
                slice(*np.searchsorted(line, [centre - reach, centre + reach]))
                for line, centre in ((x, box.centre[0]), (y, box.centre[1]))
            )
            top = _top(box, x[rows], y[columns])
            height[rows, columns] = np.maximum(height[rows, columns], top)
        cells = 2 * round(_FOOTHOLD_M / _CELL_M) + 1
        highest, lowest = ndimage.maximum_filter(height, cells), ndimage.minimum_filter(height, cells)
        reach = round(_CALF_M / _CELL_M)
        behind = ndimage.maximum_filter1d(height, reach + 1, axis=0, origin=reach // 2)
        return cls(low, height, highest, (highest - lowest < _LEVEL_M) & (behind - height < _RISER_M))

    def heights(self, points: Array) -> Array:
        """Ground at points (N, 2), m, (N,)."""
        rows = self._cells(points)
        return np.asarray(self.height[rows[:, 0], rows[:, 1]])

    def highest_between(self, start: Array, goal: Array) -> float:
        """The highest ground near the line between two points (2,), m."""
        cells = self._cells(start + _ALONG * (goal - start))
        return float(self.highest[cells[:, 0], cells[:, 1]].max())

    def foothold(self, wanted: Array) -> Array:
        """The place nearest to a wanted one (2,) where a foot can stand; the wanted one where there is none near."""
        cell = self._cells(wanted[None])[0]
        if self.is_level[cell[0], cell[1]]:
            return wanted
        nearby = self._cells(wanted + _RINGS)
        usable = np.flatnonzero(self.is_level[nearby[:, 0], nearby[:, 1]])
        return wanted if len(usable) == 0 else np.asarray(wanted + _RINGS[usable[0]])

    def _cells(self, points: Array) -> IntArray:
        cells = np.rint((points - self.origin) / _CELL_M).astype(np.int64)
        return np.minimum(np.maximum(cells, 0), (self.height.shape[0] - 1, self.height.shape[1] - 1))


_ALONG = np.linspace(0.0, 1.0, 9)[:, None]


def _rings() -> Array:
    """Offsets within the range of the search, the nearest first, m, (N, 2)."""
    steps = np.arange(-_SEARCH_M, _SEARCH_M + _CELL_M / 2.0, _CELL_M)
    offsets = np.stack(np.meshgrid(steps, steps, indexing="ij"), axis=-1).reshape(-1, 2)
    return offsets[np.argsort(np.hypot(*offsets.T), kind="stable")]


_RINGS = _rings()


def _top(box: Box, x: Array, y: Array) -> Array:
    """Height of a box's upper face above cells, m, (nx, ny); below the ground where it is not above them."""
    normal = box.rotation[:, 2]
    face = box.centre + box.half_size[2] * normal
    east, north = np.meshgrid(x - face[0], y - face[1], indexing="ij")
    up = -(normal[0] * east + normal[1] * north) / normal[2]
    along = east * box.rotation[0, 0] + north * box.rotation[1, 0] + up * box.rotation[2, 0]
    across = east * box.rotation[0, 1] + north * box.rotation[1, 1] + up * box.rotation[2, 1]
    is_above = (np.abs(along) <= box.half_size[0]) & (np.abs(across) <= box.half_size[1])
    return np.asarray(np.where(is_above, face[2] + up, -1.0))


@dataclass(frozen=True, slots=True, eq=False)
class TrotGround:
    """The ground of a trot and the path over it; the robot starts at the origin heading along x.

    Attributes:
        name: of the ground.
        path: of the body.
        boxes: the solid ground.
        surfaces: its rendered faces besides the floor.
        bounds: the walked area, from which the room is built.
        risers_m: x of vertical faces across the whole ground; there are none.
        map: its heights, which the controller knows.
    """

    name: GroundName
    path: LoopPath
    boxes: tuple[Box, ...]
    surfaces: tuple[Surface, ...]
    bounds: RoomBounds
    map: HeightMap
    risers_m: tuple[float, ...] = ()

    @property
    def path_length_m(self) -> float:
        """Length of the path as seen from above."""
        return self.path.length_m


def make_ground(name: GroundName, distance_m: float, generator: np.random.Generator) -> TrotGround:
    """The ground of a trot of so many metres; stones are drawn."""
    obstacle_m = {"ramp": 2.0 * RAMP_RUN_M, "stairs": (2.0 * STEPS - 2.0) * STEP_DEPTH_M}.get(name, -1.0)
    long_m = _LONG_M if obstacle_m < 0.0 else _OBSTACLE_FROM_M + obstacle_m + _PLATFORM_M + 0.8
    path = LoopPath(long_m, _SHORT_M, _CORNER_M, distance_m)
    xmin, xmax, ymin, ymax = path.bounds_m
    bounds = RoomBounds(xmin - _MARGIN_M, xmax + _MARGIN_M, ymin - _MARGIN_M, ymax + _MARGIN_M, _CEILING_M)
    added = _MAKERS[name](path, generator) if name in _MAKERS else ()
    low, high = np.array([bounds.xmin, bounds.ymin]), np.array([bounds.xmax, bounds.ymax])
    surfaces = tuple(surface for box in added for surface in _faces(box, "ramp" if name == "ramp" else "tread"))
    return TrotGround(name, path, (_floor(), *added), surfaces, bounds, HeightMap.of(added, low, high))


def _floor() -> Box:
    return Box(np.array([3.0, 2.0, -_THICKNESS_M / 2.0]), np.array([15.0, 15.0, _THICKNESS_M / 2.0]), np.eye(3))


def _stones(path: LoopPath, generator: np.random.Generator) -> tuple[Box, ...]:
    """Flat stones of 1 to 4 cm along the path, not at its start."""
    boxes = []
    for _ in range(round(_STONES_PER_M * path.lap_m)):
        point = path.at(float(generator.uniform(_STONE_CLEAR_M, path.lap_m - _STONE_CLEAR_M)))
        left = np.array([-np.sin(point.heading_rad), np.cos(point.heading_rad)])
        centre = point.position + generator.uniform(-_STONE_STRIP_M, _STONE_STRIP_M) * left
        half = np.append(generator.uniform(0.06, 0.2, 2), generator.uniform(0.005, 0.02))
        boxes.append(Box(np.append(centre, half[2]), half, so3.about_z(generator.uniform(-np.pi, np.pi))))
    return tuple(boxes)


def _ramp(path: LoopPath, generator: np.random.Generator) -> tuple[Box, ...]:
    """Up, a platform, and down on the first side."""
    slope = float(np.arctan2(RAMP_RISE_M, RAMP_RUN_M))
    length = float(np.hypot(RAMP_RUN_M, RAMP_RISE_M))
    top_from = _OBSTACLE_FROM_M + RAMP_RUN_M
    half = np.array([length / 2.0, _HALF_WIDTH_M, _THICKNESS_M / 2.0])
    plates = []
    for start, pitch in ((_OBSTACLE_FROM_M, -slope), (top_from + _PLATFORM_M, slope)):
        rotation = so3.exp(np.array([0.0, pitch, 0.0]))
        middle = np.array([start + RAMP_RUN_M / 2.0, 0.0, RAMP_RISE_M / 2.0])
        plates.append(Box(middle - rotation @ [0.0, 0.0, _THICKNESS_M / 2.0], half, rotation))
    return (*plates, _block(top_from, top_from + _PLATFORM_M, RAMP_RISE_M))


def _stairs(path: LoopPath, generator: np.random.Generator) -> tuple[Box, ...]:
    """Steps up, a platform, and down on the first side; each box reaches under all that are above it."""
    end = _OBSTACLE_FROM_M + (2 * STEPS - 2) * STEP_DEPTH_M + _PLATFORM_M
    return tuple(
        _block(_OBSTACLE_FROM_M + step * STEP_DEPTH_M, end - step * STEP_DEPTH_M, (step + 1) * STEP_HEIGHT_M)
        for step in range(STEPS)
    )


_MAKERS: Mapping[GroundName, Callable[[LoopPath, np.random.Generator], tuple[Box, ...]]] = {
    "rough": _stones,
    "ramp": _ramp,
    "stairs": _stairs,
}


def _block(x_from: float, x_to: float, top: float) -> Box:
    half = np.array([(x_to - x_from) / 2.0, _HALF_WIDTH_M, top / 2.0])
    return Box(np.array([(x_from + x_to) / 2.0, 0.0, top / 2.0]), half, np.eye(3))


def _faces(box: Box, top: Literal["ramp", "tread"]) -> list[Surface]:
    """The upper face of a box and its four sides."""
    half, rotation = box.half_size, box.rotation
    faces = [Surface(box.centre + half[2] * rotation[:, 2], half[:2], rotation, top)]
    for side in range(4):
        turned = rotation @ so3.about_z(0.5 * np.pi * side) @ _UPRIGHT
        out, across = (half[0], half[1]) if side % 2 == 0 else (half[1], half[0])
        faces.append(Surface(box.centre + out * turned[:, 2], np.array([across, half[2]]), turned, "riser"))
    return faces
