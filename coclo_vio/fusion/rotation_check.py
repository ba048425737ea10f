# SPDX-License-Identifier: BSD-3-Clause
"""Compares the body's rotation by cameras, gyroscopes and standing feet, and names the sensor that contradicts.

Beside filter and window, and independent of them: the cameras' rotation comes from two frames' tracks alone
(``stereo_motion``), the gyroscope's from its readings, the legs' from feet that stand over the whole interval. Slow
disagreement between cameras and gyroscope is an error of calibration, which is estimated (``rotation_calibration``): a
mounting, a delay, a bias. Sudden disagreement is a fault of one of the two, and the third sensor names it. A gyroscope
that has been set aside is replaced by the cameras' own, if there is one, until it agrees with the cameras again.
"""

from collections import deque
from dataclasses import dataclass

import numpy as np

from coclo_vio.fusion.delay_search import LEAST_LAG_S, DelaySearch
from coclo_vio.fusion.gyroscope_return import GyroscopeReturn
from coclo_vio.fusion.rotation_calibration import BIAS, DELAY, MOUNTING, RotationCalibration, RotationPair
from coclo_vio.fusion.rotation_findings import (
    CameraMounting,
    Finding,
    GyroscopeAgrees,
    GyroscopeOffset,
    ImageDelay,
    VisionAgrees,
    VisionSuspect,
)
from coclo_vio.fusion.rotation_streams import FeetRotation, GyroscopeRotation
from coclo_vio.fusion.stereo_motion import stereo_motion
from coclo_vio.fusion.witness import Testimony, Witness
from coclo_vio.geometry import se3, so3
from coclo_vio.values.arrays import Array, BoolArray
from coclo_vio.values.calibration import RectifiedStereo
from coclo_vio.values.measurements import InertialReading, StereoTracks
from coclo_vio.values.units import NS_PER_S

_SHORTEST_S, _LONGEST_S = 0.3, 1.0  # of an interval
_SHORTEST_AGAIN_S = 0.1  # the same after an interval in which sensors disagree
_UNDECIDED_S = 1.0  # for how long a disagreement waits for a witness
_RESTAMPED_WITHIN_S = 1.0  # after a delay was found
_SEARCH_SIGMA_S = 0.005  # of a delay that was found by search
_SIGMAS = 5.0  # beyond which an error of calibration is found
_LEAST_MOUNTING_RAD, _LEAST_DELAY_S = 0.012, 0.012  # less is within a prior, or the low-pass of an IMU
_LEAST_AGAIN_RAD = 0.035  # beyond a mounting that has been found
_LEAST_RATE_RADPS, _LEAST_BIAS_RADPS = 0.015, 0.01
_FEWEST_PAIRS = 10
_IN_A_ROW, _MOST_IN_A_ROW = 2, 12
_JUDGED, _FEWEST_JUDGED = 6, 4  # latest intervals with a turn, by which cameras and gyroscope agree or not
_CONTRADICTED = 16  # turns in a row, in which a search for a delay has all it needs
_SAME_DIRECTION = 0.7


@dataclass(frozen=True, slots=True, eq=False)
class _Disagreement:
    """An interval in which cameras and gyroscope disagree; rates in rad/s, (3,)."""

    start_ns: int
    end_ns: int
    rate: Array  # of the cameras less the gyroscope's
    testimony: tuple[str, Testimony] | None

    def continues(self, before: "_Disagreement") -> bool:
        """Whether it follows the one before at once, and is in the same direction."""
        sizes = float(np.linalg.norm(before.rate) * np.linalg.norm(self.rate))
        return before.end_ns == self.start_ns and bool(before.rate @ self.rate >= _SAME_DIRECTION * sizes)


class RotationCheck:
    """Takes every sensor's measurements and the frames' tracks in order; returns what it finds at a frame.

    Attributes:
        calibration: what is known of mounting, delay and bias.
        gyroscope_delay_s: of the gyroscope behind the joints as it is known without cameras, s.
    """

    def __init__(
        self, rig: RectifiedStereo, rotation_body_imu: Array, rotation_body_camera_imu: Array | None = None
    ) -> None:
        """Take cameras and IMUs.

        Args:
            rig: the cameras.
            rotation_body_imu: of the body's IMU, (3, 3).
            rotation_body_camera_imu: of the cameras' own, (3, 3); None where there is none.
        """
        self.calibration = RotationCalibration()
        self.gyroscope_delay_s = 0.0
        self._rig = rig
        self._body_gyroscope, self._feet = GyroscopeRotation(rotation_body_imu), FeetRotation()
        own = rotation_body_camera_imu
        self._camera_gyroscope = None if own is None else GyroscopeRotation(own)
        self._gyroscope = self._body_gyroscope  # that is compared
        self._aside: GyroscopeReturn | None = None  # the body's, while it is set aside
        self._witnesses = {"legs": Witness(), "camera_gyroscope": Witness()}
        self._reference: Array | None = None  # bias that is subtracted from all readings
        self._start: StereoTracks | None = None
        self._settled_ns = 0  # before that, stamps of frames may be those before a correction
        self._disagreements: deque[_Disagreement] = deque(maxlen=_MOST_IN_A_ROW)
        self._unexplained: deque[tuple[int, int, Array]] = deque(maxlen=_MOST_IN_A_ROW)  # motions since the last accord
        self._delays = DelaySearch(self._gyroscope)
        self._agreed: deque[bool] = deque(maxlen=_JUDGED)
        self._contradicted = 0  # turns in a row
        self._sizes: deque[tuple[float, float]] = deque(maxlen=_JUDGED)  # squares of differences, and of turns
        self._suspects_vision = False
        self._reported_mounting: Array | None = None

    @property
    def start_ns(self) -> int | None:
        """Time of the frame at which the present interval began."""
        return None if self._start is None else self._start.stamp_ns

    @property
    def is_for_vision(self) -> bool:
        """Whether cameras and gyroscope agree in at least half of the latest turns, or another sensor is for vision.

        Also where there is no gyroscope to compare with; not before there are some turns.
        """
        if self._gyroscope.is_empty:
            return True
        known = [each.testimony[1] for each in self._disagreements if each.testimony is not None]
        agree = len(self._agreed) >= _FEWEST_JUDGED and 2 * sum(self._agreed) >= len(self._agreed)
        return agree or Testimony.VISION in known

    @property
    def contradicts(self) -> bool:
        """Whether cameras and gyroscope contradict each other in each of the latest turns.

        By more than the turns themselves, or in so many of them that a delay would have been found.
        """
        if self._contradicted < _JUDGED:
            return False
        off, turned = np.sum(self._sizes, axis=0)
        return bool(off > turned) or self._contradicted >= _CONTRADICTED

    @property
    def uses_body_gyroscope(self) -> bool:
        """Whether the body's gyroscope is compared: it is not set aside."""
        return self._aside is None

    def push_gyroscope(self, reading: InertialReading) -> None:
        """Take a reading of the body's gyroscope."""
        self._body_gyroscope.push(reading.stamp_ns, reading.angular_velocity)

    def push_camera_gyroscope(self, reading: InertialReading) -> None:
        """Take a reading of the cameras' own gyroscope."""
        if self._camera_gyroscope is not None:
            self._camera_gyroscope.push(reading.stamp_ns, reading.angular_velocity)

    def push_feet(self, stamp_ns: int, feet: Array, is_stance: BoolArray) -> None:
        """Take positions of the feet, body frame, m, (n, 3), and which of them stand, (n,)."""
        self._feet.push(stamp_ns, feet, is_stance)

    def push_tracks(self, tracks: StereoTracks, bias: Array) -> Finding | None:
        """Take a frame's tracks; what is found by it.

        Args:
            tracks: of the frame.
            bias: of the gyroscope as the filter estimates it at that time, body axes, rad/s, (3,).
        """
        if self._reference is None:
            self._reference = np.array(bias)
        start, stamp_ns = self._start, tracks.stamp_ns
        if stamp_ns < self._settled_ns:
            return None
        dt_s = 0.0 if start is None else (stamp_ns - start.stamp_ns) / NS_PER_S
        if 0.0 < dt_s < (_SHORTEST_AGAIN_S if self._disagreements else _SHORTEST_S):
            return None
        if start is None or not 0.0 < dt_s <= _LONGEST_S:
            self._start = tracks
            return None
        motion = self._visual_motion(start, tracks)
        pair = None if motion is None else self._pair(start.stamp_ns, stamp_ns, motion)
        if dt_s < _SHORTEST_S and (pair is None or self.calibration.innovation(pair)[0].is_accepted):
            return None  # a short interval decides only where it is significant
        self._start = tracks
        return None if motion is None else self._finding(start.stamp_ns, stamp_ns, motion[0], pair, bias)

    def _finding(
        self, start_ns: int, end_ns: int, T_start_end: Array, pair: RotationPair | None, bias: Array
    ) -> Finding | None:
        """What is found by an interval, of which there is no pair without readings of the gyroscope."""
        assert self._reference is not None, "there was a frame"
        returned = self._returned(start_ns, end_ns, T_start_end)
        if returned is not None:
            return returned
        delayed = self._delayed(start_ns, end_ns, so3.log(T_start_end[:3, :3]))
        if delayed is not None or pair is None:
            return delayed
        return self._compare(start_ns, end_ns, pair, self._reference - bias)

    def _delayed(self, start_ns: int, end_ns: int, by_vision: Array) -> ImageDelay | None:
        """A delay of the images beyond what the calibration can find; a gyroscope that it set aside is used again."""
        behind_gyroscope_s = self._delays.push(start_ns, end_ns, by_vision)
        if behind_gyroscope_s is None or abs(behind_gyroscope_s + self.gyroscope_delay_s) < LEAST_LAG_S:
            return None
        delay_s = behind_gyroscope_s + self.gyroscope_delay_s
        if self._aside is not None and self._camera_gyroscope is None:
            self._aside = None
            self._compare_with(self._body_gyroscope)
        self.calibration = RotationCalibration()  # none of its pairs was of one time
        self.calibration.remove_delay(self.gyroscope_delay_s)
        return self._delay(end_ns, delay_s, _SEARCH_SIGMA_S)

    def set_gyroscope_aside(self) -> None:
        """From now on compare the cameras with their own gyroscope, if there is one, and watch the body's."""
        self._aside, self.gyroscope_delay_s = GyroscopeReturn(self._body_gyroscope), 0.0
        own, delays = self._camera_gyroscope, self._delays
        self._compare_with(GyroscopeRotation(np.eye(3)) if own is None else own)
        if own is None:
            self._delays = delays  # a delay may be why the body's contradicts

    def _returned(self, start_ns: int, end_ns: int, T_start_end: Array) -> GyroscopeAgrees | None:
        """Whether a gyroscope that was set aside agrees with the cameras."""
        returned = None if self._aside is None else self._aside.push(start_ns, end_ns, so3.log(T_start_end[:3, :3]))
        if returned is not None:
            self._aside, self._reference = None, returned.bias
            self._compare_with(self._body_gyroscope)
        return returned

    def _compare_with(self, gyroscope: GyroscopeRotation) -> None:
        """Begin to compare the cameras with another gyroscope."""
        self._gyroscope, self._delays = gyroscope, DelaySearch(gyroscope)
        self.calibration = RotationCalibration()
        self._witnesses = {name: Witness() for name in self._witnesses}  # they know the other gyroscope
        self._disagreements.clear()
        self._unexplained.clear()
        self._agreed.clear()
        self._contradicted = 0
        self._suspects_vision = False

    def _visual_motion(self, start: StereoTracks, end: StereoTracks) -> tuple[Array, Array] | None:
        """The body's motion between two frames, (4, 4), and the covariance of its rotation, body axes, (3, 3)."""
        motion = stereo_motion(self._rig, start, end)
        if motion is None:
            return None
        T_body_camera = self._rig.T_body_camera
        to_body = T_body_camera[:3, :3]
        T_start_end = T_body_camera @ motion.T_start_end @ se3.inverse(T_body_camera)
        return T_start_end, to_body @ motion.covariance[:3, :3] @ to_body.T

    def _pair(self, start_ns: int, end_ns: int, motion: tuple[Array, Array]) -> RotationPair | None:
        """The rotation between two frames by cameras and gyroscope; None without readings of the gyroscope."""
        by_gyroscope = self._gyroscope.between(start_ns, end_ns, self._bias_removed)
        if by_gyroscope is None:
            return None
        T, covariance = motion
        return RotationPair(T, so3.log(T[:3, :3]), covariance, *by_gyroscope, (end_ns - start_ns) / NS_PER_S)

    @property
    def _bias_removed(self) -> Array:
        """What is subtracted from readings of the gyroscope that is compared, rad/s, (3,)."""
        return np.zeros(3) if self._reference is None or self._aside is not None else self._reference

    def _compare(self, start_ns: int, end_ns: int, pair: RotationPair, reference_less_bias: Array) -> Finding | None:
        innovation = self.calibration.add(pair)
        if innovation.turns_significantly:
            self._agreed.append(innovation.is_accepted)
            self._contradicted = 0 if innovation.is_accepted else self._contradicted + 1
            off = pair.by_vision - pair.by_gyroscope
            self._sizes.append((float(off @ off), float(pair.by_vision @ pair.by_vision)))
        others = self._others(start_ns, end_ns, pair.by_gyroscope)
        if innovation.is_accepted:
            self._disagreements.clear()
            self._unexplained.clear()
            for name, rate in others.items():
                self._witnesses[name].add(rate)
            if self._suspects_vision:
                self._suspects_vision = False
                return VisionAgrees()
            return self._calibration_finding(end_ns, reference_less_bias)
        rate = innovation.value / pair.dt_s
        mounting = se3.exp(np.concatenate((self.calibration.mean[MOUNTING], np.zeros(3))))
        if self._unexplained and self._unexplained[-1][1] != start_ns:
            self._unexplained.clear()
        self._unexplained.append((start_ns, end_ns, se3.inverse(mounting) @ pair.T_start_end @ mounting))
        if self.calibration.pairs < _FEWEST_PAIRS or np.linalg.norm(rate) < _LEAST_RATE_RADPS:
            return None
        last = _Disagreement(start_ns, end_ns, rate, self._testimony(others, rate))
        if self._disagreements and not last.continues(self._disagreements[-1]):
            self._disagreements.clear()
        self._disagreements.append(last)
        return self._sudden_finding() if len(self._disagreements) >= _IN_A_ROW else None

    def rotation_since(self, start_ns: int, end_ns: int, bias: Array) -> Array:
        """By the gyroscope with this bias, body axes, (3, 3); the identity where there are no readings of that time."""
        known = self._gyroscope.between(start_ns, end_ns, bias) if end_ns > start_ns else None
        return np.eye(3) if known is None else so3.exp(known[0])

    def _others(self, start_ns: int, end_ns: int, by_gyroscope: Array) -> dict[str, Array]:
        """Rates of the other sensors less the gyroscope's, rad/s, (3,) each, by name."""
        rotations: dict[str, Array | None] = {}  # the better witness first
        if self._camera_gyroscope is not None and self._aside is None:
            by_camera = self._camera_gyroscope.between(start_ns, end_ns, np.zeros(3))
            rotations["camera_gyroscope"] = None if by_camera is None else by_camera[0]
        rotations["legs"] = self._feet.between(start_ns, end_ns)
        dt_s = (end_ns - start_ns) / NS_PER_S
        return {name: (each - by_gyroscope) / dt_s for name, each in rotations.items() if each is not None}

    def _testimony(self, others: dict[str, Array], rate: Array) -> tuple[str, Testimony] | None:
        """Of the first witness that can tell who is right; ``rate``: of the cameras less the gyroscope's, rad/s."""
        testimonies = ((name, self._witnesses[name].testify(each, rate)) for name, each in others.items())
        return next(((name, known) for name, known in testimonies if known is not None), None)

    def _testimony_of_row(self) -> tuple[str, Testimony] | None:
        """The same over the whole time of disagreement, in which a witness's noise counts less."""
        start_ns, end_ns = self._disagreements[0].start_ns, self._disagreements[-1].end_ns
        known = self._gyroscope.between(start_ns, end_ns, self._bias_removed)
        if known is None:
            return None
        turns = [each.rate * (each.end_ns - each.start_ns) for each in self._disagreements]
        return self._testimony(self._others(start_ns, end_ns, known[0]), np.sum(turns, axis=0) / (end_ns - start_ns))

    def _calibration_finding(self, end_ns: int, reference_less_bias: Array) -> Finding | None:
        """An error of calibration that is significant."""
        known = self.calibration
        if known.pairs < _FEWEST_PAIRS:
            return None
        mounting, covariance = known.mean[MOUNTING], known.covariance[MOUNTING, MOUNTING]
        delay_s = float(known.mean[DELAY]) + self.gyroscope_delay_s
        sigma_s = float(np.sqrt(known.covariance[DELAY, DELAY]))
        if abs(delay_s) > max(_SIGMAS * sigma_s, _LEAST_DELAY_S):
            known.remove_delay(delay_s)
            return self._delay(end_ns, delay_s, sigma_s)
        reported, least = self._reported_mounting, _LEAST_MOUNTING_RAD
        if reported is not None:
            mounting, least = mounting - reported, _LEAST_AGAIN_RAD
        if _is_significant(mounting, covariance, least):
            self._reported_mounting = known.mean[MOUNTING]
            return CameraMounting(known.mean[MOUNTING], covariance)
        off = reference_less_bias + known.mean[BIAS]
        if self._aside is None and _is_significant(off, known.covariance[BIAS, BIAS], _LEAST_BIAS_RADPS):
            return self._offset(off, end_ns, end_ns, np.eye(4), None)
        return None

    def _delay(self, stamp_ns: int, delay_s: float, sigma_s: float) -> ImageDelay:
        """Stamps change from here on, but for frames that are being processed."""
        self._start, self._settled_ns = None, stamp_ns + round(_RESTAMPED_WITHIN_S * NS_PER_S)
        self._disagreements.clear()
        self._unexplained.clear()
        self._agreed.clear()
        self._contradicted = 0
        self._delays.restart()
        return ImageDelay(delay_s, sigma_s)

    def _sudden_finding(self) -> Finding | None:
        """Who is wrong, once cameras and gyroscope have disagreed twice in a row in the same direction."""
        row, last = self._disagreements, self._disagreements[-1]
        single = next((each.testimony for each in reversed(row) if each.testimony is not None), None)
        testimony = self._testimony_of_row() or single
        if self._aside is None and testimony is not None and testimony[1] is Testimony.VISION:
            T_start_end = np.linalg.multi_dot([T for _, _, T in self._unexplained])  # of at least the row
            start_ns = self._unexplained[0][0]
            self._unexplained.clear()
            self.calibration.step_bias(-last.rate)
            for witness in self._witnesses.values():
                witness.shift(last.rate)
            row.clear()
            return self._offset(-last.rate, start_ns, last.end_ns, T_start_end, testimony[0])
        is_undecided = testimony is None and (last.end_ns - row[0].start_ns) / NS_PER_S < _UNDECIDED_S
        if self._suspects_vision or is_undecided:
            return None
        self._suspects_vision = True
        return VisionSuspect(float(np.linalg.norm(last.rate)), None if testimony is None else testimony[0])

    def _offset(
        self, change: Array, start_ns: int, end_ns: int, T_start_end: Array, witness: str | None
    ) -> GyroscopeOffset:
        assert self._reference is not None, "there was an interval"
        bias = self._reference + self.calibration.mean[BIAS]
        sigma = float(np.sqrt(self.calibration.covariance[BIAS, BIAS].trace() / 3.0))
        return GyroscopeOffset(bias, change, sigma, start_ns, end_ns, T_start_end, witness)


def _is_significant(value: Array, covariance: Array, least: float) -> bool:
    """Whether a vector (3,) exceeds its sigma in its own direction many times, and is surely longer than ``least``."""
    size = float(np.linalg.norm(value))
    if size <= least:
        return False
    along = value / size
    sigma = float(np.sqrt(along @ covariance @ along))
    return size > max(_SIGMAS * sigma, least + 2.0 * sigma)
