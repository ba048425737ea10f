# SPDX-License-Identifier: BSD-3-Clause
"""A view by its name, into a file, to a server, or both."""

import socket
from collections.abc import Callable, Mapping
from importlib import import_module
from pathlib import Path
from typing import NamedTuple

from coclo_vio.values.errors import ConfigError, listing
from coclo_vio.views.canvas import Canvas
from coclo_vio.views.drawn_scene import Scene
from coclo_vio.views.view import Setting, View


class _Kind(NamedTuple):
    """One kind of view: the library that it needs, its distribution, how its files end, and its usual port, if any."""

    module: str
    distribution: str
    suffix: str
    port: int | None
    make: Callable[[Path | None, int | None], Canvas]


def _foxglove(file: Path | None, port: int | None) -> Canvas:
    from coclo_vio.views.foxglove_canvas import FoxgloveCanvas  # noqa: PLC0415 -- loads an extra

    return FoxgloveCanvas(file, port)


def _rerun(file: Path | None, port: int | None) -> Canvas:
    from coclo_vio.views.rerun_canvas import RerunCanvas  # noqa: PLC0415 -- loads an extra

    return RerunCanvas(file, port)


def _animation(file: Path | None, port: int | None) -> Canvas:
    from coclo_vio.views.animation_canvas import AnimationCanvas  # noqa: PLC0415 -- loads OpenCV

    assert file is not None, "check_view"
    return AnimationCanvas(file)


_KINDS: Mapping[str, _Kind] = {
    "foxglove": _Kind("foxglove", "foxglove-sdk", ".mcap", 8765, _foxglove),
    "rerun": _Kind("rerun", "rerun-sdk", ".rrd", 9876, _rerun),
    "animation": _Kind("cv2", "opencv-python-headless", ".webp", None, _animation),
}
_HIGHEST_PORT = 65535


def file_suffix(kind: str) -> str:
    """How files of a view end.

    Raises:
        ConfigError: no such view.
    """
    return _kind(kind).suffix


def usual_port(kind: str) -> int | None:
    """Where the viewer of a view looks for a server; None where it has none.

    Raises:
        ConfigError: no such view.
    """
    return _kind(kind).port


def _kind(name: str) -> _Kind:
    if name not in _KINDS:
        raise ConfigError(f"there is no view {name!r}; the views are: {listing(_KINDS)}")
    return _KINDS[name]


def check_view(kind: str, file: Path | None, port: int | None) -> tuple[Path | None, int | None]:
    """File and port of a view, each checked; the usual port where neither is given.

    Raises:
        ConfigError: no such view, its library is not installed, the file has another ending or no folder, or the port
            is in use.
    """
    wanted = _kind(kind)
    try:
        import_module(wanted.module)
    except ImportError as error:
        raise ConfigError(
            f"the view {kind} needs {wanted.distribution}, which is not installed: pip install 'coclo-vio[view]'"
        ) from error
    if file is not None and file.suffix != wanted.suffix:
        raise ConfigError(f"a file for the view {kind} ends in {wanted.suffix}, not {file.name!r}; rename it")
    if file is not None and not file.parent.is_dir():
        raise ConfigError(f"there is no folder {file.parent} for the view's file; make it, or choose another one")
    if wanted.port is None and (file is None or port is not None):
        raise ConfigError(f"the view {kind} has no server: give it a file that ends in {wanted.suffix}, and no port")
    if file is None and port is None:
        port = wanted.port
    if port is not None:
        _check_port(port)
    return file, port


def open_view(kind: str, setting: Setting, *, file: Path | None = None, port: int | None = None) -> View:
    """A view that writes a file, serves on this machine, or both.

    Args:
        kind: ``foxglove``, ``rerun``, or ``animation``, which writes a file only.
        setting: robot, ground truth and images.
        file: ``.mcap`` of Foxglove, ``.rrd`` of Rerun, ``.webp`` of the animation; overwritten.
        port: of the server; without file and port the usual one of the viewer, 8765 or 9876.

    Raises:
        ConfigError: as ``check_view``, or the file cannot be written.
        RobotModelError: the robot's URDF cannot be read.
    """
    file, port = check_view(kind, file, port)
    canvas = _KINDS[kind].make(file, port)
    return Scene(canvas, setting)


def _check_port(port: int) -> None:
    if not 0 <= port <= _HIGHEST_PORT:
        raise ConfigError(f"port {port} is none: give one from 1024 to {_HIGHEST_PORT}")
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as trial:
        trial.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            trial.bind(("127.0.0.1", port))
        except OSError as error:
            raise ConfigError(f"port {port} cannot be used: {error.strerror}; choose another one") from error
