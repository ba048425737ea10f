# SPDX-License-Identifier: BSD-3-Clause
"""Simulated faults of joints and feet: frozen encoders and legs, spikes, wrong torques, a leg that is gone, no load."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from pydantic import BeforeValidator, Field

from coclo_vio.robot.description import RobotDescription
from coclo_vio.runs.fault_kinds.fault_form import SPAN, FaultForm, Spans, TimedFault, active, one_or_more
from coclo_vio.runs.fault_spans import Span
from coclo_vio.values.config import StageConfig
from coclo_vio.values.errors import ConfigError, listing
from coclo_vio.values.measurements import FootForceSample, JointSample

LEG = FaultForm("LEG:START:SECONDS", "leg1:20:3")
JOINT = FaultForm("JOINT:START:SECONDS", "leg1_base:20:3")
SPIKES = FaultForm("JOINT:START:SECONDS:DEG", "leg1_base:20:3:20", ((0.0, 180.0),))
TORQUE = FaultForm("START:SECONDS:NM", "20:5:5", ((0.0, 1e4),))
SLIDING = FaultForm("LEG:START:SECONDS:MPS", "leg1:20:3:0.1", ((0.0, 5.0),))
_SPIKE_SHARE = 0.05  # of the samples

LegSpans = Annotated[tuple[Annotated[str, BeforeValidator(LEG.checked)], ...], BeforeValidator(one_or_more)]
_JointSpans = Annotated[tuple[Annotated[str, BeforeValidator(JOINT.checked)], ...], BeforeValidator(one_or_more)]
_Spikes = Annotated[tuple[Annotated[str, BeforeValidator(SPIKES.checked)], ...], BeforeValidator(one_or_more)]
_Torques = Annotated[tuple[Annotated[str, BeforeValidator(TORQUE.checked)], ...], BeforeValidator(one_or_more)]
_Sliding = Annotated[tuple[Annotated[str, BeforeValidator(SLIDING.checked)], ...], BeforeValidator(one_or_more)]


class JointFaultsConfig(StageConfig):
    """What goes wrong with joints and feet, beside wrong signs and zeros of encoders."""

    frozen_legs: Annotated[
        LegSpans, Field(description="LEG:START:SECONDS each: the leg's joints repeat their last reading, at rest")
    ] = ()
    silent_joints: Annotated[Spans, Field(description='START:SECONDS each: no joint sample; as ["20:5"]')] = ()
    frozen_encoders: Annotated[
        _JointSpans, Field(description="JOINT:START:SECONDS each: the encoder repeats its last angle, at rest")
    ] = ()
    encoder_spikes: Annotated[
        _Spikes, Field(description="JOINT:START:SECONDS:DEG each: one sample in twenty is off by so many degrees")
    ] = ()
    zero_torques: Annotated[Spans, Field(description="START:SECONDS each: every torque reads 0")] = ()
    torque_offsets: Annotated[
        _Torques, Field(description="START:SECONDS:NM each: added to the torque of every joint")
    ] = ()
    missing_legs: Annotated[
        LegSpans, Field(description="LEG:START:SECONDS each: neither its joints nor its foot give a reading")
    ] = ()
    no_load: Annotated[
        Spans, Field(description="START:SECONDS each: torques and foot forces read 0 while the legs go on")
    ] = ()
    sliding_legs: Annotated[
        _Sliding,
        Field(description="LEG:START:SECONDS:MPS each: the foot slides back at this speed while it is on the ground"),
    ] = ()


@dataclass(frozen=True, slots=True)
class _FrozenJoints:
    """Columns of joints in a ``JointSample`` that repeat their last reading, and when."""

    columns: tuple[int, ...]
    span: Span
    with_effort: bool


class JointFaults:
    """The faults of a configuration on joint samples and foot forces; sliding feet are in ``sliding_feet``."""

    def __init__(self, config: JointFaultsConfig, robot: RobotDescription | None, seed: int) -> None:
        """Take the faults; ``seed`` decides which samples have spikes.

        Raises:
            ConfigError: a leg or joint that the robot does not have, or no robot.
        """
        self._silent, self._no_load = SPAN.parsed(config.silent_joints), SPAN.parsed(config.no_load)
        self._zero, self._torques = SPAN.parsed(config.zero_torques), TORQUE.parsed(config.torque_offsets)
        frozen = [
            _FrozenJoints(joints_of_leg("frozen_legs", fault, robot), fault.span, with_effort=True)
            for fault in LEG.parsed(config.frozen_legs)
        ]
        frozen += [
            _FrozenJoints((column_of("frozen_encoders", fault, robot),), fault.span, with_effort=False)
            for fault in JOINT.parsed(config.frozen_encoders)
        ]
        self._frozen = frozen
        self._held: list[JointSample | None] = [None] * len(frozen)
        self._spikes = [
            (fault, column_of("encoder_spikes", fault, robot)) for fault in SPIKES.parsed(config.encoder_spikes)
        ]
        self._missing = [
            (fault, joints_of_leg("missing_legs", fault, robot), leg_number("missing_legs", fault, robot))
            for fault in LEG.parsed(config.missing_legs)
        ]
        self._random = np.random.default_rng([seed, 3])

    def applied(self, sample: JointSample, after_ns: int) -> JointSample | None:
        """The sample, or what becomes of it; None where it is lost. A leg frozen from the start holds its first."""
        held = self._frozen_now(sample, after_ns)
        spikes = [
            (column, np.radians(fault.values[0]))
            for fault, column in self._spikes
            if after_ns in fault.span and self._random.random() < _SPIKE_SHARE
        ]
        if active(self._silent, after_ns):
            return None
        missing = [joints for fault, joints, _ in self._missing if after_ns in fault.span]
        zero = bool(active(self._zero, after_ns) or active(self._no_load, after_ns))
        torques = active(self._torques, after_ns)
        if not (held or spikes or missing or zero or torques):
            return sample
        position, velocity, effort = (np.array(part) for part in (sample.position, sample.velocity, sample.effort))
        for frozen, source in held:
            columns = list(frozen.columns)
            position[columns], velocity[columns] = source.position[columns], 0.0
            if frozen.with_effort:
                effort[columns] = source.effort[columns]
        for column, angle in spikes:
            position[column] += angle
        if zero:
            effort[:] = 0.0
        effort += sum(fault.values[0] for fault in torques)
        for joints in missing:
            for part in (position, velocity, effort):
                part[list(joints)] = np.nan
        return JointSample(sample.stamp_ns, position, velocity, effort)

    def applied_to_feet(self, sample: FootForceSample, after_ns: int) -> FootForceSample:
        """The foot forces without those of legs that are gone, and without load."""
        missing = [leg for fault, _, leg in self._missing if after_ns in fault.span]
        is_unloaded = bool(active(self._no_load, after_ns))
        if not (missing or is_unloaded):
            return sample
        force = np.zeros_like(sample.force) if is_unloaded else np.array(sample.force)
        force[missing] = np.nan
        return FootForceSample(sample.stamp_ns, force)

    def _frozen_now(self, sample: JointSample, after_ns: int) -> list[tuple[_FrozenJoints, JointSample]]:
        """The joints that are frozen now, and the sample that they hold."""
        found = []
        for index, frozen in enumerate(self._frozen):
            held = self._held[index]
            if held is None or after_ns not in frozen.span:
                held = self._held[index] = sample
            if after_ns in frozen.span:
                found.append((frozen, held))
        return found


def leg_number(key: str, fault: TimedFault, robot: RobotDescription | None) -> int:
    """Place of a fault's leg among those of the robot.

    Raises:
        ConfigError: the robot does not have it, or there is no robot.
    """
    names = [leg.name for leg in _robot(key, fault, robot).legs]
    return _place(key, fault, robot, "leg", names)


def joints_of_leg(key: str, fault: TimedFault, robot: RobotDescription | None) -> tuple[int, ...]:
    """Columns of the joints of a fault's leg.

    Raises:
        ConfigError: the robot does not have it, or there is no robot.
    """
    known = _robot(key, fault, robot)
    return tuple(known.joint_names.index(joint) for joint in known.legs[leg_number(key, fault, robot)].joints)


def column_of(key: str, fault: TimedFault, robot: RobotDescription | None) -> int:
    """Column of a fault's joint.

    Raises:
        ConfigError: the robot does not have it, or there is no robot.
    """
    return _place(key, fault, robot, "joint", _robot(key, fault, robot).joint_names)


def _robot(key: str, fault: TimedFault, robot: RobotDescription | None) -> RobotDescription:
    if robot is None:
        raise ConfigError(f"faults.{key} = {fault.text!r}: no robot is given; name it with --robot")
    return robot


def _place(key: str, fault: TimedFault, robot: RobotDescription | None, kind: str, names: Sequence[str]) -> int:
    if fault.of not in names:
        name = "" if robot is None else robot.name
        raise ConfigError(
            f"faults.{key} = {fault.text!r}: {name} has no {kind} {fault.of}; its {kind}s are: {listing(names)}"
        )
    return list(names).index(fault.of)
