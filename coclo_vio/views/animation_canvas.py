# SPDX-License-Identifier: BSD-3-Clause
"""Draws a short film of a run into an animated ``.webp`` file: for a page, a report or an issue, without a viewer.

On the left the robot from beside, which stays in the middle, with its feet, forces, trajectories, ellipsoids and
landmarks; on the right the last image with its tracks, the speed and the contacts of the feet, and the last event.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path

import cv2
import numpy as np

from coclo_vio.values.arrays import Array, ByteImage
from coclo_vio.values.errors import ConfigError
from coclo_vio.values.units import NS_PER_S
from coclo_vio.views.canvas import Colour, Shape
from coclo_vio.views.perspective import Perspective, Sheet

_SIZE, _SIDE = (480, 360), 320  # of the world, and the width of what is beside it
_PERIOD_NS = 100_000_000  # from frame to frame, at first
_MOST_FRAMES = 300  # of more every second one is dropped
_QUALITY = 70
_VIEWPOINT, _DISTANCE, _LEAST_REACH_M = np.array([0.35, -0.85, 0.4]), 4.6, 0.25
_PAPER, _INK, _PALE = (1.0, 1.0, 1.0), (0.25, 0.27, 0.3), (0.86, 0.87, 0.89)
_ROBOT, _EDGE, _EVENT = (0.72, 0.75, 0.79), (0.35, 0.38, 0.43), (0.75, 0.2, 0.1)
_STANCE, _BAR_AT, _BAR = (0.0, 0.45, 0.7), 130, 170  # colour, column and width of the bar of a contact
_GRID_M, _GRID_LINES = 0.25, 9
_EVENT_SHOWN_NS = 2_000_000_000
_LANDMARKS_SHOWN = 400


class AnimationCanvas:
    """A ``Canvas`` that keeps what is there, and takes a frame of it ten times a second of the recording."""

    def __init__(self, file: Path) -> None:
        """Take a file, ``.webp``, which is written by ``close``."""
        self._file = file
        self._shapes: Sequence[Shape] = ()
        self._T_world_body: Array = np.eye(4)
        self._T_body_link: Mapping[str, Array] = {}
        self._paths: dict[tuple[str, int], tuple[Array, Colour]] = {}
        self._ellipsoids: dict[str, tuple[Array, Array, Colour]] = {}
        self._spheres: tuple[Array, float, Sequence[Colour]] | None = None
        self._arrows: tuple[Array, Array, Colour] | None = None
        self._points: tuple[Array, Colour] | None = None
        self._image: ByteImage | None = None
        self._event: tuple[int, str] | None = None
        self._numbers: dict[str, Mapping[str, float]] = {}
        self._frames: list[bytes] = []
        self._period_ns, self._start_ns, self._due_ns = _PERIOD_NS, 0, 0
        self._now_ns: int | None = None  # of the robot
        self._reach_m, self._ground_m = _LEAST_REACH_M, 0.0

    def robot(self, stamp_ns: int, shapes: Sequence[Shape]) -> None:
        """As in ``Canvas``."""
        self._shapes = shapes

    def links(self, stamp_ns: int, T_world_body: Array, T_body_link: Mapping[str, Array]) -> None:
        """As in ``Canvas``; before, where a frame is due, it is taken of all that is there."""
        self._take_if_due()
        self._T_world_body, self._T_body_link = T_world_body, T_body_link or self._T_body_link
        if self._now_ns is None:
            self._start_ns = self._due_ns = stamp_ns
            places = [T[:3, 3] for T in self._T_body_link.values()]
            self._reach_m = max([_LEAST_REACH_M, *(float(np.linalg.norm(place)) for place in places)])
            self._ground_m = min([0.0, *(float(p[2]) for p in places)]) + float(T_world_body[2, 3])
        self._now_ns = stamp_ns

    def pose(self, stamp_ns: int, name: str, T_world_body: Array) -> None:
        """As in ``Canvas``: the ellipsoid shows it."""

    def path(self, stamp_ns: int, name: str, part: int, points: Array, colour: Colour) -> None:
        """As in ``Canvas``."""
        self._paths[name, part] = points, colour

    def ellipsoid(self, stamp_ns: int, name: str, pose: Array, half_axes_m: Array, colour: Colour) -> None:
        """As in ``Canvas``."""
        self._ellipsoids[name] = pose, half_axes_m, colour

    def spheres(self, stamp_ns: int, name: str, centres: Array, radius_m: float, colours: Sequence[Colour]) -> None:
        """As in ``Canvas``: the feet."""
        self._spheres = centres, radius_m, colours

    def arrows(self, stamp_ns: int, name: str, origins: Array, vectors: Array, colour: Colour) -> None:
        """As in ``Canvas``: the forces."""
        self._arrows = origins, vectors, colour

    def points(self, stamp_ns: int, name: str, points: Array, colour: Colour) -> None:
        """As in ``Canvas``: the landmarks."""
        self._points = points[:_LANDMARKS_SHOWN], colour

    def frames(self, stamp_ns: int, name: str, poses: Array) -> None:
        """As in ``Canvas``: keyframes are left out."""

    def image(self, stamp_ns: int, name: str, jpeg: bytes) -> None:
        """As in ``Canvas``."""
        image = _decoded(jpeg)
        height = round(_SIDE * image.shape[0] / image.shape[1])
        self._image = np.asarray(cv2.resize(image, (_SIDE, height), interpolation=cv2.INTER_AREA), dtype=np.uint8)

    def event(self, stamp_ns: int, kind: str, detail: str) -> None:
        """As in ``Canvas``."""
        self._event = stamp_ns, kind

    def numbers(self, stamp_ns: int, name: str, values: Mapping[str, float]) -> None:
        """As in ``Canvas``: velocity and contact of the first trajectory that has them."""
        self._numbers[name] = values

    def close(self) -> None:
        """Write the file.

        Raises:
            ConfigError: it cannot be written.
        """
        self._take_if_due()
        if not self._frames:
            return
        film = cv2.Animation()
        film.frames = [_decoded(each) for each in self._frames]
        film.durations = [round(self._period_ns / NS_PER_S * 1e3)] * len(self._frames)
        if not cv2.imwriteanimation(str(self._file), film, [cv2.IMWRITE_WEBP_QUALITY, _QUALITY]):
            raise ConfigError(f"the animation cannot be written to {self._file}; choose another file")

    def _take_if_due(self) -> None:
        now_ns = self._now_ns
        if now_ns is None or now_ns < self._due_ns:
            return
        if len(self._frames) == _MOST_FRAMES:
            self._frames, self._period_ns = self._frames[::2], 2 * self._period_ns
        self._due_ns = now_ns - (now_ns - self._start_ns) % self._period_ns + self._period_ns
        frame = np.concatenate((self._world(now_ns), self._beside()), axis=1)
        self._frames.append(cv2.imencode(".png", frame)[1].tobytes())

    def _world(self, stamp_ns: int) -> ByteImage:
        at = self._T_world_body[:3, 3]
        middle = at + np.array([0.0, 0.0, 0.35 * (self._ground_m - at[2])])
        view = Perspective(_SIZE, middle + _DISTANCE * self._reach_m * _VIEWPOINT, middle, _PAPER)
        self._draw_ground(view, at)
        if self._points is not None:
            for point in self._points[0]:
                view.disc(point, 0.0, self._points[1])
        for points, colour in self._paths.values():
            view.line(points, colour, 2)
        placed = [
            (shape, self._T_world_body @ self._T_body_link[shape.link])
            for shape in self._shapes
            if shape.link in self._T_body_link
        ]
        view.shapes(placed, _ROBOT, _EDGE)
        if self._spheres is not None:
            centres, radius_m, colours = self._spheres
            for centre, colour in zip(centres, colours, strict=True):
                view.disc(centre, radius_m, colour)
        if self._arrows is not None:
            origins, vectors, colour = self._arrows
            for origin, vector in zip(origins, vectors, strict=True):
                view.line(np.array([origin, origin + vector]), colour, 2)
        for pose, half_axes_m, colour in self._ellipsoids.values():
            view.ellipsoid(pose, half_axes_m, colour)
        self._draw_names(view, stamp_ns)
        return view.image

    def _draw_ground(self, view: Perspective, at: Array) -> None:
        """A grid below the robot, which stays where it is in the world."""
        x, y = np.round(at[:2] / _GRID_M) * _GRID_M
        reach = _GRID_LINES * _GRID_M
        for step in range(-_GRID_LINES, _GRID_LINES + 1):
            off = step * _GRID_M
            for ends in (
                [[x + off, y - reach, self._ground_m], [x + off, y + reach, self._ground_m]],
                [[x - reach, y + off, self._ground_m], [x + reach, y + off, self._ground_m]],
            ):
                view.line(np.array(ends), _PALE)

    def _draw_names(self, view: Perspective, stamp_ns: int) -> None:
        view.text(f"{(stamp_ns - self._start_ns) / NS_PER_S:.1f} s", (10, 20), _INK)
        colours = {name: colour for (name, _), (_, colour) in self._paths.items()}
        for row, (name, colour) in enumerate(colours.items()):
            view.text(name, (10, 40 + 18 * row), colour)
        if self._event is not None and 0 <= stamp_ns - self._event[0] < _EVENT_SHOWN_NS:
            view.text(self._event[1], (10, _SIZE[1] - 12), _EVENT)

    def _beside(self) -> ByteImage:
        """The last image, and below it the speed and a bar for the contact of each foot."""
        side = Sheet((_SIDE, _SIZE[1]), _PAPER)
        top = 0
        if self._image is not None:
            top = min(len(self._image), _SIZE[1] - 100)
            side.image[:top] = self._image[:top]
        speeds = [values for name, values in self._numbers.items() if name.startswith("velocity/")]
        if speeds:
            speed_mps = float(np.linalg.norm([*speeds[0].values()]))
            side.text(f"speed {speed_mps:.2f} m/s", (10, top + 24), _INK)
        contacts = [values for name, values in self._numbers.items() if name.startswith("contact/")]
        for row, (leg, share) in enumerate(contacts[0].items() if contacts else ()):
            level = top + 48 + 14 * row
            if level > _SIZE[1] - 4:
                break
            side.text(leg[:16], (10, level), _INK, 0.36)
            side.bar((_BAR_AT, level - 8), (_BAR, 8), _PALE)
            side.bar((_BAR_AT, level - 8), (round(_BAR * share), 8), _STANCE)
        return side.image


def _decoded(data: bytes) -> ByteImage:
    """An image from the bytes of its file.

    Raises:
        ValueError: it is none.
    """
    image = cv2.imdecode(np.frombuffer(data, dtype=np.uint8), cv2.IMREAD_COLOR)
    if image is None:
        raise ValueError("the bytes are no image")
    return np.asarray(image, dtype=np.uint8)
