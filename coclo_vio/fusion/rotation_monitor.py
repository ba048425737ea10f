# SPDX-License-Identifier: BSD-3-Clause
"""What an estimator of legs and vision does with a comparison of rotations: feeds it, and acts on what it finds.

A gyroscope's offset is corrected in the filter here. The rest is up to the estimator: a ``Revision`` says what to do.
"""

from collections import deque
from dataclasses import dataclass, replace

import numpy as np

from coclo_vio.filter.odometry import LegOdometryFilter
from coclo_vio.filter.revision import Prior, Snapshot
from coclo_vio.fusion.rotation_calibration import DELAY
from coclo_vio.fusion.rotation_check import RotationCheck
from coclo_vio.fusion.rotation_events import (
    accord_event,
    delay_event,
    mounting_sentence,
    named_witness,
    suspicion_event,
)
from coclo_vio.fusion.rotation_findings import (
    CameraMounting,
    GyroscopeAgrees,
    GyroscopeOffset,
    ImageDelay,
    VisionAgrees,
    VisionSuspect,
)
from coclo_vio.geometry import se3, so3
from coclo_vio.values.arrays import Array
from coclo_vio.values.estimates import StateEstimate
from coclo_vio.values.measurements import CameraImuSample, ImuSample, Measurement, StereoTracks
from coclo_vio.values.outputs import Event
from coclo_vio.values.units import NS_PER_S

_KEPT_S = 4.0
_FAULTY_WITHIN_S = 10.0  # a second offset so soon is no bias: the gyroscope is set aside
_MOUNTING_SIGMA_RAD = 0.02  # beyond that of the finding: the filter finds the rest
_SNAPSHOTS = 12  # as many as there can be intervals since the last accord
_LEAST_BIAS_SIGMA_RADPS = 0.002


@dataclass(frozen=True, slots=True, eq=False)
class Revision:
    """What is to be done.

    Attributes:
        event: what was found.
        mounting: prior of the cameras' mounting that replaces the one that holds; None: it stays.
        delay_s: stamps of images are late by this, s.
        resumed_ns: time of the frame from whose state the filter has resumed, in nanoseconds; None: it has not.
        is_anew: the window starts anew: what it holds rests on what has proven wrong.
    """

    event: Event
    mounting: Prior | None = None
    delay_s: float = 0.0
    resumed_ns: int | None = None
    is_anew: bool = False


class RotationMonitor:
    """Feeds a check with measurements, estimates and tracks, and turns its findings into revisions."""

    def __init__(self, check: RotationCheck, leg_filter: LegOdometryFilter) -> None:
        """Take a fresh check, and the filter that the estimator has."""
        self._check, self._filter = check, leg_filter
        self._latest: StateEstimate | None = None
        self._snapshots: dict[int, Snapshot] = {}  # of the filter, by the stamps of frames at which intervals begin
        self._states: deque[StateEstimate] = deque()  # of the last seconds
        self._offset_ns: int | None = None  # when an offset was found last
        self._is_imu_aside = False

    @property
    def is_for_vision(self) -> bool:
        """Whether cameras and gyroscope agree in at least half of the latest turns, or another sensor is for vision."""
        return self._check.is_for_vision

    def take(self, measurement: Measurement) -> bool:
        """Take a reading of an IMU; anything else is left out. Whether the filter is to use the measurement."""
        match measurement:
            case ImuSample():
                self._check.push_gyroscope(measurement)
                return not self._is_imu_aside
            case CameraImuSample():
                self._check.push_camera_gyroscope(measurement)
        return True

    def follow(self, state: StateEstimate) -> None:
        """Take the filter's estimate, right after it was made."""
        self._latest = state
        self._states.append(state)
        while state.stamp_ns - self._states[0].stamp_ns > _KEPT_S * NS_PER_S:
            self._states.popleft()
        reading = self._filter.reading
        if reading is not None and reading.stamp_ns == state.stamp_ns:
            self._check.push_feet(reading.stamp_ns, reading.feet.position_body, reading.is_stance)

    def compare(self, tracks: StereoTracks) -> Revision | None:
        """Take a frame's tracks, once its result is taken; what is to be done."""
        if self._latest is None:
            return None
        stamp_ns, revision = tracks.stamp_ns, None
        self._follow_delay()
        match self._check.push_tracks(tracks, self._latest.nav.gyroscope_bias):
            case CameraMounting() as found:
                revision = self._mounting(stamp_ns, found)
            case ImageDelay() as found:
                self._is_imu_aside = self._is_imu_aside and not self._check.uses_body_gyroscope
                revision = Revision(delay_event(stamp_ns, found), delay_s=found.delay_s, is_anew=True)
            case GyroscopeOffset() as found:
                revision = self._offset(stamp_ns, found, self._latest)
            case GyroscopeAgrees() as found:
                revision = self._use_again(stamp_ns, found)
            case VisionSuspect() as found:
                revision = Revision(suspicion_event(stamp_ns, found))
            case VisionAgrees():
                revision = Revision(accord_event(stamp_ns))
        if self._check.start_ns == stamp_ns:
            self._snapshots[stamp_ns] = self._filter.snapshot()
            if len(self._snapshots) > _SNAPSHOTS:
                del self._snapshots[min(self._snapshots)]
        return revision

    def _follow_delay(self) -> None:
        """The check gets the gyroscope's delay by the legs, and the filter gets that behind the images."""
        delay, known = self._filter.imu_delay, self._check.calibration
        if delay is None or self._is_imu_aside:
            return
        self._check.gyroscope_delay_s = delay.by_legs_s
        if known.pairs > 0:
            delay.measure(-float(known.mean[DELAY]), float(np.sqrt(known.covariance[DELAY, DELAY])))

    def _mounting(self, stamp_ns: int, found: CameraMounting) -> Revision:
        before = self._filter.mounting_prior
        measured = mounting_sentence(found, float(np.sqrt(before.covariance.trace() / 3.0)))
        if before.is_known:
            detail = f"{measured}; it is configured as known: set filter.initial.camera_rotation_sigma_rad"
            return Revision(Event(stamp_ns, "camera_mounting_off", detail))
        detail = f"{measured}; it is estimated from that on, as from the start, and the window starts anew"
        prior = Prior(found.rotation, found.covariance + np.eye(3) * _MOUNTING_SIGMA_RAD**2)
        return Revision(Event(stamp_ns, "camera_mounting_off", detail), mounting=prior, is_anew=True)

    def _offset(self, stamp_ns: int, found: GyroscopeOffset, latest: StateEstimate) -> Revision:
        """Give the filter the new bias, and turn it by what it integrated wrongly since the offset began."""
        resumed, degrees = None, 0.0
        before = self._snapshots.get(found.start_ns)
        is_remembered = self._states[0].stamp_ns <= found.start_ns < found.end_ns
        if before is not None and is_remembered:
            since = np.eye(4)
            since[:3, :3] = self._check.rotation_since(found.end_ns, latest.stamp_ns, found.bias)
            now = latest.nav.T_world_body
            since[:3, 3] = now[:3, :3].T @ latest.nav.velocity_world * ((latest.stamp_ns - found.end_ns) / NS_PER_S)
            pose = self._pose_at(found.start_ns) @ found.T_start_end @ since
            resumed = before, pose
            self._states = deque(_moved(state, pose @ se3.inverse(now)) for state in self._states)
            degrees = float(np.degrees(np.linalg.norm(so3.log(pose[:3, :3] @ now[:3, :3].T))))
        sigma = max(found.sigma, _LEAST_BIAS_SIGMA_RADPS)
        self._filter.revise_gyroscope(found.bias, sigma, resumed)
        x, y, z = found.change
        agreeing = "the cameras show" if found.witness is None else f"cameras and {named_witness(found.witness)} agree"
        measured = (
            f"the bias of the body's gyroscope is off by ({x:.3f}, {y:.3f}, {z:.3f}) +- {found.sigma:.3f} rad/s, as "
            f"{agreeing}"
        )
        last_ns, self._offset_ns = self._offset_ns, stamp_ns
        is_sudden = found.witness is not None  # and no better estimate of the same offset
        if is_sudden and last_ns is not None and stamp_ns - last_ns < _FAULTY_WITHIN_S * NS_PER_S:
            self._is_imu_aside = True
            self._check.set_gyroscope_aside()
            detail = (
                f"{measured}, and was off by another amount {(stamp_ns - last_ns) / NS_PER_S:.1f} s ago: the body's "
                "IMU is set aside until it agrees with the cameras again"
            )
            event = Event(stamp_ns, "imu_set_aside", detail)
        else:
            turned = "" if resumed is None else f" and is turned by {degrees:.1f} deg"
            detail = f"{measured}; the filter takes that over{turned}, and the window starts anew"
            event = Event(stamp_ns, "gyroscope_offset", detail)
        return Revision(event, resumed_ns=None if resumed is None else found.start_ns, is_anew=True)

    def _use_again(self, stamp_ns: int, found: GyroscopeAgrees) -> Revision:
        """Take the body's IMU again, which was set aside."""
        self._is_imu_aside, self._offset_ns = False, None
        self._snapshots.clear()
        self._filter.revise_gyroscope(found.bias, max(found.sigma, _LEAST_BIAS_SIGMA_RADPS))
        detail = "the body's IMU agrees with the cameras on the rotation again, and is used"
        return Revision(Event(stamp_ns, "imu_used_again", detail))

    def _pose_at(self, stamp_ns: int) -> Array:
        """The filter's pose at a time as it was estimated then, (4, 4)."""
        near = min(self._states, key=lambda each: abs(each.stamp_ns - stamp_ns))
        dt_s, T = (stamp_ns - near.stamp_ns) / NS_PER_S, near.nav.T_world_body
        rotation = T[:3, :3] @ so3.exp(near.nav.angular_velocity_body * dt_s)
        return se3.transform(rotation, T[:3, 3] + near.nav.velocity_world * dt_s)


def _moved(state: StateEstimate, T: Array) -> StateEstimate:
    """The state with its pose and velocity moved by ``T`` (4, 4) in the world."""
    nav = state.nav
    velocity = T[:3, :3] @ nav.velocity_world
    return replace(state, nav=replace(nav, T_world_body=T @ nav.T_world_body, velocity_world=velocity))
