# SPDX-License-Identifier: BSD-3-Clause
"""Simulated faults, applied to any recording to see how an estimator copes with them.

Between a reader and an estimator, one measurement at a time. Ground truth is left alone.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Any

import numpy as np
from pydantic import BeforeValidator, Field

from coclo_vio.robot.description import RobotDescription
from coclo_vio.runs.encoder_faults import EncoderFaults, flipped_span, offset_span
from coclo_vio.runs.fault_spans import Span
from coclo_vio.runs.sensor_faults import GyroscopeOffset, GyroscopeOffsets, LateImages, Vector, offset_gyroscope
from coclo_vio.values.config import StageConfig
from coclo_vio.values.errors import ConfigError, listing
from coclo_vio.values.measurements import (
    ALL_SENSORS,
    ImuSample,
    JointSample,
    Measurement,
    StereoFrame,
    StereoTracks,
    TrackingQuality,
)

_QUOTES = "; quote it, YAML takes 20:5 for a number of base 60"
Read = Callable[[frozenset[type]], Iterator[Measurement]]  # from the beginning each time, as Dataset.measurements


def _leg_span(text: str) -> tuple[str, Span]:
    """Leg and span of ``LEG:START:SECONDS``."""
    leg, _, span = text.partition(":")
    if not leg or ":" not in span:
        raise ValueError(f"{text!r} is no LEG:START:SECONDS, such as leg1:20:3 for three seconds")
    return leg, Span.parse(span)


def _span_text(value: Any) -> str:
    if not isinstance(value, str):
        raise ValueError(f'must be text START:SECONDS, such as "20:5"{_QUOTES}')
    Span.parse(value)
    return value


def _leg_span_text(value: Any) -> str:
    if not isinstance(value, str):
        raise ValueError("must be text LEG:START:SECONDS, such as leg1:20:3")
    _leg_span(value)
    return value


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


def _one_or_more(value: Any) -> Any:
    return value if isinstance(value, Sequence) and not isinstance(value, str) else (value,)


Spans = Annotated[tuple[Annotated[str, BeforeValidator(_span_text)], ...], BeforeValidator(_one_or_more)]
LegSpans = Annotated[tuple[Annotated[str, BeforeValidator(_leg_span_text)], ...], BeforeValidator(_one_or_more)]
JointSpans = Annotated[tuple[Annotated[str, BeforeValidator(_flipped_text)], ...], BeforeValidator(_one_or_more)]
JointOffsets = Annotated[tuple[Annotated[str, BeforeValidator(_offset_text)], ...], BeforeValidator(_one_or_more)]


class FaultsConfig(StageConfig):
    """Which faults occur, and when; starts are in seconds after the recording's first measurement. None by default."""

    blackouts: Annotated[
        Spans, Field(description='START:SECONDS each: images are black, tracks gone; as ["20:5"]')
    ] = ()
    frame_loss: Annotated[float, Field(ge=0, le=1, description="share of stereo frames that are lost, at random")] = 0.0
    seed: Annotated[int, Field(ge=0, description="which frames are lost")] = 0
    frozen_legs: Annotated[
        LegSpans, Field(description="LEG:START:SECONDS each: the leg's joints repeat their last reading, at rest")
    ] = ()
    silent_joints: Annotated[Spans, Field(description='START:SECONDS each: no joint sample; as ["20:5"]')] = ()
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
        Field(description="START:SECONDS:RADPS each: added to every axis of the body's gyroscope; as 20:1000:0.05"),
    ] = ()
    image_delay_s: Annotated[float, Field(ge=0, le=0.5, description="stamps of images are late by this, s")] = 0.0
    camera_turn_deg: Annotated[
        Vector, Field(description="the cameras' calibration is turned by this rotation vector, body axes, deg")
    ] = (0.0, 0.0, 0.0)
    camera_shift_m: Annotated[
        Vector, Field(description="the cameras' calibration is shifted by this, body axes, m")
    ] = (0.0, 0.0, 0.0)

    @property
    def is_none(self) -> bool:
        """Whether there is no fault."""
        return self.leaves_measurements and not self.turns_cameras

    @property
    def leaves_measurements(self) -> bool:
        """Whether every measurement is as recorded."""
        joints = self.frozen_legs or self.silent_joints or self.flipped_encoders or self.encoder_offsets
        return not (joints or self.blackouts or self.gyroscope_offset or self.frame_loss or self.image_delay_s)

    @property
    def turns_cameras(self) -> bool:
        """Whether the cameras' calibration is wrong."""
        return any(self.camera_turn_deg) or any(self.camera_shift_m)


@dataclass(frozen=True, slots=True)
class _FrozenLeg:
    """Columns of the leg's joints in a ``JointSample``, and when they are frozen."""

    joints: tuple[int, ...]
    span: Span


class Faults:
    """The faults of a configuration on a robot; ``measurements`` reads a recording through them."""

    def __init__(self, config: FaultsConfig, robot: RobotDescription | None = None) -> None:
        """Make ready.

        Raises:
            ConfigError: a leg or joint that the robot does not have, or no robot.
        """
        self.config = config
        self._dark = [Span.parse(text) for text in config.blackouts]
        self._silent = [Span.parse(text) for text in config.silent_joints]
        self._frozen = [_frozen_leg(text, robot) for text in config.frozen_legs]
        self._encoders = EncoderFaults(config.flipped_encoders, config.encoder_offsets, robot)
        self._offsets = [GyroscopeOffset.parse(text) for text in config.gyroscope_offset]

    def measurements(self, read: Read, sensors: frozenset[type]) -> Iterator[Measurement]:
        """What ``read`` gives of ``sensors``, with the faults on it.

        Time counts from the recording's first measurement, whatever of it is read: for every estimator alike.

        Raises:
            DatasetError: the recording is malformed.
        """
        if self.config.leaves_measurements:
            yield from read(sensors)
            return
        late = LateImages(self.config.image_delay_s)
        for measurement in self._changed(read, sensors):
            yield from late.push(measurement)
        yield from late.finish()

    def _changed(self, read: Read, sensors: frozenset[type]) -> Iterator[Measurement]:
        start_ns = _first_ns(read)
        losses = np.random.default_rng(self.config.seed)
        blackouts, frozen_legs = _Blackouts(self._dark), _FrozenLegs(self._frozen)
        for measurement in read(sensors):
            after_ns = measurement.stamp_ns - start_ns
            match measurement:
                case StereoFrame() | StereoTracks():
                    if losses.random() >= self.config.frame_loss:
                        yield blackouts.applied(measurement, after_ns)
                case JointSample():
                    sample = frozen_legs.applied(self._encoders.applied(measurement, after_ns), after_ns)
                    if not any(after_ns in span for span in self._silent):
                        yield sample
                case ImuSample():
                    yield offset_gyroscope(measurement, after_ns, self._offsets)
                case _:
                    yield measurement


class _Blackouts:
    """Black images and lost tracks for some spans of time.

    A tracker loses its points in the dark: the same point has another identity afterwards, and a new age.
    """

    def __init__(self, dark: Sequence[Span]) -> None:
        self._dark = dark
        self._was_dark = False
        self._shift = 0  # of identities, from the last darkness on
        self._next_id = 0
        self._frames: int | None = None  # since the last darkness

    def applied(self, frame: StereoFrame | StereoTracks, after_ns: int) -> StereoFrame | StereoTracks:
        """The frame, or what is left of it."""
        is_dark = any(after_ns in span for span in self._dark)
        if isinstance(frame, StereoFrame):
            black = np.zeros_like(frame.left)
            return replace(frame, left=black, right=black) if is_dark else frame
        if is_dark:
            self._shift, self._frames = self._next_id, 0
            nothing = np.zeros((0, 2))
            none = np.zeros(0, dtype=np.int64)
            return StereoTracks(frame.stamp_ns, none, nothing, nothing, quality=TrackingQuality.LOST, reason="blackout")
        shifted = frame
        if self._frames is not None:
            self._frames += 1
            ages = np.minimum(frame.ages, self._frames)
            shifted = replace(frame, track_ids=frame.track_ids + self._shift, ages=ages)
        self._next_id = max(self._next_id, int(shifted.track_ids.max(initial=-1)) + 1)
        return shifted


class _FrozenLegs:
    """Joints of some legs repeat their last reading, for some spans of time."""

    def __init__(self, frozen: Sequence[_FrozenLeg]) -> None:
        self._frozen = frozen
        self._held: list[JointSample | None] = [None] * len(frozen)

    def applied(self, sample: JointSample, after_ns: int) -> JointSample:
        """The sample with the frozen joints' readings in it; one frozen from the start on holds its first."""
        position, velocity, effort = (np.array(part) for part in (sample.position, sample.velocity, sample.effort))
        is_frozen = False
        for index, leg in enumerate(self._frozen):
            held = self._held[index]
            if held is None or after_ns not in leg.span:
                held = self._held[index] = sample
            if after_ns in leg.span:
                joints = list(leg.joints)
                position[joints], effort[joints] = held.position[joints], held.effort[joints]
                velocity[joints] = 0.0
                is_frozen = True
        return JointSample(sample.stamp_ns, position, velocity, effort) if is_frozen else sample


def _frozen_leg(text: str, robot: RobotDescription | None) -> _FrozenLeg:
    name, span = _leg_span(text)
    if robot is None:
        raise ConfigError(f"faults.frozen_legs = {text!r}: no robot is given; name it with --robot")
    joints = {leg.name: leg.joints for leg in robot.legs}
    if name not in joints:
        raise ConfigError(
            f"faults.frozen_legs = {text!r}: {robot.name} has no leg {name}; its legs are: {listing(joints)}"
        )
    return _FrozenLeg(tuple(robot.joint_names.index(joint) for joint in joints[name]), span)


def _first_ns(read: Read) -> int:
    """Stamp of a recording's first measurement; of an image only where there is nothing else, to decode none."""
    for sensors in (ALL_SENSORS - {StereoFrame}, frozenset({StereoFrame})):
        first = next(read(sensors), None)
        if first is not None:
            return first.stamp_ns
    return 0
