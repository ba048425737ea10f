# SPDX-License-Identifier: BSD-3-Clause
"""How costs grow: with legs, joint rate, tracks, keyframes in the window, and with the length of the input."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from time import process_time

from coclo_vio.experiments.bench.bench_record import Endurance, Sweep
from coclo_vio.experiments.bench.calibration_loop import calibration_s
from coclo_vio.experiments.bench.costs import WalkKind, front_end_ms, keyframe_ms, leg_sample_ms, window_of_tracks
from coclo_vio.experiments.bench.legged_robots import robot_with_legs, standing_rad
from coclo_vio.experiments.bench.point_world import tracked_walk
from coclo_vio.experiments.resident_memory import resident_mb
from coclo_vio.filter.odometry import LegOdometryFilter
from coclo_vio.robot.description import load_robot
from coclo_vio.robot.model import RobotModel
from coclo_vio.values.measurements import JointSample, Measurement, StereoTracks
from coclo_vio.values.units import MS_PER_S, NS_PER_S

_LEGS = (2, 4, 6, 8, 10, 12)
_RATES_HZ = (50.0, 100.0, 200.0, 500.0, 1000.0)
_TRACKS = (50, 100, 200, 400)
_KEYFRAMES = (5, 10, 20, 30)
_MARKS_MIN = (1.0, 2.0, 5.0, 10.0, 20.0, 30.0, 45.0, 60.0)


def _swept(what: str, size: str, sizes: Sequence[float], measure: Callable[[int], float]) -> Sweep:
    """Measure at every index of the sizes, each with the calibration loop before and after."""
    ms, units = [], []
    for index in range(len(sizes)):
        unit_ms = 0.5 * MS_PER_S * calibration_s()
        ms.append(measure(index))
        unit_ms += 0.5 * MS_PER_S * calibration_s()
        units.append(ms[-1] / unit_ms)
    return Sweep(what=what, size=size, sizes=tuple(sizes), ms=tuple(ms), units=tuple(units))


def by_legs() -> Sweep:
    """Leg odometry of robots with 2 to 12 legs."""

    def measure(index: int) -> float:
        legs = _LEGS[index]
        with TemporaryDirectory() as folder:
            robot = robot_with_legs(legs, Path(folder))
            return leg_sample_ms(robot, WalkKind(100.0, standing_rad=standing_rad(legs)))

    return _swept("leg odometry, ms a joint sample", "legs", _LEGS, measure)


def by_joint_rate() -> Sweep:
    """Leg odometry of four legs at 50 to 1,000 Hz."""
    robot = load_robot("go1")

    def measure(index: int) -> float:
        return _RATES_HZ[index] * leg_sample_ms(robot, WalkKind(_RATES_HZ[index]))

    return _swept("four legs, ms a second of input", "joint rate, Hz", _RATES_HZ, measure)


def front_end_by_tracks() -> Sweep:
    """The front end with 50 to 400 points to track."""
    return _swept("front end, ms a frame", "tracks", _TRACKS, lambda index: front_end_ms(_TRACKS[index])[0])


def window_by_tracks() -> Sweep:
    """The window with 50 to 400 tracks a frame."""
    return _swept("window of 10, ms a keyframe", "tracks", _TRACKS, lambda index: keyframe_ms(_TRACKS[index]))


def window_by_keyframes() -> Sweep:
    """A window of 5 to 30 keyframes."""
    what = "window of 150 tracks, ms a keyframe"
    return _swept(what, "keyframes", _KEYFRAMES, lambda index: keyframe_ms(keyframes=_KEYFRAMES[index]))


SWEEPS: Mapping[str, Callable[[], Sweep]] = {
    "legs": by_legs,
    "joint_rate": by_joint_rate,
    "front_end_tracks": front_end_by_tracks,
    "window_tracks": window_by_tracks,
    "window_keyframes": window_by_keyframes,
}


def legs_endurance(minutes: float) -> Endurance:
    """Six legs at 100 Hz: a short noisy walk over and over, a pause of a second between two.

    Args:
        minutes: of input.
    """
    robot = RobotModel(load_robot("daisy"))
    walk = WalkKind(100.0, walk_s=20.0).trial(robot).measurements
    odometry = LegOdometryFilter(robot)
    return endured("six legs, ms a joint sample", _repeated(walk), odometry.push, JointSample, minutes)


def window_endurance(minutes: float) -> Endurance:
    """Tracks at 10 Hz with an IMU through ``vins``: circles among points.

    Args:
        minutes: of input.
    """
    odometry = window_of_tracks()
    frames = round(minutes * 60.0 * 10.0) + 10
    walk = tracked_walk(100, frames)
    return endured("window of 100 tracks, ms a frame", walk, odometry.push, StereoTracks, minutes)


ENDURANCE: Mapping[str, Callable[[float], Endurance]] = {"legs": legs_endurance, "window": window_endurance}


def _repeated(walk: tuple[Measurement, ...]) -> Iterator[Measurement]:
    shift_ns = 0
    while True:
        for measurement in walk:
            yield replace(measurement, stamp_ns=measurement.stamp_ns + shift_ns)
        shift_ns += walk[-1].stamp_ns + NS_PER_S


def endured(
    what: str,
    measurements: Iterator[Measurement],
    push: Callable[[Measurement], object],
    counted: type,
    minutes: float,
) -> Endurance:
    """Push until the end; only pushing is timed."""
    marks = [mark for mark in _MARKS_MIN if mark <= minutes] or [minutes]
    ms: list[float] = []
    units: list[float] = []
    held: list[float] = []
    taken_s, samples = 0.0, 0
    for measurement in measurements:
        started_s = process_time()
        push(measurement)
        taken_s += process_time() - started_s
        samples += isinstance(measurement, counted)
        if measurement.stamp_ns >= marks[len(ms)] * 60.0 * NS_PER_S:
            ms.append(MS_PER_S * taken_s / samples)
            units.append(ms[-1] / (MS_PER_S * calibration_s()))
            held.append(resident_mb())
            taken_s, samples = 0.0, 0
            if len(ms) == len(marks):
                break
    reached = tuple(marks[: len(ms)])
    return Endurance(what=what, minutes=reached, ms=tuple(ms), units=tuple(units), resident_mb=tuple(held))
