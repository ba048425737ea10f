# SPDX-License-Identifier: BSD-3-Clause
"""Views of a recording or of a robot, for ``run``, ``compare`` and online use."""

from pathlib import Path

from coclo_vio.api.recording import Recording, open_recording
from coclo_vio.robot.description import RobotDescription
from coclo_vio.runs.recording_view import view_of_recording, view_of_robot
from coclo_vio.runs.replay import replay
from coclo_vio.views.view import View


def open_view(
    kind: str,
    of: Recording | RobotDescription | str | Path | None = None,
    *,
    file: str | Path | None = None,
    port: int | None = None,
) -> View:
    """A view: ``measurement(m)`` and ``take(output)`` show, ``close()`` finishes.

    Args:
        kind: ``foxglove``, ``rerun`` or ``animation``, which writes a file only.
        of: a recording or its path, whose robot and ground truth are shown; or, online, the robot; None: neither.
        file: what it writes, overwritten: ``.mcap`` of Foxglove, ``.rrd`` of Rerun, ``.webp`` of the
            animation.
        port: where it serves on this machine; without file and port the viewer's usual one, 8765 or 9876.

    Raises:
        ConfigError: no such view, its library is not installed, or file or port cannot be used.
        CocloError: the recording or the robot cannot be read.
    """
    written = None if file is None else Path(file)
    if of is None or isinstance(of, RobotDescription):
        return view_of_robot(kind, of, file=written, port=port)
    recording = of if isinstance(of, Recording) else open_recording(of)
    return view_of_recording(kind, recording.path, recording.config, file=written, port=port)


def view_run(folder: str | Path, kind: str, *, file: str | Path) -> Path:
    """Show a run folder afterwards: its estimates, events and keyframes, and the joints if the recording is there.

    Args:
        folder: that ``run`` or ``compare`` wrote.
        kind: ``foxglove``, ``rerun`` or ``animation``, which writes a file only.
        file: what is written.

    Returns:
        The path of the file.

    Raises:
        ConfigError: no such view, its library is not installed, or the file cannot be written.
        DatasetError: it is no run folder.
    """
    return replay(Path(folder), kind, Path(file))
