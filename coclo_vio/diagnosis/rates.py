# SPDX-License-Identifier: BSD-3-Clause
"""Angular velocities of the body by each sensor as attitudes over time, and the offset of one's clock to another's."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from coclo_vio.diagnosis.records import InertialRecord
from coclo_vio.evaluation.angular_motion import stamped_motion
from coclo_vio.evaluation.clock import ClockConfig, fit_clock
from coclo_vio.frontend.frontend import StereoFrontend
from coclo_vio.fusion.stereo_motion import stereo_motion
from coclo_vio.geometry import se3, so3
from coclo_vio.values.arrays import Array
from coclo_vio.values.calibration import StereoCalibration
from coclo_vio.values.errors import CocloError
from coclo_vio.values.measurements import StereoFrame
from coclo_vio.values.trajectory import GroundTruth, Trajectory
from coclo_vio.values.units import NS_PER_S

_PARTS = 4  # of the recording, whose offsets give the sigma
_LEAST_CORRELATION = 0.7
_LEAST_SIGMA_S = 2e-4
_UNCORRELATED_S = 0.02  # offset of a part whose angular velocities do not correlate
_SEARCHED_S = 2.0
_WINDOW_S = 0.1
_LEAST_RADPS = 0.01
_LONGEST_STEP_S = 1.0  # between two frames of one chain


@dataclass(frozen=True, slots=True)
class ClockOffset:
    """What is added to one sensor's stamps to come to another's clock.

    Attributes:
        seconds: the offset, s.
        sigma_s: of it, by the parts of the recording, s.
        correlation: of the angular velocities, 0 to 1.
        drift: change of the offset a second, s/s.
        drift_sigma: of that.
    """

    seconds: float
    sigma_s: float
    correlation: float
    drift: float
    drift_sigma: float


def by_gyroscope(record: InertialRecord, rotation_body_imu: Array) -> Trajectory:
    """Attitudes by integration of a gyroscope without its median, at the origin.

    Args:
        record: the IMU.
        rotation_body_imu: ``R_body_imu``, (3, 3).
    """
    is_later = np.append(True, np.diff(np.maximum.accumulate(record.stamps_ns)) > 0)
    stamps_ns, rates = record.stamps_ns[is_later], record.rate[is_later]
    rates = (rates - np.median(rates, axis=0)) @ rotation_body_imu.T
    turns = so3.exp(0.5 * (rates[1:] + rates[:-1]) * np.diff(stamps_ns)[:, None] / NS_PER_S)
    return _chained(stamps_ns.tolist(), turns)


def by_cameras(frames: Sequence[StereoFrame], stereo: StereoCalibration) -> Trajectory | None:
    """Attitudes of the body by rotations from frame to frame, stamps by the IMU's clock as calibrated; None if blind.

    Args:
        frames: consecutive ones.
        stereo: calibration of the cameras.
    """
    try:
        frontend = StereoFrontend(stereo)
        tracks = [frontend.track(frame) for frame in frames]
    except CocloError:
        return None
    R_body_camera = frontend.rig.T_body_camera[:3, :3]
    offset_ns = round(stereo.time_offset_s * NS_PER_S)
    stamps_ns: list[int] = []
    turns: list[Array] = []
    for before, after in pairwise(tracks):
        motion = None
        if after.stamp_ns - before.stamp_ns <= _LONGEST_STEP_S * NS_PER_S:
            motion = stereo_motion(frontend.rig, before, after)
        if motion is None:
            if len(turns) > len(tracks) // 2:
                break
            stamps_ns, turns = [], []
            continue
        stamps_ns = stamps_ns or [before.stamp_ns + offset_ns]
        stamps_ns.append(after.stamp_ns + offset_ns)
        turns.append(R_body_camera @ motion.T_start_end[:3, :3] @ R_body_camera.T)
    return _chained(stamps_ns, np.array(turns)) if len(turns) > 1 else None


def _chained(stamps_ns: Sequence[int], turns: Array) -> Trajectory:
    """Attitudes (N) from the rotations between them (N - 1, 3, 3)."""
    attitudes = [np.eye(3)]
    for turn in turns:
        attitudes.append(attitudes[-1] @ turn)
    return Trajectory(
        np.array(stamps_ns, dtype=np.int64), se3.transform(np.array(attitudes), np.zeros((len(attitudes), 3)))
    )


def clock_offset(reference: Trajectory, other: Trajectory) -> ClockOffset | None:
    """The offset of a sensor's clock by the angular velocities of both; None where they do not decide on one.

    Stamps that lie further apart than the search are brought together by their first ones.

    Args:
        reference: attitudes on the clock that counts.
        other: attitudes on the other clock.
    """
    apart_ns = _apart_ns(reference, other)
    whole = _offset_s(reference, other, apart_ns)
    if whole is None:
        return None
    seconds, correlation = whole
    shifted = other.restamped(other.stamps_ns + round(seconds * NS_PER_S))
    times_s, offsets_s = [], []
    for part in _parts(shifted):
        found = _offset_s(reference, part, 0)
        if found is not None:
            times_s.append(0.5 * (part.stamps_ns[0] + part.stamps_ns[-1] - 2 * shifted.stamps_ns[0]) / NS_PER_S)
            offsets_s.append(found[0])
    if len(offsets_s) < 3:
        return ClockOffset(seconds, 0.01, correlation, 0.0, np.inf)
    drift, middle = np.polyfit(times_s, offsets_s, 1)
    spread_s = max(float(np.std(offsets_s, ddof=1)), _LEAST_SIGMA_S)
    residual_s = np.std(np.array(offsets_s) - drift * np.array(times_s) - middle, ddof=2)
    floor_s = _UNCORRELATED_S * np.sqrt(max(1.0 - correlation**2, 0.0))  # few parts have equal offsets by chance
    drift_sigma = np.hypot(residual_s, floor_s + _LEAST_SIGMA_S) / (np.std(times_s) * np.sqrt(len(times_s)))
    sigma_s = float(spread_s / np.sqrt(len(offsets_s)))
    return ClockOffset(seconds, sigma_s, correlation, float(drift), float(drift_sigma))


def _apart_ns(reference: Trajectory, other: Trajectory) -> int:
    first_ns, last_ns = (
        max(reference.stamps_ns[0], other.stamps_ns[0]),
        min(reference.stamps_ns[-1], other.stamps_ns[-1]),
    )
    return 0 if last_ns - first_ns > 0 else int(reference.stamps_ns[0] - other.stamps_ns[0])


def _parts(trajectory: Trajectory) -> list[Trajectory]:
    edges = np.linspace(0, len(trajectory), _PARTS + 1).astype(int)
    return [trajectory.select(np.arange(a, b)) for a, b in pairwise(edges) if b - a > 3]


def _offset_s(reference: Trajectory, other: Trajectory, apart_ns: int) -> tuple[float, float] | None:
    """Offset, s, and correlation."""
    config = ClockConfig(
        max_offset_s=_SEARCHED_S if apart_ns == 0 else 20.0,
        window_s=_WINDOW_S,
        min_correlation=_LEAST_CORRELATION,
        min_rate_radps=_LEAST_RADPS,
        max_gap_s=_LONGEST_STEP_S,
    )
    moved = other.restamped(other.stamps_ns + apart_ns)
    try:
        fit = fit_clock(reference, GroundTruth(moved, has_stamps=True, source="other clock"), config)
    except CocloError:
        return None
    if not fit.is_estimated or fit.correlation is None:
        return None
    return fit.offset_s + apart_ns / NS_PER_S, fit.correlation


def smoothed_rates(attitudes: Trajectory, start_ns: int, duration_s: float, window_s: float) -> tuple[Array, Array]:
    """Times, s, (N,), and angular velocities as means over a window, rad/s, body axes, (N, 3); NaN where unknown.

    Args:
        attitudes: over time.
        start_ns: beginning of the stretch.
        duration_s: its length, s.
        window_s: of the means, s.
    """
    times_s = np.arange(0.0, duration_s, 0.2 * window_s)
    motion = stamped_motion(attitudes, attitudes.stamps_ns, start_ns, window_s, _LONGEST_STEP_S)
    rates, is_known = motion.rates(times_s, window_s)
    rates[~is_known] = np.nan
    return times_s, rates
