# SPDX-License-Identifier: BSD-3-Clause
"""What a scene is drawn with: the few things that Foxglove and Rerun both can.

A canvas knows no estimator. Positions are in m, in the frame ``world``; colours are red, green, blue in 0..1.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import sqrt
from pathlib import Path
from typing import Literal, Protocol

from coclo_vio.values.arrays import Array

Colour = tuple[float, float, float]


@dataclass(frozen=True, slots=True, eq=False)
class Shape:
    """A part of a link.

    Attributes:
        link: whose part it is.
        kind: ``box``, ``sphere``, ``cylinder`` (along z), ``mesh`` or ``line`` (from the origin of the link).
        T_link_shape: (4, 4).
        size_m: edges of a box; diameters of a sphere; two diameters and the length of a cylinder; the factors on a
            mesh; where a line ends, (3,).
        mesh: its file; None of the others.
    """

    link: str
    kind: Literal["box", "sphere", "cylinder", "mesh", "line"]
    T_link_shape: Array
    size_m: Array
    mesh: Path | None = None


class Canvas(Protocol):
    """Draws things, each at its own stamp in nanoseconds and under a name."""

    def robot(self, stamp_ns: int, shapes: Sequence[Shape]) -> None:
        """The parts of the robot, once; they move with ``links``."""

    def links(self, stamp_ns: int, T_world_body: Array, T_body_link: Mapping[str, Array]) -> None:
        """Where the body is, (4, 4), and where its links are, (4, 4) by name."""

    def pose(self, stamp_ns: int, name: str, T_world_body: Array) -> None:
        """One pose of a trajectory, (4, 4)."""

    def path(self, stamp_ns: int, name: str, part: int, points: Array, colour: Colour) -> None:
        """A part of a trajectory, (N, 3); a later call with the same number replaces it."""

    def ellipsoid(self, stamp_ns: int, name: str, pose: Array, half_axes_m: Array, colour: Colour) -> None:
        """An ellipsoid at a pose, (4, 4), that replaces the last one of the name; half axes (3,)."""

    def spheres(self, stamp_ns: int, name: str, centres: Array, radius_m: float, colours: Sequence[Colour]) -> None:
        """Spheres, (N, 3), that replace the last ones of the name."""

    def arrows(self, stamp_ns: int, name: str, origins: Array, vectors: Array, colour: Colour) -> None:
        """Arrows, (N, 3) each, that replace the last ones of the name."""

    def points(self, stamp_ns: int, name: str, points: Array, colour: Colour) -> None:
        """A cloud of points, (N, 3), that replaces the last one of the name."""

    def frames(self, stamp_ns: int, name: str, poses: Array) -> None:
        """Axes at poses, (N, 4, 4), that replace the last ones of the name."""

    def image(self, stamp_ns: int, name: str, jpeg: bytes) -> None:
        """An image, as the bytes of a JPEG file."""

    def event(self, stamp_ns: int, kind: str, detail: str) -> None:
        """A line of the log."""

    def numbers(self, stamp_ns: int, name: str, values: Mapping[str, float]) -> None:
        """Numbers to plot over time; the keys of one name are always the same."""

    def close(self) -> None:
        """Finish the file and end the server."""


def quat_xyzw_of(T: Array) -> tuple[float, float, float, float]:
    """The quaternion of a pose (4, 4) or a rotation (3, 3): of one at a time fifty times as fast as ``so3`` of arrays.

    By the largest of its four components (Shepperd, "Quaternion from rotation matrix", 1978); its sign is any.
    """
    (a, b, c), (d, e, f), (g, h, i) = T[:3, :3].tolist()
    if a + e + i > 0.0:
        w = 0.5 * sqrt(1.0 + a + e + i)
        return (h - f) / (4.0 * w), (c - g) / (4.0 * w), (d - b) / (4.0 * w), w
    if a >= e and a >= i:
        x = 0.5 * sqrt(1.0 + a - e - i)
        return x, (b + d) / (4.0 * x), (c + g) / (4.0 * x), (h - f) / (4.0 * x)
    if e >= i:
        y = 0.5 * sqrt(1.0 + e - a - i)
        return (b + d) / (4.0 * y), y, (f + h) / (4.0 * y), (c - g) / (4.0 * y)
    z = 0.5 * sqrt(1.0 + i - a - e)
    return (c + g) / (4.0 * z), (f + h) / (4.0 * z), z, (d - b) / (4.0 * z)
