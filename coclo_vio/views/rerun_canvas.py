# SPDX-License-Identifier: BSD-3-Clause
"""Draws into a ``.rrd`` file and to a gRPC server for Rerun, one call for both.

The only importer of ``rerun`` (extra ``view``), inside the functions. The timeline is ``time``, the stamps of the
recording. Entities: ``world/robot/<link>``, ``world/feet``, ``world/forces``, ``world/landmarks``,
``world/keyframes``, ``tracks``, ``events``, and of each trajectory ``world/<name>/pose``, ``world/<name>/path``,
``world/<name>/ellipsoid``; plots are below ``plots``.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from coclo_vio.geometry import so3
from coclo_vio.values.arrays import Array
from coclo_vio.values.errors import ConfigError
from coclo_vio.views.canvas import Colour, Shape, quat_xyzw_of

_TIMELINE, _ROBOT = "time", "world/robot"
_GREY: Colour = (0.6, 0.62, 0.66)
_CAMERA_M = (-1.0, -1.1, 0.7)
_LINE_M, _POINT_M, _AXIS_M, _LEAST_M = 0.006, 0.015, 0.1, 1e-4
_AXIS_COLOURS: tuple[Colour, ...] = ((0.8, 0.1, 0.1), (0.1, 0.6, 0.1), (0.1, 0.2, 0.8))


class RerunCanvas:
    """A ``Canvas`` of Rerun's archetypes."""

    def __init__(self, file: Path | None, port: int | None) -> None:
        """Open the file and start the server, which keeps what a viewer that connects later has missed.

        Args:
            file: ``.rrd`` file, overwritten; none if None.
            port: of the server; none if None.

        Raises:
            ConfigError: the file cannot be written, or the port is in use.
        """
        import rerun  # noqa: PLC0415 -- an extra

        self._rerun: Any = rerun
        self._stream = rerun.RecordingStream("coclo_vio")
        self._series: set[str] = set()
        sinks: list[Any] = []
        try:
            if file is not None:
                sinks.append(rerun.FileSink(str(file)))
            if port is not None:
                sinks.append(rerun.GrpcServerSink("127.0.0.1", port))
            self._stream.set_sinks(*sinks, default_blueprint=self._layout())
        except (OSError, RuntimeError, ValueError) as error:
            what = f"port {port}" if file is None else f"the file {file}"
            raise ConfigError(f"the view cannot use {what}: {error}; choose another one") from error
        self._log("world", rerun.ViewCoordinates.RIGHT_HAND_Z_UP, is_static=True)

    def robot(self, stamp_ns: int, shapes: Sequence[Shape]) -> None:
        """As in ``Canvas``."""
        rerun, counts = self._rerun, dict[str, int]()
        for shape in shapes:
            counts[shape.link] = number = counts.get(shape.link, -1) + 1
            where, at = f"{_ROBOT}/{_part(shape.link)}/shape_{number}", shape.T_link_shape[:3, 3]
            placed = {"centers": [at], "quaternions": [self._quaternion(shape.T_link_shape)]}
            looks = {"colors": [_bytes(_GREY)], "fill_mode": "Solid"}
            match shape.kind:
                case "box":
                    self._log(where, rerun.Boxes3D(sizes=[shape.size_m], **placed, **looks), is_static=True)
                case "sphere":
                    half_sizes = [0.5 * shape.size_m]
                    self._log(where, rerun.Ellipsoids3D(half_sizes=half_sizes, **placed, **looks), is_static=True)
                case "cylinder":
                    radius, length = 0.5 * float(shape.size_m[0]), float(shape.size_m[2])
                    cylinders = rerun.Cylinders3D(lengths=[length], radii=[radius], **placed, **looks)
                    self._log(where, cylinders, is_static=True)
                case "line":
                    ends = [np.array([np.zeros(3), shape.size_m])]
                    line = rerun.LineStrips3D(ends, radii=[_LINE_M], colors=[_bytes(_GREY)])
                    self._log(where, line, is_static=True)
                case "mesh" if shape.mesh is not None:
                    self._log(where, self._transform(shape.T_link_shape, scale=shape.size_m), is_static=True)
                    self._log(where, rerun.Asset3D(path=shape.mesh), is_static=True)

    def links(self, stamp_ns: int, T_world_body: Array, T_body_link: Mapping[str, Array]) -> None:
        """As in ``Canvas``."""
        self._at(stamp_ns)
        self._log(_ROBOT, self._transform(T_world_body))
        if not T_body_link:
            return
        poses = np.array(list(T_body_link.values()))
        turns = so3.to_quat_xyzw(poses[:, :3, :3])  # all at once
        for link, at, turn in zip(T_body_link, poses[:, :3, 3], turns, strict=True):
            transform = self._rerun.Transform3D(translation=at, quaternion=self._rerun.Quaternion(xyzw=turn))
            self._log(f"{_ROBOT}/{_part(link)}", transform)

    def pose(self, stamp_ns: int, name: str, T_world_body: Array) -> None:
        """As in ``Canvas``."""
        self._at(stamp_ns)
        self._log(f"world/{name}/pose", self._transform(T_world_body))

    def path(self, stamp_ns: int, name: str, part: int, points: Array, colour: Colour) -> None:
        """As in ``Canvas``."""
        self._at(stamp_ns)
        line = self._rerun.LineStrips3D([points], radii=[_LINE_M], colors=[_bytes(colour)])
        self._log(f"world/{name}/path/{part:04d}", line)

    def ellipsoid(self, stamp_ns: int, name: str, pose: Array, half_axes_m: Array, colour: Colour) -> None:
        """As in ``Canvas``."""
        self._at(stamp_ns)
        ellipsoid = self._rerun.Ellipsoids3D(
            half_sizes=[np.maximum(half_axes_m, _LEAST_M)],
            centers=[pose[:3, 3]],
            quaternions=[self._quaternion(pose)],
            colors=[_bytes(colour)],
        )
        self._log(f"world/{name}/ellipsoid", ellipsoid)

    def spheres(self, stamp_ns: int, name: str, centres: Array, radius_m: float, colours: Sequence[Colour]) -> None:
        """As in ``Canvas``."""
        self._at(stamp_ns)
        points = self._rerun.Points3D(centres, radii=[radius_m], colors=[_bytes(colour) for colour in colours])
        self._log(f"world/{name}", points)

    def arrows(self, stamp_ns: int, name: str, origins: Array, vectors: Array, colour: Colour) -> None:
        """As in ``Canvas``."""
        self._at(stamp_ns)
        arrows = self._rerun.Arrows3D(vectors=vectors, origins=origins, radii=[_LINE_M], colors=[_bytes(colour)])
        self._log(f"world/{name}", arrows)

    def points(self, stamp_ns: int, name: str, points: Array, colour: Colour) -> None:
        """As in ``Canvas``."""
        self._at(stamp_ns)
        self._log(f"world/{name}", self._rerun.Points3D(points, radii=[_POINT_M], colors=[_bytes(colour)]))

    def frames(self, stamp_ns: int, name: str, poses: Array) -> None:
        """As in ``Canvas``."""
        self._at(stamp_ns)
        count = len(poses)
        arrows = self._rerun.Arrows3D(
            vectors=_AXIS_M * np.swapaxes(poses[:, :3, :3], 1, 2).reshape(-1, 3),
            origins=np.repeat(poses[:, :3, 3], 3, axis=0),
            colors=[_bytes(colour) for colour in _AXIS_COLOURS] * count,
        )
        self._log(f"world/{name}", arrows)

    def image(self, stamp_ns: int, name: str, jpeg: bytes) -> None:
        """As in ``Canvas``."""
        self._at(stamp_ns)
        self._log(name, self._rerun.EncodedImage(contents=jpeg, media_type="image/jpeg"))

    def event(self, stamp_ns: int, kind: str, detail: str) -> None:
        """As in ``Canvas``."""
        self._at(stamp_ns)
        self._log("events", self._rerun.TextLog(f"{kind}: {detail}", level="WARN"))

    def numbers(self, stamp_ns: int, name: str, values: Mapping[str, float]) -> None:
        """As in ``Canvas``: a series of scalars under one entity, named by the keys."""
        where = f"plots/{name}"
        if where not in self._series:
            self._series.add(where)
            of = f"{name.rpartition('/')[2]} " if "/" in name else ""
            self._log(where, self._rerun.SeriesLines(names=[of + key for key in values]), is_static=True)
        self._at(stamp_ns)
        self._log(where, self._rerun.Scalars([float(value) for value in values.values()]))

    def close(self) -> None:
        """Write what is held back, finish the file and end the server."""
        self._stream.flush()
        self._stream.disconnect()

    def _layout(self) -> Any:
        """3D on the left, about the robot; images, plots and the log of events on the right."""
        layout = self._rerun.blueprint
        plots = [
            layout.TimeSeriesView(origin="plots", contents=f"plots/{name}/**", name=name)
            for name in ("velocity", "contact", "innovation", "window", "calibration")
        ]
        right = layout.Vertical(
            layout.Spatial2DView(origin="tracks"), layout.Tabs(*plots), layout.TextLogView(origin="events")
        )
        world, at_robot = (
            layout.Spatial3DView(origin="world"),
            {"look_target": (0.0, 0.0, 0.0), "tracking_entity": _ROBOT},
        )
        world.properties["EyeControls3D"] = layout.archetypes.EyeControls3D(position=_CAMERA_M, **at_robot)
        return layout.Blueprint(
            layout.Horizontal(world, right, column_shares=[3, 2]),
            layout.TimePanel(state="collapsed", timeline=_TIMELINE, play_state="Following"),
            collapse_panels=True,
        )

    def _at(self, stamp_ns: int) -> None:
        self._stream.set_time(_TIMELINE, timestamp=np.datetime64(stamp_ns, "ns"))

    def _log(self, where: str, what: Any, *, is_static: bool = False) -> None:
        self._stream.log(where, what, static=is_static)

    def _transform(self, T: Array, scale: Array | None = None) -> Any:
        return self._rerun.Transform3D(translation=T[:3, 3], quaternion=self._quaternion(T), scale=scale)

    def _quaternion(self, T: Array) -> Any:
        return self._rerun.Quaternion(xyzw=quat_xyzw_of(T))


def _part(name: str) -> str:
    """A name as a part of an entity's path."""
    return name.replace("/", "_")


def _bytes(colour: Colour) -> tuple[int, int, int]:
    red, green, blue = (round(255.0 * share) for share in colour)
    return red, green, blue
