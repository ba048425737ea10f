# SPDX-License-Identifier: BSD-3-Clause
"""The contact estimate of the first minutes: feet that never or always stand, and sensors that say nothing."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from coclo_vio.diagnosis.checks.joint_positions import is_in_degrees
from coclo_vio.diagnosis.checks.joint_torques import are_usual, missing_factor, silent, vertical_loads
from coclo_vio.diagnosis.evidence import Evidence
from coclo_vio.diagnosis.finding import Finding, Stage, error, warning
from coclo_vio.diagnosis.joint_series import is_stepping, thinned
from coclo_vio.robot.contact import ContactConfig, ContactDetector
from coclo_vio.robot.model import RobotModel
from coclo_vio.values.arrays import Array, BoolArray, IntArray
from coclo_vio.values.errors import listing
from coclo_vio.values.units import GRAVITY_MPS2

_RATE_HZ = 50.0
_SAMPLES = 3000
_LEAST_SAMPLES = 50
_NEVER = 0.005
_ALWAYS = 0.995
_SHARES = (0.45, 0.3)  # of a loaded foot's load, for thresholds to try


@dataclass(frozen=True, slots=True, eq=False)
class _Loads:
    """Loads of the feet over time, and the contact that follows.

    Attributes:
        load: N or counts, (N, n), NaN where unknown.
        is_stance: by the configured estimator, (N, n).
        streams: where they come from.
    """

    load: Array
    is_stance: BoolArray
    streams: str


def find(evidence: Evidence) -> Iterator[Finding]:
    """A contact estimate that cannot be right."""
    robot = evidence.robot
    if robot is None or evidence.joints is None:
        return
    config = robot.description.contact
    if config.source == "kinematic":
        yield from _by_motion(evidence, robot)
        return
    if config.source == "force_sensor":
        yield from _sensors(evidence, robot)
    loads = _loads(evidence, robot, config)
    if loads is None or _is_constant(loads.load).all():
        return
    share = loads.is_stance.mean(axis=0)
    is_known = np.isfinite(loads.load).any(axis=0)
    steps = is_stepping(evidence, robot)
    if (share < _NEVER).all():
        yield _never(loads, config, robot, steps=steps)
    elif (share[is_known] > _ALWAYS).all():
        if steps:
            yield _always(loads, config)
    elif steps:
        yield from _single_feet(loads, config, robot, share)


def _by_motion(evidence: Evidence, robot: RobotModel) -> Iterator[Finding]:
    """What is to be known where contact is by the motion of the feet."""
    joints, record = evidence.joints, evidence.foot_force
    has_force = record is not None and np.isfinite(record.force).any()
    if has_force or (joints is not None and np.isfinite(joints.effort).any()):
        return
    yield warning(
        "contact_kinematic",
        Stage.CONTACT,
        "joints",
        f"there are neither joint torques nor foot forces: which feet of {robot.description.name} stand is estimated "
        "from the motion of the feet and the IMU (contact.source = kinematic); record one of them for better contact",
    )


def _sensors(evidence: Evidence, robot: RobotModel) -> Iterator[Finding]:
    record, legs = evidence.foot_force, robot.leg_names
    if record is None or np.isnan(record.force).all():
        yield error(
            "contact_force_absent",
            Stage.CONTACT,
            "foot_force",
            "there are no foot forces, but contact.source is force_sensor: no foot is ever in stance; record them, "
            "or where joints have torques set robot.contact.source=torque with its thresholds, or kinematic",
        )
        return
    if len(record.force) < _LEAST_SAMPLES or not is_stepping(evidence, robot):
        return
    is_constant = _is_constant(record.force)
    if is_constant.all():
        yield error(
            "contact_force_constant",
            Stage.CONTACT,
            "foot_force",
            f"the forces of all {len(legs)} feet never change in {len(record.force):,} samples while the legs step: "
            "they are not measured; record them, or set robot.contact.source=torque with its thresholds",
        )
    elif is_constant.any():
        names = np.array(legs)[is_constant].tolist()
        value = float(np.nan_to_num(record.force[0, is_constant][0]))
        yield warning(
            "contact_force_constant",
            Stage.CONTACT,
            "foot_force",
            f"the force of foot {listing(names)} is {value:.4g} in all {len(record.force):,} samples while its leg "
            "steps: a dead sensor; repair it, or leave the leg out (dataset.corrections.joints.left_out)",
        )


def _loads(evidence: Evidence, robot: RobotModel, config: ContactConfig) -> _Loads | None:
    joints, record = evidence.joints, evidence.foot_force
    if config.source == "force_sensor":
        if record is None or len(record.force) < _LEAST_SAMPLES:
            return None
        rows = thinned(record.stamps_ns, _RATE_HZ, _SAMPLES)
        stamps, load, streams = record.stamps_ns[rows], record.force[rows], "foot_force"
    else:
        if joints is None or is_in_degrees(joints, robot) or silent(joints) is not None:
            return None
        if not are_usual(missing_factor(evidence, joints, robot)):
            return None  # torques of no use are reported as such
        load = vertical_loads(evidence, joints, robot)
        stamps, streams = joints.stamps_ns[-len(load) :], "joints"
    if np.isnan(load).all() or len(load) < _LEAST_SAMPLES:
        return None
    return _Loads(load, _stance(load, stamps, config, streams), streams)


def _stance(load: Array, stamps_ns: IntArray, config: ContactConfig, streams: str) -> BoolArray:
    if streams == "joints":  # these samples are too far apart for dwell times
        config = config.model_copy(update={"on_dwell_s": 0.0, "off_dwell_s": 0.0})
    detector = ContactDetector(config.by_load(), load.shape[1])
    pairs = zip(stamps_ns.tolist(), load, strict=True)
    return np.array([detector.update(stamp_ns, each).is_stance for stamp_ns, each in pairs])


def _is_constant(force: Array) -> BoolArray:
    has_reading = np.isfinite(force).any(axis=0)
    low, high = (np.where(has_reading, reduce(force, axis=0), 0.0) for reduce in (np.fmin.reduce, np.fmax.reduce))
    return np.asarray((low == high) & (np.isfinite(force).mean(axis=0) > 0.5))


def _thresholds(load: Array) -> tuple[float, float] | None:
    """Thresholds to try: shares of the way from the load in the air to that of a standing foot."""
    load = load[:, np.isfinite(load).any(axis=0)]
    air, loaded = (float(np.median(np.nanquantile(load, share, axis=0))) for share in (0.05, 0.9))
    if loaded <= 0.0 or loaded - air < 0.1 * loaded:
        return None
    air = max(air, 0.0)
    on, off = (float(f"{air + share * (loaded - air):.3g}") for share in _SHARES)
    return (on, off) if off < on else None


def _settings(load: Array) -> tuple[str, ...]:
    found = _thresholds(load)
    return () if found is None else (f"robot.contact.on_force={found[0]:g}", f"robot.contact.off_force={found[1]:g}")


def _never(loads: _Loads, config: ContactConfig, robot: RobotModel, *, steps: bool) -> Finding:
    low, high = (float(np.nanquantile(loads.load, share)) for share in (0.05, 0.95))
    said = (
        f"no foot is ever in stance in {len(loads.load):,} samples: the loads of the feet are {low:.3g} to {high:.3g} "
        f"(5 to 95 %), stance begins at contact.on_force = {config.on_force:g}"
    )
    weight = robot.mass_kg * GRAVITY_MPS2
    if not steps:  # it may lie, or hang
        text = f"{said}, and the legs do not step in that time: there is no leg odometry while the robot lies or hangs"
        return warning("contact_never", Stage.CONTACT, loads.streams, text)
    if low < -0.1 * config.on_force and abs(low) > 3.0 * high:
        if loads.streams == "joints":
            return error("contact_never", Stage.CONTACT, "joints", f"{said}; correct the torques (effort_factor)")
        setting = "dataset.corrections.foot_force.factor=-1"
        text = f"{said}: the forces have the opposite sign; set {setting}"
        return error("contact_never", Stage.CONTACT, loads.streams, text, setting, is_certain=True)
    settings = _settings(loads.load)
    cure = (
        f"set thresholds that these loads pass, such as {' and '.join(settings)}" if settings else "correct the sensors"
    )
    text = f"{said} (the robot weighs {weight:.0f} N); {cure}"
    return error("contact_never", Stage.CONTACT, loads.streams, text, *settings)


def _always(loads: _Loads, config: ContactConfig) -> Finding:
    low, high = (float(np.nanquantile(loads.load, share)) for share in (0.05, 0.95))
    settings = _settings(loads.load)
    cure = f"set thresholds between, such as {' and '.join(settings)}" if settings else "check the sensors"
    return error(
        "contact_always",
        Stage.CONTACT,
        loads.streams,
        f"all feet are in stance in all {len(loads.load):,} samples although the legs step: the loads of the feet are "
        f"{low:.3g} to {high:.3g} (5 to 95 %), stance ends below contact.off_force = {config.off_force:g}; {cure}",
        *settings,
    )


def _single_feet(loads: _Loads, config: ContactConfig, robot: RobotModel, share: Array) -> Iterator[Finding]:
    others = (share > _NEVER) & (share < _ALWAYS)
    if others.sum() < 0.5 * len(share):
        return
    for what, limit, is_so in (
        ("never", f"begins at contact.on_force = {config.on_force:g}", share < _NEVER),
        ("always", f"ends below contact.off_force = {config.off_force:g}", share > _ALWAYS),
    ):
        for leg in np.flatnonzero(is_so & np.isfinite(loads.load).any(axis=0) & ~_is_constant(loads.load)):
            low, high = np.nanquantile(loads.load[:, leg], (0.05, 0.95))
            yield warning(
                f"contact_foot_{what}",
                Stage.CONTACT,
                loads.streams,
                f"foot {robot.leg_names[leg]} is {what} in stance while the others step: its load is {low:.3g} to "
                f"{high:.3g} (5 to 95 %), stance {limit}; check its sensor, its leg's joints and the thresholds "
                "(robot.contact)",
            )
