# SPDX-License-Identifier: BSD-3-Clause
"""Figures that prove a diagnosis: gravity, angular velocities by each sensor, standing feet, a rectified pair."""

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

import numpy as np

from coclo_vio.diagnosis.evidence import Evidence
from coclo_vio.diagnosis.feet import FeetRecord
from coclo_vio.diagnosis.rates import smoothed_rates
from coclo_vio.evaluation.figure_style import empty_figure, finish
from coclo_vio.frontend.frontend import StereoFrontend
from coclo_vio.values.arrays import Array, BoolArray
from coclo_vio.values.errors import CocloError
from coclo_vio.values.trajectory import Trajectory
from coclo_vio.values.units import GRAVITY_MPS2, NS_PER_S

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_SHOWN_S = 10.0
_WINDOW_S = 0.1
_LINES = {
    "body IMU": "#0072b2",
    "camera IMU": "#e69f00",
    "cameras": "#009e73",
    "ground truth": "#303030",
    "up by the legs": "#d55e00",
}
_THINNED = 2000  # points of a curve


def figures(evidence: Evidence) -> Iterator[tuple[str, str, "Figure"]]:
    """Name, caption and figure of everything that the recording allows.

    Raises:
        EvaluationError: matplotlib is missing.
    """
    drawn = (
        ("gravity", "Specific force in body axes: the mean at rest points up with 9.81 m/s^2.", gravity(evidence)),
        (
            "angular_velocity",
            f"Angular velocity by each sensor, means over {_WINDOW_S:g} s, where the body turns most. Curves that are "
            "shifted have a clock offset, of another size a unit, in another panel or mirrored other axes.",
            angular_velocity(evidence),
        ),
        (
            "standing_feet",
            "Distance of two feet while both stand, less its mean in that time: constant where kinematics, joint "
            "order, signs and contact are right.",
            standing_feet(evidence.feet),
        ),
        (
            "rectified_pair",
            "A rectified pair with its tracks: rows agree where the calibration is right.",
            pair(evidence),
        ),
    )
    for name, caption, figure in drawn:
        if figure is not None:
            yield name, caption, figure


def gravity(evidence: Evidence) -> "Figure | None":
    """The specific force of both IMUs in body axes, and up by the legs; None without an IMU."""
    records = {"body IMU": (evidence.imu, evidence.robot_imu)}
    records["camera IMU"] = evidence.camera_imu, evidence.calibrations.camera_imu
    known = {name: (record, how) for name, (record, how) in records.items() if record is not None and how is not None}
    if not known:
        return None
    figure = empty_figure(9.0, 6.0)
    axes = figure.subplots(3, 1, sharex=True)
    start_ns = min(int(record.stamps_ns[0]) for record, _ in known.values())
    for name, (record, how) in known.items():
        force = record.force @ how.T_body_imu[:3, :3].T
        every = max(1, len(force) // _THINNED)
        for axis, column in zip(axes, force.T, strict=True):
            times_s = (record.stamps_ns[::every] - start_ns) / NS_PER_S
            axis.plot(times_s, column[::every], color=_LINES[name], linewidth=0.7, label=name)
    up = None if evidence.feet is None else evidence.feet.up_body
    for index, axis in enumerate(axes):
        axis.set_ylabel(f"{'xyz'[index]}, m/s^2")
        if up is not None:
            axis.axhline(GRAVITY_MPS2 * up[index], color=_LINES["up by the legs"], label="up by the legs")
    return finish(figure, axes, "time, s")


def angular_velocity(evidence: Evidence) -> "Figure | None":
    """Angular velocities in body axes over the ten seconds with most of it; None without any."""
    sources = _attitudes(evidence)
    if not sources:
        return None
    reference = min(sources.values(), key=lambda attitudes: attitudes.duration_s)
    start_ns = _busiest_ns(reference)
    figure = empty_figure(9.0, 6.0)
    axes = figure.subplots(3, 1, sharex=True)
    for name, attitudes in sources.items():
        times_s, rates = smoothed_rates(attitudes, start_ns, _SHOWN_S, _WINDOW_S)
        for axis, column in zip(axes, rates.T, strict=True):
            axis.plot(times_s, column, color=_LINES[name], linewidth=1.1, label=name)
    for index, axis in enumerate(axes):
        axis.set_ylabel(f"{'xyz'[index]}, rad/s")
    return finish(figure, axes, f"time from {(start_ns - int(reference.stamps_ns[0])) / NS_PER_S:.1f} s on, s")


def _attitudes(evidence: Evidence) -> Mapping[str, Trajectory]:
    truth = evidence.truth
    found = {
        "body IMU": evidence.attitudes_by_imu,
        "camera IMU": evidence.attitudes_by_camera_imu,
        "cameras": evidence.attitudes_by_cameras,
        "ground truth": truth.trajectory if truth is not None and truth.has_stamps else None,
    }
    return {name: attitudes for name, attitudes in found.items() if attitudes is not None and len(attitudes) > 3}


def _busiest_ns(attitudes: Trajectory) -> int:
    """Beginning of the stretch with the largest angular velocities."""
    start_ns = int(attitudes.stamps_ns[0])
    starts = np.arange(0.0, max(attitudes.duration_s - _SHOWN_S, 0.0) + 1e-9, 0.5 * _SHOWN_S)
    sizes = []
    for start_s in starts:
        _, rates = smoothed_rates(attitudes, start_ns + round(start_s * NS_PER_S), _SHOWN_S, _WINDOW_S)
        sizes.append(float(np.nanmean(np.linalg.norm(rates, axis=1))) if np.isfinite(rates).any() else 0.0)
    return start_ns + round(float(starts[int(np.argmax(sizes))]) * NS_PER_S)


def standing_feet(feet: FeetRecord | None) -> "Figure | None":
    """Changes of the distances between standing feet over time, mm; None without two feet that stand."""
    if feet is None or feet.position_body.shape[1] < 2:
        return None
    times_s = (feet.stamps_ns - feet.stamps_ns[0]) / NS_PER_S
    figure = empty_figure(9.0, 3.2)
    axis = figure.subplots()
    stands = feet.is_stance & np.isfinite(feet.position_body[:, :, 0])
    drawn = False
    for one in range(stands.shape[1] - 1):
        for other in range(one + 1, stands.shape[1]):
            changes = _changes_mm(feet.position_body[:, one] - feet.position_body[:, other], stands[:, [one, other]])
            drawn = drawn or bool(np.isfinite(changes).any())
            axis.plot(times_s, changes, linewidth=0.6)
    if not drawn:
        return None
    axis.set_ylabel("change, mm")
    return finish(figure, [axis], "time, s")


def _changes_mm(between: Array, stands: BoolArray) -> Array:
    """Distance (N,) less its mean over each time in which both feet stand, NaN where one does not."""
    both: BoolArray = np.asarray(stands.all(axis=1))
    distance = np.where(both, np.linalg.norm(between, axis=1), np.nan)
    edges = np.flatnonzero(np.diff(both.astype(np.int8))) + 1
    for part in np.split(np.arange(len(distance)), edges):
        if both[part[0]]:
            distance[part] -= distance[part].mean()
    return np.asarray(1e3 * distance)


def pair(evidence: Evidence) -> "Figure | None":
    """The last of a few frames, rectified, with tracks; None where there is none or it cannot be rectified."""
    stereo = evidence.calibrations.stereo
    frames = evidence.frames(5) if stereo is not None else ()
    if stereo is None or not frames:
        return None
    try:
        frontend = StereoFrontend(stereo)
        for frame in frames:
            frontend.track(frame)
    except CocloError:
        return None
    picture = frontend.overlay()[:, :, ::-1]
    figure = empty_figure(9.0, 9.0 * picture.shape[0] / picture.shape[1])
    axis = figure.subplots()
    axis.imshow(picture)
    axis.set_axis_off()
    return figure
