# SPDX-License-Identifier: BSD-3-Clause
"""Draws into an MCAP file and to a websocket server for Foxglove, one call for both.

The only importer of ``foxglove`` (extra ``view``), inside the functions. Topics: ``/tf``, ``/robot``, ``/feet``,
``/forces``, ``/landmarks``, ``/keyframes``, ``/tracks``, ``/events``, of each trajectory ``/<name>/pose``,
``/<name>/path`` and ``/<name>/ellipsoid``; and to plot, as JSON objects, ``/velocity/<name>``, ``/contact/<name>``,
``/innovation/<source>``, ``/window``, ``/calibration``.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from coclo_vio.geometry import so3
from coclo_vio.values.arrays import Array
from coclo_vio.values.errors import ConfigError
from coclo_vio.values.units import NS_PER_S
from coclo_vio.views.canvas import Colour, Shape, quat_xyzw_of

_WORLD, _BODY = "world", "body"
_GREY: Colour = (0.6, 0.62, 0.66)
_LINE_M, _AXIS_M, _HEAD = 0.012, 0.1, 0.25
_AXIS_COLOURS: tuple[Colour, ...] = ((0.8, 0.1, 0.1), (0.1, 0.6, 0.1), (0.1, 0.2, 0.8))
_ELLIPSOID_ALPHA = 0.3
_MEDIA_TYPES = {".stl": "model/stl", ".obj": "model/obj", ".dae": "model/vnd.collada+xml", ".glb": "model/gltf-binary"}
_LEAST_M = 1e-4


class FoxgloveCanvas:
    """A ``Canvas`` of Foxglove's messages."""

    def __init__(self, file: Path | None, port: int | None) -> None:
        """Open the file and start the server, which listens on this machine only.

        Args:
            file: MCAP file, overwritten; none if None.
            port: of the server; none if None, a free one if 0.

        Raises:
            ConfigError: the file cannot be written, or the port is in use.
        """
        import foxglove  # noqa: PLC0415 -- an extra
        from foxglove import channels, messages  # noqa: PLC0415

        self._messages: Any = messages
        self._foxglove, self._kinds = foxglove, channels
        self._context = foxglove.Context()
        self._channels: dict[str, Any] = {}
        self._shapes: Sequence[Shape] = ()
        self._listener = _NewSubscriber()
        self._file, self._server = None, None
        try:
            if file is not None:
                self._file = foxglove.open_mcap(file, allow_overwrite=True, context=self._context)
            if port is not None:
                self._server = foxglove.start_server(
                    name="coclo-vio", port=port, context=self._context, server_listener=self._listener
                )
        except Exception as error:  # the library's own kinds are not public
            if self._file is not None:
                self._file.close()
            what = f"the file {file}" if self._file is None and file is not None else f"port {port}"
            raise ConfigError(f"the view cannot use {what}: {error}; choose another one") from error

    @property
    def port(self) -> int | None:
        """Of the server; None without one."""
        return None if self._server is None else int(self._server.port)

    def robot(self, stamp_ns: int, shapes: Sequence[Shape]) -> None:
        """As in ``Canvas``; sent again to a client that connects later."""
        self._shapes = shapes
        by_link: dict[str, list[Shape]] = {}
        for shape in shapes:
            by_link.setdefault(shape.link, []).append(shape)
        entities = [
            self._entity(stamp_ns, link, frame=_link_frame(link), is_locked=True, **self._parts(parts))
            for link, parts in by_link.items()
        ]
        self._scene(stamp_ns, "/robot", entities)

    def links(self, stamp_ns: int, T_world_body: Array, T_body_link: Mapping[str, Array]) -> None:
        """As in ``Canvas``: frames ``body`` in ``world``, and ``robot/<link>`` in ``body``."""
        if self._listener.take() and self._shapes:
            self.robot(stamp_ns, self._shapes)
        message, time = self._messages, self._time(stamp_ns)
        children = [(_WORLD, _BODY), *((_BODY, _link_frame(link)) for link in T_body_link)]
        poses = self._poses(np.array([T_world_body, *T_body_link.values()]))
        transforms = [
            message.FrameTransform(
                timestamp=time,
                parent_frame_id=parent,
                child_frame_id=child,
                translation=translation,
                rotation=rotation,
            )
            for (parent, child), (translation, rotation) in zip(children, poses, strict=True)
        ]
        self._log(stamp_ns, "/tf", "FrameTransforms", message.FrameTransforms(transforms=transforms))

    def pose(self, stamp_ns: int, name: str, T_world_body: Array) -> None:
        """As in ``Canvas``."""
        message = self._messages.PoseInFrame(
            timestamp=self._time(stamp_ns), frame_id=_WORLD, pose=self._pose(T_world_body)
        )
        self._log(stamp_ns, f"/{name}/pose", "PoseInFrame", message)

    def path(self, stamp_ns: int, name: str, part: int, points: Array, colour: Colour) -> None:
        """As in ``Canvas``."""
        line = self._line(points, colour)
        self._scene(stamp_ns, f"/{name}/path", [self._entity(stamp_ns, f"{name}_{part}", lines=[line])])

    def ellipsoid(self, stamp_ns: int, name: str, pose: Array, half_axes_m: Array, colour: Colour) -> None:
        """As in ``Canvas``."""
        size = np.maximum(2.0 * half_axes_m, _LEAST_M)
        sphere = self._messages.SpherePrimitive(
            pose=self._pose(pose), size=self._vector(size), color=self._colour(colour, _ELLIPSOID_ALPHA)
        )
        self._scene(stamp_ns, f"/{name}/ellipsoid", [self._entity(stamp_ns, name, spheres=[sphere])])

    def spheres(self, stamp_ns: int, name: str, centres: Array, radius_m: float, colours: Sequence[Colour]) -> None:
        """As in ``Canvas``."""
        size = self._vector(np.full(3, 2.0 * radius_m))
        spheres = [
            self._messages.SpherePrimitive(pose=self._unturned(centre), size=size, color=self._colour(colour))
            for centre, colour in zip(centres, colours, strict=True)
        ]
        self._scene(stamp_ns, f"/{name}", [self._entity(stamp_ns, name, spheres=spheres)])

    def arrows(self, stamp_ns: int, name: str, origins: Array, vectors: Array, colour: Colour) -> None:
        """As in ``Canvas``."""
        lengths = np.linalg.norm(vectors, axis=1)
        is_drawn = lengths > _LEAST_M
        origins, vectors, lengths = origins[is_drawn], vectors[is_drawn], lengths[is_drawn]
        poses = self._poses(_along(origins, vectors / lengths[:, None]))
        arrows = [
            self._messages.ArrowPrimitive(
                pose=self._messages.Pose(position=position, orientation=rotation),
                shaft_length=(1.0 - _HEAD) * length,
                shaft_diameter=_LINE_M,
                head_length=_HEAD * length,
                head_diameter=2.0 * _LINE_M,
                color=self._colour(colour),
            )
            for (position, rotation), length in zip(poses, lengths.tolist(), strict=True)
        ]
        self._scene(stamp_ns, f"/{name}", [self._entity(stamp_ns, name, arrows=arrows)])

    def points(self, stamp_ns: int, name: str, points: Array, colour: Colour) -> None:
        """As in ``Canvas``: a point cloud of 32-bit floats; its colour is the viewer's choice."""
        message = self._messages
        fields = [
            message.PackedElementField(name=axis, offset=4 * number, type=message.PackedElementFieldNumericType.Float32)
            for number, axis in enumerate("xyz")
        ]
        cloud = message.PointCloud(
            timestamp=self._time(stamp_ns),
            frame_id=_WORLD,
            pose=self._unturned(np.zeros(3)),
            point_stride=12,
            fields=fields,
            data=np.ascontiguousarray(points, dtype="<f4").tobytes(),
        )
        self._log(stamp_ns, f"/{name}", "PointCloud", cloud)

    def frames(self, stamp_ns: int, name: str, poses: Array) -> None:
        """As in ``Canvas``."""
        lines = [
            self._line(np.array([pose[:3, 3], pose[:3, 3] + _AXIS_M * pose[:3, axis]]), colour)
            for pose in poses
            for axis, colour in enumerate(_AXIS_COLOURS)
        ]
        self._scene(stamp_ns, f"/{name}", [self._entity(stamp_ns, name, lines=lines)])

    def image(self, stamp_ns: int, name: str, jpeg: bytes) -> None:
        """As in ``Canvas``."""
        message = self._messages.CompressedImage(
            timestamp=self._time(stamp_ns), frame_id=name, data=jpeg, format="jpeg"
        )
        self._log(stamp_ns, f"/{name}", "CompressedImage", message)

    def event(self, stamp_ns: int, kind: str, detail: str) -> None:
        """As in ``Canvas``."""
        message = self._messages.Log(
            timestamp=self._time(stamp_ns), level=self._messages.LogLevel.Warning, name=kind, message=detail
        )
        self._log(stamp_ns, "/events", "Log", message)

    def numbers(self, stamp_ns: int, name: str, values: Mapping[str, float]) -> None:
        """As in ``Canvas``: a JSON object with a schema."""
        topic = f"/{name}"
        if topic not in self._channels:
            schema = {"type": "object", "title": name, "properties": {key: {"type": "number"} for key in values}}
            self._channels[topic] = self._foxglove.Channel(topic, schema=schema, context=self._context)
        known = {key: float(value) for key, value in values.items() if np.isfinite(value)}
        self._channels[topic].log(known, log_time=stamp_ns)

    def close(self) -> None:
        """Finish the file and stop the server."""
        if self._file is not None:
            self._file.close()
        if self._server is not None:
            self._server.stop()

    def _log(self, stamp_ns: int, topic: str, kind: str, message: Any) -> None:
        if topic not in self._channels:
            self._channels[topic] = getattr(self._kinds, f"{kind}Channel")(topic, context=self._context)
        self._channels[topic].log(message, log_time=stamp_ns)

    def _scene(self, stamp_ns: int, topic: str, entities: Sequence[Any]) -> None:
        self._log(stamp_ns, topic, "SceneUpdate", self._messages.SceneUpdate(entities=list(entities)))

    def _entity(self, stamp_ns: int, name: str, *, frame: str = _WORLD, is_locked: bool = False, **parts: Any) -> Any:
        return self._messages.SceneEntity(
            timestamp=self._time(stamp_ns), frame_id=frame, id=name, frame_locked=is_locked, **parts
        )

    def _parts(self, shapes: Sequence[Shape]) -> dict[str, list[Any]]:
        """The primitives of one link, by their field of an entity."""
        message, parts = self._messages, dict[str, list[Any]]()
        for shape in shapes:
            placed = {"pose": self._pose(shape.T_link_shape), "color": self._colour(_GREY, 0.9)}
            size = self._vector(shape.size_m)
            match shape.kind:
                case "box":
                    parts.setdefault("cubes", []).append(message.CubePrimitive(size=size, **placed))
                case "sphere":
                    parts.setdefault("spheres", []).append(message.SpherePrimitive(size=size, **placed))
                case "cylinder":
                    cylinder = message.CylinderPrimitive(size=size, bottom_scale=1.0, top_scale=1.0, **placed)
                    parts.setdefault("cylinders", []).append(cylinder)
                case "line":
                    parts.setdefault("lines", []).append(self._line(np.array([np.zeros(3), shape.size_m]), _GREY))
                case "mesh" if shape.mesh is not None and shape.mesh.suffix.lower() in _MEDIA_TYPES:
                    kind, data = _MEDIA_TYPES[shape.mesh.suffix.lower()], shape.mesh.read_bytes()
                    model = message.ModelPrimitive(
                        scale=size, override_color=True, media_type=kind, data=data, **placed
                    )
                    parts.setdefault("models", []).append(model)
        return parts

    def _line(self, points: Array, colour: Colour) -> Any:
        message = self._messages
        return message.LinePrimitive(
            type=message.LinePrimitiveLineType.LineStrip,
            pose=self._unturned(np.zeros(3)),
            thickness=_LINE_M,
            points=[message.Point3(x=x, y=y, z=z) for x, y, z in points.tolist()],
            color=self._colour(colour),
        )

    def _pose(self, T: Array) -> Any:
        x, y, z, w = quat_xyzw_of(T)
        turn = self._messages.Quaternion(x=x, y=y, z=z, w=w)
        return self._messages.Pose(position=self._vector(T[:3, 3]), orientation=turn)

    def _poses(self, T: Array) -> list[tuple[Any, Any]]:
        """Positions and quaternions of poses (N, 4, 4), converted all at once."""
        quaternion = self._messages.Quaternion
        turns = so3.to_quat_xyzw(T[:, :3, :3]).tolist() if len(T) else []
        return [
            (self._vector(at), quaternion(x=x, y=y, z=z, w=w))
            for at, (x, y, z, w) in zip(T[:, :3, 3], turns, strict=True)
        ]

    def _unturned(self, position: Array) -> Any:
        turn = self._messages.Quaternion(x=0.0, y=0.0, z=0.0, w=1.0)
        return self._messages.Pose(position=self._vector(position), orientation=turn)

    def _vector(self, values: Array) -> Any:
        x, y, z = (float(value) for value in values)
        return self._messages.Vector3(x=x, y=y, z=z)

    def _colour(self, colour: Colour, alpha: float = 1.0) -> Any:
        red, green, blue = colour
        return self._messages.Color(r=red, g=green, b=blue, a=alpha)

    def _time(self, stamp_ns: int) -> Any:
        return self._messages.Timestamp(*divmod(stamp_ns, NS_PER_S))


class _NewSubscriber:
    """Notes that a client has subscribed, so that it gets what is sent once."""

    def __init__(self) -> None:
        self._is_new = False

    def take(self) -> bool:
        """Whether one has since the last call."""
        is_new, self._is_new = self._is_new, False
        return is_new

    def on_subscribe(self, client: Any, channel: Any) -> None:
        """Called by the server, in its own thread."""
        if channel.topic == "/robot":
            self._is_new = True

    def __getattr__(self, name: str) -> Any:
        if name.startswith("on_"):
            return lambda *_: None
        raise AttributeError(name)


def _link_frame(link: str) -> str:
    return f"robot/{link}"


def _along(origins: Array, directions: Array) -> Array:
    """Poses (N, 4, 4) at these origins whose x axes have these directions, unit vectors (N, 3).

    The other axes by Duff et al., "Building an Orthonormal Basis, Revisited", 2017.
    """
    x, y, z = directions.T
    sign = np.copysign(1.0, z)
    a = -1.0 / (sign + z)
    b = x * y * a
    T = np.tile(np.eye(4), (len(origins), 1, 1))
    T[:, :3, 3], T[:, :3, 0] = origins, directions
    T[:, :3, 1] = np.column_stack((1.0 + sign * x * x * a, sign * b, -sign * x))
    T[:, :3, 2] = np.column_stack((b, sign + y * y * a, -y))
    return T
