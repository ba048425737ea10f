# SPDX-License-Identifier: BSD-3-Clause
"""Clocks: stamps in another unit, streams that were never recorded at the same time, offsets and drifts by motion."""

from collections.abc import Iterator

import numpy as np

from coclo_vio.datasets.corrections import STAMP_UNITS_NS
from coclo_vio.datasets.read_report import ReadReport
from coclo_vio.diagnosis.evidence import Evidence
from coclo_vio.diagnosis.finding import Finding, Severity, Stage, error, note, warning
from coclo_vio.diagnosis.rate_fit import delay_of_feet
from coclo_vio.diagnosis.rates import ClockOffset, clock_offset
from coclo_vio.values.units import NS_PER_S

_PLAUSIBLE_HZ = (5.0, 8000.0)  # of joints and IMUs
_FEWEST = 20
_FAST_STREAMS = ("joints", "imu", "camera_imu", "foot_force")
_STREAMS = ("joints", "imu", "foot_force", "camera_imu", "stereo", "stereo_tracks")
_CORRECTIONS = {"stereo_tracks": "stereo"}
_REAL_S, _WRONG_S = 0.006, 0.05  # an offset that is noted, and one with which a result cannot be right
_SIGMAS = 4.0
_CERTAIN_S = 0.003
_BY_FEET_S = 0.004  # least sigma of a delay by feet, which bend and slip
_DRIFT = 5e-5  # s/s: 50 ppm, a cheap clock


def find_units(evidence: Evidence) -> Iterator[Finding]:
    """Stamps whose rates cannot be those of joints and IMUs."""
    records = {name: getattr(evidence, name) for name in _FAST_STREAMS}
    rates_hz = {
        name: NS_PER_S / max(float(np.median(np.diff(record.stamps_ns))), 1e-9)
        for name, record in records.items()
        if record is not None and len(record.stamps_ns) > _FEWEST and np.ptp(record.stamps_ns) > 0
    }
    for stream, rate_hz in rates_hz.items():
        if rate_hz <= _PLAUSIBLE_HZ[1]:
            continue
        units = [unit for unit, ns in STAMP_UNITS_NS.items() if _PLAUSIBLE_HZ[0] < rate_hz / ns < _PLAUSIBLE_HZ[1]]
        cure = f"set dataset.corrections.stamp_unit={units[0]}" if units else "give stamps in nanoseconds"
        all_fast = all(each > _PLAUSIBLE_HZ[1] for each in rates_hz.values())
        yield error(
            "stamp_unit",
            Stage.CLOCKS,
            " ".join(rates_hz),
            f"{stream} come at {rate_hz:.3g} Hz by their stamps, at most {_PLAUSIBLE_HZ[1]:g} is "
            f"expected: the stamps are not nanoseconds but {units[0] if units else 'another unit'}; {cure}",
            *([f"dataset.corrections.stamp_unit={units[0]}"] if units else []),
            is_certain=bool(units) and all_fast,
        )
        return


def find_apart(evidence: Evidence) -> Iterator[Finding]:
    """Streams that were never recorded at the same time as the first one of their kind."""
    starts_ns = evidence.first_stamps_ns
    if not starts_ns or max(starts_ns.values()) - min(starts_ns.values()) < evidence.seconds * NS_PER_S:
        return
    report = evidence.report  # reads all of it, for the ends
    names = [name for name in _STREAMS if report is not None and report.stream(name) is not None]
    for name in names[1:]:
        if report is not None:
            yield from _apart(evidence, report, names[0], name)


def _apart(evidence: Evidence, report: ReadReport, first: str, name: str) -> Iterator[Finding]:
    reference, stream = report.stream(first), report.stream(name)
    if reference is None or stream is None or min(reference.samples, stream.samples) < 2:
        return
    apart_s = (max(reference.start_ns, stream.start_ns) - min(reference.end_ns, stream.end_ns)) / NS_PER_S
    if apart_s <= 0.0:
        return
    begins_s = (stream.start_ns - reference.start_ns) / NS_PER_S
    key = _CORRECTIONS.get(name, name)
    setting = f"dataset.corrections.{key}.delay_s={begins_s + getattr(evidence.corrections, key).delay_s:.6f}"
    yield error(
        "streams_apart",
        Stage.CLOCKS,
        f"{name}",
        f"{name} and {first} were never recorded at the same time: their stamps are {apart_s:.4g} s apart, as of two "
        f"clocks (one since the start of a computer, one since 1970?); if both began at once set {setting}, or use the "
        "bag's own times (dataset.rosbag.clock=received)",
        setting,
    )


def find_offsets(evidence: Evidence) -> Iterator[Finding]:
    """Offsets and drifts of clocks against the body's IMU, by angular velocities."""
    imu, mounting, reference = evidence.imu, evidence.robot_imu, evidence.attitudes_by_imu
    if imu is None or mounting is None or reference is None:
        return
    if evidence.attitudes_by_camera_imu is not None:
        yield from _of_clock(evidence, "camera_imu", clock_offset(reference, evidence.attitudes_by_camera_imu))
    if evidence.feet is not None:
        found = delay_of_feet(evidence.feet, imu.stamps_ns, imu.rate @ mounting.T_body_imu[:3, :3].T)
        if found is not None:
            yield from _of_clock(
                evidence, "joints", ClockOffset(-found[0], max(found[1], _BY_FEET_S), 1.0, 0.0, np.inf)
            )
    if evidence.attitudes_by_cameras is not None:
        yield from _of_clock(evidence, "stereo", clock_offset(reference, evidence.attitudes_by_cameras))


def find_offset_of_truth(evidence: Evidence) -> Iterator[Finding]:
    """The offset of the ground truth's clock, which an evaluation estimates and corrects: a note."""
    reference, truth = evidence.attitudes_by_imu or evidence.attitudes_by_camera_imu, evidence.truth
    if reference is None or truth is None or not truth.has_stamps:
        return
    offset = clock_offset(reference, truth.trajectory)
    if offset is not None:
        yield note(
            "ground_truth_delay",
            Stage.GROUND_TRUTH,
            "ground_truth",
            f"clock {-offset.seconds:+.4f} +- {offset.sigma_s:.4f} s ahead of the IMU's; an evaluation estimates it",
        )


def find_offset_of_camera_imu(evidence: Evidence) -> Iterator[Finding]:
    """The offset of images against the cameras' own IMU, where there is no body IMU."""
    reference, seen = evidence.attitudes_by_camera_imu, evidence.attitudes_by_cameras
    if evidence.imu is None and reference is not None and seen is not None:
        yield from _of_clock(evidence, "stereo", clock_offset(reference, seen), "the camera's IMU")


def _of_clock(
    evidence: Evidence, stream: str, offset: ClockOffset | None, reference: str = "the body's IMU"
) -> Iterator[Finding]:
    """What an offset of a stream against an IMU means."""
    if offset is None:
        return
    late_s = -offset.seconds
    if abs(late_s) > max(_REAL_S, _SIGMAS * offset.sigma_s):
        before_s = float(getattr(evidence.corrections, stream).delay_s)
        setting = f"dataset.corrections.{stream}.delay_s={before_s + late_s:.4f}"
        severity = Severity.ERROR if abs(late_s) > _WRONG_S else Severity.WARNING
        sentence = (
            f"the stamps of {stream} are {1e3 * abs(late_s):.1f} +- {1e3 * offset.sigma_s:.1f} ms "
            f"{'late' if late_s > 0.0 else 'early'} against {reference} by their angular velocities (correlation "
            f"{offset.correlation:.2f}); set {setting}"
        )
        yield Finding(
            f"{stream}_delay",
            Stage.CLOCKS,
            severity,
            sentence,
            frozenset({stream}),
            (setting,),
            is_certain=offset.sigma_s < _CERTAIN_S or abs(late_s) > 2.0 * _SIGMAS * offset.sigma_s,
        )
    else:
        yield note(
            f"{stream}_delay",
            Stage.CLOCKS,
            stream,
            f"{stream} {1e3 * late_s + 0.0:+.1f} +- {1e3 * offset.sigma_s:.1f} ms behind {reference}",
        )
    if abs(offset.drift) > max(_DRIFT, _SIGMAS * offset.drift_sigma):
        yield warning(
            f"{stream}_clock_drift",
            Stage.CLOCKS,
            stream,
            f"the clock of {stream} drifts by {1e6 * offset.drift:.0f} +- {1e6 * offset.drift_sigma:.0f} us a second "
            f"against that of {reference}: synchronise the two clocks (PTP, chrony), or cut the recording short",
        )
