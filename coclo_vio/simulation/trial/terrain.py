# SPDX-License-Identifier: BSD-3-Clause
"""The ground of the trials and the planned path over it.

Solid boxes carry the feet, rectangles are rendered, a height profile is the planner's map.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from coclo_vio.simulation.visuals.scene import RoomBounds, Surface
from coclo_vio.values.arrays import Array

TerrainName = Literal["flat", "ramp", "stairs"]
TERRAINS: tuple[TerrainName, ...] = get_args(TerrainName)

RAMP_RISE_M = 0.98  # paper, section V-A: 3.34 m wide, 0.98 m high, 16.35 deg
RAMP_RUN_M = 3.34
STEPS = 5  # paper, section V-A: 5 steps of 0.6 m x 0.15 m
STEP_DEPTH_M = 0.6
STEP_HEIGHT_M = 0.15
SQUARE_SIDE_M = 1.5  # paper, section V-A: a square 6 m long
_SHUTTLE_M = 0.5  # at the last turn the robot walks forth and back
_FOOT_OF_SLOPE_M = 1.0  # from the start to where the terrain rises
_THICKNESS_M = 0.5
_WIDTH_M = 3.0
_PLATFORM_M = 3.0
_MARGIN_M = 1.5  # of the room around the walked area; walls stand beyond it


@dataclass(frozen=True, slots=True, eq=False)
class Box:
    """A solid box.

    Attributes:
        centre: m, world, (3,).
        half_size: half of its edges, m, own axes, (3,).
        rotation: ``R_world_box`` (3, 3).
    """

    centre: Array
    half_size: Array
    rotation: Array


@dataclass(frozen=True, slots=True)
class PathSegment:
    """A segment of the path: a straight line, or a turn on the spot.

    Attributes:
        advance_m: along the heading; negative is backwards.
        turn_rad: to the left.
    """

    advance_m: float = 0.0
    turn_rad: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class Terrain:
    """A trial's ground and the path over it; it rises along x, the robot starts at the origin heading along x.

    Attributes:
        name: of the trial.
        boxes: the solid ground.
        surfaces: its rendered faces besides the floor.
        bounds: the walked area, from which the room is built.
        height_profile: x (m) and z (m) of the ground's profile, (N, 2), x rising or equal at a riser.
        body_profile: the same for the body, which climbs stairs as a slope, (N, 2).
        risers_m: x of the vertical faces; footholds keep a distance from them.
        path: the segments of the planned path.
    """

    name: TerrainName
    boxes: tuple[Box, ...]
    surfaces: tuple[Surface, ...]
    bounds: RoomBounds
    height_profile: Array
    body_profile: Array
    risers_m: tuple[float, ...]
    path: tuple[PathSegment, ...]

    @property
    def path_length_m(self) -> float:
        """Length of the path as specified, along the slope where there is one."""
        level = sum(abs(segment.advance_m) for segment in self.path)
        steps = np.diff(self.body_profile, axis=0)
        return level + float(np.sum(np.hypot(steps[:, 0], steps[:, 1]) - steps[:, 0]))

    def height(self, x: float) -> float:
        """Ground at ``x``, m; at a riser that of the upper tread."""
        line = self.height_profile
        index = int(np.searchsorted(line[:, 0], x, side="right"))
        if index in (0, len(line)):
            return float(line[min(index, len(line) - 1), 1])
        (x0, z0), (x1, z1) = line[index - 1], line[index]
        return float(z0 + (z1 - z0) * (x - x0) / (x1 - x0))

    def max_height(self, x_from: float, x_to: float) -> float:
        """The highest ground between two values of x, m."""
        low, high = min(x_from, x_to), max(x_from, x_to)
        between = self.height_profile[(self.height_profile[:, 0] >= low) & (self.height_profile[:, 0] <= high), 1]
        return float(max(self.height(low), self.height(high), *between))


def make_terrain(name: TerrainName) -> Terrain:
    """The ground of one of the paper's trials (section V-A)."""
    return _MAKERS[name]()


def _flat() -> Terrain:
    side, turn, shuttle = PathSegment(SQUARE_SIDE_M), PathSegment(turn_rad=np.pi / 2.0), _SHUTTLE_M
    back_and_forth = (PathSegment(shuttle), PathSegment(-shuttle), PathSegment(shuttle), PathSegment(-shuttle))
    return Terrain(
        "flat",
        (_floor(),),
        (),
        RoomBounds(-_MARGIN_M, SQUARE_SIDE_M + _MARGIN_M, -_MARGIN_M, SQUARE_SIDE_M + _MARGIN_M, 2.8),
        np.array([[-8.0, 0.0], [8.0, 0.0]]),
        np.array([[-8.0, 0.0], [8.0, 0.0]]),
        (),
        (side, turn, side, turn, side, turn, *back_and_forth, side),
    )


def _ramp() -> Terrain:
    start, end, top = _FOOT_OF_SLOPE_M, _FOOT_OF_SLOPE_M + RAMP_RUN_M, RAMP_RISE_M
    slope = float(np.arctan2(RAMP_RISE_M, RAMP_RUN_M))
    rotation = _about_y(-slope)
    length = float(np.hypot(RAMP_RUN_M, RAMP_RISE_M))
    middle = np.array([0.5 * (start + end), 0.0, 0.5 * top])
    plate = Box(
        middle - rotation @ [0.0, 0.0, _THICKNESS_M / 2.0], np.array([length, _WIDTH_M, _THICKNESS_M]) / 2.0, rotation
    )
    profile = np.array([[-8.0, 0.0], [start, 0.0], [end, top], [end + _PLATFORM_M, top]])
    return Terrain(
        "ramp",
        (_floor(), plate, _block(end, end + _PLATFORM_M, top)),
        (
            Surface(middle, np.array([length, _WIDTH_M]) / 2.0, rotation, "ramp"),
            _level_surface(end, end + _PLATFORM_M, top, "floor", _WIDTH_M),
        ),
        RoomBounds(-_MARGIN_M, end + _PLATFORM_M, -_WIDTH_M / 2.0, _WIDTH_M / 2.0, top + 2.8),
        profile,
        profile,
        (),
        (PathSegment(start + RAMP_RUN_M + 0.52),),
    )


def _stairs() -> Terrain:
    boxes, surfaces, line, risers = [_floor()], [], [[-8.0, 0.0]], []
    for step in range(STEPS):
        x, z = _FOOT_OF_SLOPE_M + step * STEP_DEPTH_M, (step + 1) * STEP_HEIGHT_M
        depth = STEP_DEPTH_M if step < STEPS - 1 else _PLATFORM_M
        boxes.append(_block(x, x + depth, z))
        surfaces.append(_level_surface(x, x + depth, z, "tread", _WIDTH_M))
        face = np.array([x, 0.0, z - STEP_HEIGHT_M / 2.0])
        surfaces.append(Surface(face, np.array([STEP_HEIGHT_M, _WIDTH_M]) / 2.0, _about_y(-np.pi / 2.0), "riser"))
        line += [[x, z - STEP_HEIGHT_M], [x, z]]
        risers.append(x)
    end = _FOOT_OF_SLOPE_M + (STEPS - 1) * STEP_DEPTH_M + _PLATFORM_M
    top = STEPS * STEP_HEIGHT_M
    foot = _FOOT_OF_SLOPE_M - STEP_DEPTH_M / 2.0  # from here a straight line runs through the middles of the treads
    head = foot + STEPS * STEP_DEPTH_M
    return Terrain(
        "stairs",
        tuple(boxes),
        tuple(surfaces),
        RoomBounds(-_MARGIN_M, end, -_WIDTH_M / 2.0, _WIDTH_M / 2.0, top + 2.8),
        np.array([*line, [end, top]]),
        np.array([[-8.0, 0.0], [foot, 0.0], [head, top], [end, top]]),
        tuple(risers),
        (PathSegment(_FOOT_OF_SLOPE_M + STEPS * STEP_DEPTH_M + 0.9),),
    )


_MAKERS: Mapping[TerrainName, Callable[[], Terrain]] = {"flat": _flat, "ramp": _ramp, "stairs": _stairs}


def _floor() -> Box:
    return Box(np.array([0.0, 0.0, -_THICKNESS_M / 2.0]), np.array([10.0, 10.0, _THICKNESS_M / 2.0]), np.eye(3))


def _block(x_from: float, x_to: float, top: float) -> Box:
    """A block from the floor up to ``top``."""
    centre = np.array([(x_from + x_to) / 2.0, 0.0, top / 2.0])
    return Box(centre, np.array([x_to - x_from, _WIDTH_M, top]) / 2.0, np.eye(3))


def _level_surface(x_from: float, x_to: float, z: float, kind: Literal["floor", "tread"], width: float) -> Surface:
    centre = np.array([(x_from + x_to) / 2.0, 0.0, z])
    return Surface(centre, np.array([x_to - x_from, width]) / 2.0, np.eye(3), kind)


def _about_y(angle: float) -> Array:
    cos, sin = float(np.cos(angle)), float(np.sin(angle))
    return np.array([[cos, 0.0, sin], [0.0, 1.0, 0.0], [-sin, 0.0, cos]])
