# SPDX-License-Identifier: BSD-3-Clause
"""What goes wrong with IMUs, clocks and cameras when a recording is made: each a change of a content."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from coclo_vio.datasets.corrections import axes_matrix
from coclo_vio.experiments.contradictions.content import Content
from coclo_vio.geometry import se3
from coclo_vio.values.arrays import Array
from coclo_vio.values.calibration import CameraCalibration, matrix4
from coclo_vio.values.measurements import StereoFrame
from coclo_vio.values.units import GRAVITY_MPS2, NS_PER_S

Change = Callable[[Content], Content]


def imu(
    kind: type,
    *,
    force: Callable[[Array], Array] = lambda force: force,
    rate: Callable[[Array], Array] = lambda rate: rate,
) -> Change:
    """Change the readings of an IMU; the functions take and return (3,), m/s^2 and rad/s."""

    def change(sample: Any) -> Any:
        return kind(sample.stamp_ns, rate(sample.angular_velocity), force(sample.specific_force))

    return lambda content: content.changed(kind, change)


def in_g(force: Array) -> Array:
    """Accelerations in g."""
    return force / GRAVITY_MPS2


def in_degrees(rate: Array) -> Array:
    """Rates in degrees a second."""
    return np.asarray(np.rad2deg(rate))


def without_gravity(kind: type) -> Change:
    """The mean force of the recording is taken off, as a filter on the IMU does that removes gravity."""

    def change(content: Content) -> Content:
        forces = [each.specific_force for each in content.measurements if type(each) is kind]  # type: ignore[union-attr]
        mean = np.mean(forces, axis=0)
        return imu(kind, force=lambda force: force - mean)(content)

    return change


def turned(kind: type, axes: str) -> Change:
    """The IMU has other axes, as of NED."""
    matrix = axes_matrix(axes)
    return imu(kind, force=lambda force: matrix @ force, rate=lambda rate: matrix @ rate)


def late(kind: type, seconds: float) -> Change:
    """The stamps of a sensor are late."""
    by_ns = round(seconds * NS_PER_S)

    def change(content: Content) -> Content:
        if kind is StereoFrame:
            return replace(content, frames=[replace(each, stamp_ns=each.stamp_ns + by_ns) for each in content.frames])
        return content.changed(kind, lambda sample: replace(sample, stamp_ns=sample.stamp_ns + by_ns))

    return change


def since_start(content: Content) -> Content:
    """The images are stamped by the uptime of their computer."""
    first_ns = content.frames[0].stamp_ns - 100 * NS_PER_S
    return replace(content, frames=[replace(each, stamp_ns=each.stamp_ns - first_ns) for each in content.frames])


def stamps_in_microseconds(content: Content) -> Content:
    """All stamps count microseconds in a column of nanoseconds."""
    samples = [replace(each, stamp_ns=each.stamp_ns // 1000) for each in content.measurements]
    return replace(content, measurements=samples, frames=(), stereo=None, truth=None)


def swapped_images(content: Content) -> Content:
    """The topic of the left image has the right one."""
    return replace(content, frames=[StereoFrame(each.stamp_ns, each.right, each.left) for each in content.frames])


def other_images(content: Content) -> Content:
    """The right image is of another camera, here of another time."""
    frames = content.frames
    return replace(
        content,
        frames=[
            StereoFrame(each.stamp_ns, each.left, np.ascontiguousarray(other.left[::-1, ::-1]))
            for each, other in zip(frames, reversed(frames), strict=True)
        ],
    )


def half_resolution(content: Content) -> Content:
    """The images are half as large as those that were calibrated."""
    return replace(
        content,
        frames=[
            StereoFrame(each.stamp_ns, *(np.ascontiguousarray(image[::2, ::2]) for image in (each.left, each.right)))
            for each in content.frames
        ],
    )


def baseline(factor: float) -> Change:
    """The baseline is another: 0, in millimetres, or of the wrong sign."""

    def change(content: Content) -> Content:
        stereo = content.stereo
        if stereo is None:
            return content
        T_left_right = se3.inverse(stereo.T_body_left_camera) @ stereo.T_body_right_camera
        moved = se3.transform(T_left_right[:3, :3], factor * T_left_right[:3, 3])
        right = matrix4(stereo.T_body_left_camera @ moved)
        return replace(content, stereo=stereo.model_copy(update={"body_right_camera": right}))

    return change


def other_lens(content: Content) -> Content:
    """The focal lengths are those of another unit: millimetres."""
    stereo = content.stereo
    if stereo is None:
        return content

    def in_mm(lens: CameraCalibration) -> CameraCalibration:
        return lens.model_copy(update={"focal_px": (0.01 * lens.focal_px[0], 0.01 * lens.focal_px[1])})

    return replace(content, stereo=stereo.model_copy(update={"left": in_mm(stereo.left), "right": in_mm(stereo.right)}))
