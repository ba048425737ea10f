# SPDX-License-Identifier: BSD-3-Clause
"""A view of a recording while modes run on it."""

from collections.abc import Iterable, Iterator
from pathlib import Path

from coclo_vio.datasets.dataset import open_dataset
from coclo_vio.datasets.images import encoded
from coclo_vio.robot.description import RobotDescription
from coclo_vio.runs.run_config import RunConfig
from coclo_vio.values.arrays import ByteImage
from coclo_vio.values.measurements import Measurement
from coclo_vio.views.opening import check_view, open_view
from coclo_vio.views.view import Setting, View

VIEWED_FRAMES = 2
"""One picture in so many frames goes to a view."""


def view_of_recording(kind: str, path: Path, config: RunConfig, *, file: Path | None, port: int | None) -> View:
    """A view of a recording with its robot and ground truth.

    Args:
        kind: ``foxglove`` or ``rerun``.
        path: of the recording.
        config: resolved for it.
        file: what it writes; nothing if None.
        port: where it serves; the viewer's usual one if there is no file either.

    Raises:
        ConfigError: no such view, its library is not installed, or file or port cannot be used.
        DatasetError: the ground truth cannot be read.
        RobotModelError: the robot's URDF cannot be read.
    """
    check_view(kind, file, port)  # before the recording is read
    truth = open_dataset(path, config.robot, config.dataset).ground_truth()
    setting = Setting(
        config.robot,
        truth.trajectory if truth is not None and truth.has_stamps else None,
        _jpeg,
    )
    return open_view(kind, setting, file=file, port=port)


def view_of_robot(kind: str, robot: RobotDescription | None, *, file: Path | None, port: int | None) -> View:
    """A view without a recording, for online use.

    Raises:
        ConfigError: no such view, its library is not installed, or file or port cannot be used.
        RobotModelError: the robot's URDF cannot be read.
    """
    return open_view(kind, Setting(robot, None, _jpeg), file=file, port=port)


def seen(measurements: Iterable[Measurement], view: View) -> Iterator[Measurement]:
    """The measurements, each shown to a view first."""
    for measurement in measurements:
        view.measurement(measurement)
        yield measurement


def _jpeg(image: ByteImage) -> bytes:
    return encoded(image, "jpeg")
