# SPDX-License-Identifier: BSD-3-Clause
"""A perspective of the world on a small image: what is drawn nearer covers what is farther away."""

from collections.abc import Sequence

import cv2
import numpy as np

from coclo_vio.geometry import se3
from coclo_vio.values.arrays import Array, ByteImage
from coclo_vio.views.canvas import Colour, Shape

_NEAREST_M = 0.05
_CORNERS = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
_ROUND = np.array([[0.5 * np.cos(a), 0.5 * np.sin(a)] for a in np.linspace(0.0, 2.0 * np.pi, 12, endpoint=False)])
_CYLINDER = np.array([[x, y, z] for z in (-0.5, 0.5) for x, y in _ROUND])
_SHIFT = 4  # binary digits below a pixel


class Sheet:
    """An image to draw on.

    Attributes:
        image: (rows, columns, 3), blue, green, red.
    """

    def __init__(self, size: tuple[int, int], colour: Colour) -> None:
        """Make an empty image of columns and rows."""
        columns, rows = size
        self.image: ByteImage = np.empty((rows, columns, 3), dtype=np.uint8)
        self.image[:] = _bgr(colour)

    def text(self, words: str, at: tuple[int, int], colour: Colour, size: float = 0.42) -> None:
        """Words that begin at a column and a row."""
        cv2.putText(self.image, words, at, cv2.FONT_HERSHEY_SIMPLEX, size, _bgr(colour), 1, cv2.LINE_AA)

    def bar(self, at: tuple[int, int], size: tuple[int, int], colour: Colour) -> None:
        """A filled rectangle from a column and a row, its columns and rows."""
        (column, row), (columns, rows) = at, size
        self.image[row : row + rows, column : column + columns] = _bgr(colour)


class Perspective(Sheet):
    """An image of the world, seen from a point towards another one, z up."""

    def __init__(
        self, size: tuple[int, int], viewpoint: Array, target: Array, colour: Colour, field: float = 0.9
    ) -> None:
        """Make an empty image.

        Args:
            size: columns and rows.
            viewpoint: where it is seen from, m, world, (3,).
            target: what is in the middle, m, world, (3,).
            colour: of the background.
            field: width of the image over its distance.
        """
        super().__init__(size, colour)
        columns, rows = size
        ahead = (target - viewpoint) / np.linalg.norm(target - viewpoint)
        right = np.cross(ahead, [0.0, 0.0, 1.0])
        right /= np.linalg.norm(right)
        self._R_camera_world = np.array([right, np.cross(ahead, right), ahead])
        self._viewpoint, self._focal_px = viewpoint, columns / field
        self._middle = np.array([0.5 * columns, 0.5 * rows])

    def project(self, points: Array) -> tuple[Array, Array]:
        """Columns and rows (N, 2), and depths (N,), m, of points (N, 3); those behind the viewpoint have a NaN."""
        x, y, depth = ((points - self._viewpoint) @ self._R_camera_world.T).T
        depth = np.where(depth > _NEAREST_M, depth, np.nan)
        return self._middle + self._focal_px * np.column_stack((x, y)) / depth[:, None], depth

    def line(self, points: Array, colour: Colour, width_px: int = 1) -> None:
        """A line through points (N, 3)."""
        pixels, _ = self.project(points)
        is_seen = np.isfinite(pixels[:, 0])
        for first, last in zip(
            pixels[:-1][is_seen[:-1] & is_seen[1:]], pixels[1:][is_seen[:-1] & is_seen[1:]], strict=True
        ):
            cv2.line(self.image, _fixed(first), _fixed(last), _bgr(colour), width_px, cv2.LINE_AA, _SHIFT)

    def disc(self, centre: Array, radius_m: float, colour: Colour) -> None:
        """A sphere, at least a pixel wide."""
        pixels, depth = self.project(centre[None])
        if np.isfinite(depth[0]):
            radius_px = max(1.0, self._focal_px * radius_m / float(depth[0]))
            cv2.circle(
                self.image,
                _fixed(pixels[0]),
                round(radius_px * 2**_SHIFT),
                _bgr(colour),
                cv2.FILLED,
                cv2.LINE_AA,
                _SHIFT,
            )

    def hull(self, points: Array, colour: Colour, edge: Colour) -> None:
        """The outline of a convex body by its corners (N, 3), filled."""
        pixels, depth = self.project(points)
        if not np.isfinite(depth).all():
            return
        outline = cv2.convexHull(np.round(pixels * 2**_SHIFT).astype(np.int32))
        cv2.fillConvexPoly(self.image, outline, _bgr(colour), cv2.LINE_AA, _SHIFT)
        cv2.polylines(self.image, [outline], isClosed=True, color=_bgr(edge), lineType=cv2.LINE_AA, shift=_SHIFT)

    def ellipsoid(self, pose: Array, half_axes_m: Array, colour: Colour) -> None:
        """Its three main sections, at a pose (4, 4)."""
        for i, j in ((0, 1), (0, 2), (1, 2)):
            ring = np.zeros((len(_ROUND) + 1, 3))
            ring[:, [i, j]] = 2.0 * np.vstack((_ROUND, _ROUND[:1])) * half_axes_m[[i, j]]
            self.line(se3.apply(pose, ring), colour)

    def shapes(self, placed: Sequence[tuple[Shape, Array]], colour: Colour, edge: Colour) -> None:
        """Parts of a robot with poses of their links in the world, (4, 4), the farthest first; meshes are left out."""
        bodies = []
        for shape, T_world_link in placed:
            T = T_world_link @ shape.T_link_shape
            match shape.kind:
                case "line":
                    bodies.append(("line", se3.apply(T, np.array([np.zeros(3), shape.size_m]))))
                case "box" | "sphere":
                    bodies.append((shape.kind, se3.apply(T, _CORNERS * shape.size_m)))
                case "cylinder":
                    bodies.append(("cylinder", se3.apply(T, _CYLINDER * shape.size_m)))
        bodies.sort(key=lambda body: -float(np.linalg.norm(body[1].mean(axis=0) - self._viewpoint)))
        for kind, points in bodies:
            match kind:
                case "line":
                    self.line(points, edge, 2)
                case "sphere":
                    self.disc(points.mean(axis=0), 0.5 * float(np.ptp(points[:, 2])), colour)
                case _:
                    self.hull(points, colour, edge)


def _fixed(pixel: Array) -> tuple[int, int]:
    column, row = np.clip(np.round(pixel * 2**_SHIFT), -(2**24), 2**24).astype(int).tolist()
    return column, row


def _bgr(colour: Colour) -> tuple[int, int, int]:
    red, green, blue = (round(255.0 * share) for share in colour)
    return blue, green, red
