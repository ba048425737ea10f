# SPDX-License-Identifier: BSD-3-Clause
"""Simulated faults, applied to any recording to see how an estimator copes with them.

Between a reader and an estimator, one measurement at a time: first what sensors measure wrongly, then what drivers do
to stamps and order. Ground truth is left alone but for gaps.
"""

from collections.abc import Callable, Iterator, Sequence
from typing import Annotated, Any

import numpy as np
from pydantic import BeforeValidator, Field

from coclo_vio.robot.description import RobotDescription
from coclo_vio.runs.encoder_faults import EncoderFaults, flipped_span, offset_span
from coclo_vio.runs.fault_kinds.fault_form import SPAN, Spans, one_or_more
from coclo_vio.runs.fault_kinds.image_faults import Blackouts, ImageFaults, ImageFaultsConfig
from coclo_vio.runs.fault_kinds.inertial_faults import InertialFaults, InertialFaultsConfig
from coclo_vio.runs.fault_kinds.joint_faults import JointFaults, JointFaultsConfig
from coclo_vio.runs.fault_kinds.sliding_feet import SlidingFeet
from coclo_vio.runs.fault_kinds.stream_faults import StreamFaults, StreamFaultsConfig
from coclo_vio.runs.fault_kinds.truth_faults import TruthFaultsConfig, with_gaps
from coclo_vio.runs.sensor_faults import DelayedImages, GyroscopeOffset, GyroscopeOffsets, Vector, offset_gyroscope
from coclo_vio.values.measurements import (
    ALL_SENSORS,
    CameraImuSample,
    FootForceSample,
    ImuSample,
    JointSample,
    Measurement,
    StereoFrame,
    StereoTracks,
)
from coclo_vio.values.trajectory import GroundTruth

Read = Callable[[frozenset[type]], Iterator[Measurement]]  # from the beginning each time, as Dataset.measurements


def _flipped_text(value: Any) -> str:
    if not isinstance(value, str):
        raise ValueError("must be text JOINT:START:SECONDS, such as leg1_base:20:3")
    flipped_span(value)
    return value


def _offset_text(value: Any) -> str:
    if not isinstance(value, str):
        raise ValueError("must be text JOINT:START:SECONDS:DEG, such as leg1_base:20:3:5")
    offset_span(value)
    return value


JointSpans = Annotated[tuple[Annotated[str, BeforeValidator(_flipped_text)], ...], BeforeValidator(one_or_more)]
JointOffsets = Annotated[tuple[Annotated[str, BeforeValidator(_offset_text)], ...], BeforeValidator(one_or_more)]
_BESIDE_MEASUREMENTS = ("seed", "faulty_imu", "camera_turn_deg", "camera_shift_m", "truth_gaps")


class FaultsConfig(TruthFaultsConfig, StreamFaultsConfig, JointFaultsConfig, InertialFaultsConfig, ImageFaultsConfig):
    """Which faults occur, and when; starts are in seconds after the recording's first measurement. None by default."""

    blackouts: Annotated[
        Spans, Field(description='START:SECONDS each: images are black, tracks gone; as ["20:5"]')
    ] = ()
    frame_loss: Annotated[float, Field(ge=0, le=1, description="share of stereo frames that are lost, at random")] = 0.0
    seed: Annotated[int, Field(ge=0, description="decides everything random")] = 0
    flipped_encoders: Annotated[
        JointSpans,
        Field(description="JOINT:START:SECONDS each: the encoder reads angle and velocity with a wrong sign"),
    ] = ()
    encoder_offsets: Annotated[
        JointOffsets,
        Field(description="JOINT:START:SECONDS:DEG each: the zero of the encoder is off by so many degrees"),
    ] = ()
    gyroscope_offset: Annotated[
        GyroscopeOffsets,
        Field(description="START:SECONDS:RADPS each: added to every axis of the gyroscope; as 20:1000:0.05"),
    ] = ()
    image_delay_s: Annotated[
        float, Field(ge=-1, le=1, description="stamps of images are late by this, s; early where it is negative")
    ] = 0.0
    camera_turn_deg: Annotated[
        Vector, Field(description="the cameras' calibration is turned by this rotation vector, body axes, deg")
    ] = (0.0, 0.0, 0.0)
    camera_shift_m: Annotated[
        Vector, Field(description="the cameras' calibration is shifted by this, body axes, m")
    ] = (0.0, 0.0, 0.0)

    @property
    def is_none(self) -> bool:
        """Whether there is no fault."""
        return self.leaves_measurements and not self.turns_cameras and not self.truth_gaps

    @property
    def leaves_measurements(self) -> bool:
        """Whether every measurement is as recorded."""
        fields = type(self).model_fields
        return all(
            getattr(self, name) == field.default for name, field in fields.items() if name not in _BESIDE_MEASUREMENTS
        )

    @property
    def turns_cameras(self) -> bool:
        """Whether the cameras' calibration is wrong."""
        return any(self.camera_turn_deg) or any(self.camera_shift_m)


class Faults:
    """The faults of a configuration on a robot; ``measurements`` reads a recording through them."""

    def __init__(self, config: FaultsConfig, robot: RobotDescription | None = None) -> None:
        """Make ready.

        Raises:
            ConfigError: a leg or joint that the robot does not have, or no robot.
        """
        self.config = config
        self._robot = robot
        _SensorFaults(config, robot)  # a leg that the robot does not have is found before anything runs

    def measurements(self, read: Read, sensors: frozenset[type]) -> Iterator[Measurement]:
        """What ``read`` gives of ``sensors``, with the faults on it.

        Time counts from the recording's first measurement, whatever of it is read: for every estimator alike.

        Raises:
            DatasetError: the recording is malformed.
        """
        if self.config.leaves_measurements:
            yield from read(sensors)
            return
        start_ns = _first_ns(read)
        streams = StreamFaults(self.config, self.config.seed)
        for measurement in self._measured(read(sensors), start_ns):
            yield from streams.push(measurement, measurement.stamp_ns - start_ns)
        yield from streams.finish()

    def truth(self, truth: GroundTruth | None, read: Read) -> GroundTruth | None:
        """Ground truth with its gaps.

        Args:
            truth: of the recording, if there is one.
            read: gives the recording, as in ``measurements``.

        Raises:
            ConfigError: no pose of it is left.
            DatasetError: the recording is malformed.
        """
        if truth is None or not self.config.truth_gaps:
            return truth
        return with_gaps(truth, self.config.truth_gaps, _first_ns(read))

    def _measured(self, measurements: Iterator[Measurement], start_ns: int) -> Iterator[Measurement]:
        """As the sensors measure, in the order of stamps."""
        sensors, delayed = _SensorFaults(self.config, self._robot), DelayedImages(self.config.image_delay_s)
        for measurement in measurements:
            measured = sensors.applied(measurement, measurement.stamp_ns - start_ns)
            if measured is not None:
                yield from delayed.push(measured)
        yield from delayed.finish()


class _SensorFaults:
    """The faults of all sensors, from a recording's beginning on."""

    def __init__(self, config: FaultsConfig, robot: RobotDescription | None) -> None:
        self._frame_loss = config.frame_loss
        self._losses = np.random.default_rng(config.seed)
        self._blackouts = Blackouts([fault.span for fault in SPAN.parsed(config.blackouts)])
        self._images = ImageFaults(config, config.seed)
        self._inertial = InertialFaults(config, config.seed)
        self._offsets = [GyroscopeOffset.parse(text) for text in config.gyroscope_offset]
        self._encoders = EncoderFaults(config.flipped_encoders, config.encoder_offsets, robot)
        self._joints = JointFaults(config, robot, config.seed)
        self._sliding = SlidingFeet(config.sliding_legs, robot)

    def applied(self, measurement: Measurement, after_ns: int) -> Measurement | None:
        """What is measured instead; None where nothing is."""
        match measurement:
            case StereoFrame() | StereoTracks():
                if self._losses.random() < self._frame_loss:
                    return None
                frame = self._images.applied(measurement, after_ns)
                return None if frame is None else self._blackouts.applied(frame, after_ns)
            case JointSample():
                slid = self._sliding.applied(measurement, after_ns)
                return self._joints.applied(self._encoders.applied(slid, after_ns), after_ns)
            case FootForceSample():
                return self._joints.applied_to_feet(measurement, after_ns)
            case ImuSample() | CameraImuSample():
                return self._inertia(measurement, after_ns)
            case _:
                return measurement

    def _inertia(self, sample: ImuSample | CameraImuSample, after_ns: int) -> Measurement | None:
        offsets: Sequence[GyroscopeOffset] = self._offsets if self._inertial.is_on(sample) else ()
        return self._inertial.applied(offset_gyroscope(sample, after_ns, offsets), after_ns)


def _first_ns(read: Read) -> int:
    """Stamp of a recording's first measurement; of an image only where there is nothing else, to decode none."""
    for sensors in (ALL_SENSORS - {StereoFrame}, frozenset({StereoFrame})):
        first = next(read(sensors), None)
        if first is not None:
            return first.stamp_ns
    return 0
