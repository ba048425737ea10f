# SPDX-License-Identifier: BSD-3-Clause
"""What a recording holds, and for which modes that is enough: what ``coclo-vio inspect`` says.

Everything is read through once; no image is decoded.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Protocol, TypeVar, runtime_checkable

import numpy as np

from coclo_vio.calibration import ImuCalibration, StereoCalibration
from coclo_vio.datasets.columns import Header
from coclo_vio.datasets.config import DatasetConfig
from coclo_vio.datasets.dataset import FORMATS, Dataset, guess_robot, open_dataset
from coclo_vio.datasets.report import ReadReport, StreamReport
from coclo_vio.errors import CocloError, ConfigError, DatasetError, TopicNotFound, listing
from coclo_vio.measurements import ALL_SENSORS, JointSample, StereoFrame
from coclo_vio.robot.description import RobotDescription, load_robot, robot_names
from coclo_vio.run_config import RunConfig, resolve
from coclo_vio.trajectory import GroundTruth

MODES = ("coclo", "vins", "stereo", "combined")

_NS_PER_S = 1_000_000_000
_T = TypeVar("_T")


@runtime_checkable
class HasTopics(Protocol):
    """A dataset whose sensors come from topics."""

    def topics(self) -> Sequence[Any]:
        """The choices: objects with ``role``, ``topics``, ``msgtype`` and ``reason``."""


@dataclass(frozen=True, slots=True)
class Topic:
    """What plays a role, and why.

    Attributes:
        role: such as ``imu``.
        topics: the topics chosen, none where there is none.
        msgtype: their type.
        reason: why these.
    """

    role: str
    topics: tuple[str, ...]
    msgtype: str
    reason: str


@dataclass(frozen=True, slots=True)
class Joints:
    """How the recording's joints fit the robot.

    Attributes:
        matched: joints of the robot that the recording has.
        missing: joints of the robot that it has not.
        fitting: the known robots all of whose joints it has.
        has_effort: whether any torque is measured.
    """

    matched: tuple[str, ...]
    missing: tuple[str, ...]
    fitting: tuple[str, ...]
    has_effort: bool


@dataclass(frozen=True, slots=True)
class Truth:
    """The reference trajectory.

    Attributes:
        source: the file or topic.
        has_stamps: whether its poses have stamps.
        poses: how many.
        duration_s: from the first to the last, s; None without stamps.
        path_length_m: sum of its steps, m.
    """

    source: str
    has_stamps: bool
    poses: int
    duration_s: float | None
    path_length_m: float


@dataclass(frozen=True, slots=True)
class Inspection:
    """All that can be said of a recording.

    Attributes:
        name: of the recording.
        robot: name of the robot whose joints were looked for, None where none is known.
        report: streams, what was left out, notes.
        topics: which topic plays which role; empty for a format without topics.
        joints: how they fit the robot.
        calibrations: by sensor, what is known of it in a sentence, None where the recording says nothing.
        ground_truth: the reference trajectory, None where there is none.
        problems: what could not be read, a sentence each.
        missing: by mode, what it lacks; nothing for a mode that is ready.
    """

    name: str
    robot: str | None
    report: ReadReport
    topics: tuple[Topic, ...]
    joints: Joints
    calibrations: dict[str, str | None]
    ground_truth: Truth | None
    problems: tuple[str, ...]
    missing: dict[str, tuple[str, ...]]

    def to_json(self) -> dict[str, Any]:
        """The same as plain values, with each mode's ``ready``."""
        values = asdict(self)
        modes = {mode: {"ready": not lacks, "missing": list(lacks)} for mode, lacks in values.pop("missing").items()}
        return {**values, "modes": modes}


def resolve_if_known(
    path: Path, robot: str | None, file: Path | None, settings: Sequence[str]
) -> tuple[RunConfig, RobotDescription | None]:
    """The configuration for a recording, and its robot, None where nobody names one and no known one fits.

    Args:
        path: the recording.
        robot: name or YAML file of the robot.
        file: YAML configuration.
        settings: ``a.b=value`` strings.

    Raises:
        DatasetError: no recording.
        ConfigError: an unknown robot or key, or a value out of bounds.
    """
    any_robot = robot_names()[0]
    guess = None
    if robot is None:
        guess = guess_robot(path, resolve(None, file, settings, any_robot).dataset)
    try:
        config = resolve(robot, file, settings, guess)
    except ConfigError:
        if robot is not None or guess is not None:  # otherwise the one thing wrong is that there is no robot
            raise
        return resolve(None, file, settings, any_robot), None
    return config, config.robot


def inspect_recording(path: Path, robot: RobotDescription | None, config: DatasetConfig) -> Inspection:
    """Read a recording through and say what it holds.

    What cannot be read (joints of another robot, stamps that go back, a calibration that is malformed) is told as a
    problem, as far as the rest can be read without it.

    Args:
        path: the recording.
        robot: whose joints to look for, None where it is not known.
        config: how to read.

    Raises:
        DatasetError: no recording, or one of which nothing can be told.
    """
    problems: list[str] = []
    try:
        dataset = open_dataset(path, robot, config)
    except TopicNotFound as error:
        if robot is None:
            raise
        problems.append(str(error))
        dataset = open_dataset(path, None, config)
    has_effort, broken = _read_through(dataset)
    report = dataset.report()
    joints = _joints(path, robot, config, has_effort=has_effort, is_whole=not problems and broken is None)
    problems += [] if broken is None else [str(broken)]
    lenses = _tried(dataset.stereo_calibration, problems)
    seen = Inspection(
        name=dataset.name,
        robot=None if robot is None else robot.name,
        report=report,
        topics=_topics(dataset),
        joints=joints,
        calibrations={
            "imu": _imu_sentence(_tried(dataset.imu_calibration, problems)),
            "camera_imu": _imu_sentence(_tried(dataset.camera_imu_calibration, problems)),
            "cameras": _stereo_sentence(lenses),
        },
        ground_truth=_truth(_tried(dataset.ground_truth, problems)),
        problems=tuple(dict.fromkeys(problems)),
        missing=_missing(robot, report, joints, has_lenses=lenses is not None, takes_part=config.allow_partial),
    )
    if broken is None or isinstance(broken, TopicNotFound):
        return seen
    stopped = ("a recording that can be read through (see problems)",)
    return replace(seen, missing={mode: stopped + lacks for mode, lacks in seen.missing.items()})


def _read_through(dataset: Dataset) -> tuple[bool, DatasetError | None]:
    """Read all but the images; whether any joint torque was measured, and what stopped the reading."""
    has_effort = False
    try:
        for sample in dataset.measurements(ALL_SENSORS - {StereoFrame}):
            if not has_effort and isinstance(sample, JointSample):
                has_effort = bool(np.isfinite(sample.effort).any())
    except DatasetError as error:
        return has_effort, error
    return has_effort, None


def _tried(read: Callable[[], _T | None], problems: list[str]) -> _T | None:
    """What ``read`` gives; None where it fails, and why goes to ``problems``."""
    try:
        return read()
    except CocloError as error:
        problems.append(str(error))
        return None


def _topics(dataset: Dataset) -> tuple[Topic, ...]:
    if not isinstance(dataset, HasTopics):
        return ()
    return tuple(Topic(one.role, tuple(one.topics), one.msgtype, one.reason) for one in dataset.topics())


def _joints(
    path: Path, robot: RobotDescription | None, config: DatasetConfig, *, has_effort: bool, is_whole: bool
) -> Joints:
    """``is_whole``: everything was read with the robot's joints, so they are all there, by whatever name."""
    kind = next(candidate for candidate in FORMATS if candidate.matches(path))
    file, names = kind.joint_header(path, config.columns)
    header = Header(file, names, config.columns)
    found = {name: header.find_joints(load_robot(name)) for name in robot_names()}
    fitting = tuple(name for name, columns in found.items() if None not in columns)
    if robot is None:
        return Joints((), (), fitting, has_effort)
    if is_whole and not config.allow_partial and names:
        return Joints(robot.joint_names, (), fitting, has_effort)
    columns = header.find_joints(robot)
    matched = tuple(joint for joint, column in zip(robot.joint_names, columns, strict=True) if column is not None)
    missing = tuple(joint for joint in robot.joint_names if joint not in matched)
    return Joints(matched, missing, fitting, has_effort)


def _imu_sentence(imu: ImuCalibration | None) -> str | None:
    if imu is None:
        return None
    x, y, z = imu.position_body_m
    noise = f"gyroscope {imu.gyroscope_noise_density:.2g} rad/s/sqrt(Hz), accelerometer "
    return f"at ({x:.3f}, {y:.3f}, {z:.3f}) m, {noise}{imu.accelerometer_noise_density:.2g} m/s^2/sqrt(Hz)"


def _stereo_sentence(stereo: StereoCalibration | None) -> str | None:
    if stereo is None:
        return None
    left = stereo.left
    lens = "no distortion" if left.distortion == "none" else f"{left.distortion} distortion"
    return (
        f"{left.width_px} x {left.height_px}, f {left.focal_px[0]:.1f} px, {lens}, baseline {stereo.baseline_m:.4f} m"
    )


def _truth(truth: GroundTruth | None) -> Truth | None:
    if truth is None:
        return None
    trajectory = truth.trajectory
    duration_s = trajectory.duration_s if truth.has_stamps else None
    return Truth(truth.source, truth.has_stamps, len(trajectory), duration_s, trajectory.path_length_m())


def _missing(
    robot: RobotDescription | None, report: ReadReport, joints: Joints, *, has_lenses: bool, takes_part: bool
) -> dict[str, tuple[str, ...]]:
    """What each mode lacks of what it cannot do without; ``takes_part``: legs whose joints are missing are left out."""
    streams = {stream.name: stream for stream in report.streams}
    legs = tuple(_missing_legs(robot, streams, joints, takes_part=takes_part))
    wanted = (("stereo images", "stereo" in streams), ("calibration of the cameras", has_lenses))
    eyes = tuple(what for what, is_there in wanted if not is_there)
    inertial = () if {"imu", "camera_imu"} & set(streams) else ("an IMU",)
    eye_imu = "camera_imu" if "camera_imu" in streams else "imu"
    return {
        "coclo": legs + _apart(streams, "joints", "imu"),
        "vins": eyes + inertial + _apart(streams, "stereo", eye_imu),
        "stereo": eyes,
        "combined": legs + eyes + _apart(streams, "joints", "imu") + _apart(streams, "joints", "stereo"),
    }


def _missing_legs(
    robot: RobotDescription | None, streams: dict[str, StreamReport], joints: Joints, *, takes_part: bool
) -> Iterator[str]:
    if robot is None:
        several = f" (its joints fit {listing(joints.fitting)}; name one with --robot)" if joints.fitting else ""
        yield f"a known robot{several}" if several else "joints of a known robot"
    elif joints.missing and not (takes_part and joints.matched):
        yield f"{len(joints.missing)} of {robot.name}'s {len(robot.joint_names)} joints"
    elif "joints" not in streams:
        yield "joint samples"
    elif robot.contact.source == "torque" and not joints.has_effort:
        yield f"joint torques, from which {robot.name}'s contacts are told"
    elif robot.contact.source == "force_sensor" and "foot_force" not in streams:
        yield f"foot forces, from which {robot.name}'s contacts are told"
    if "imu" not in streams:
        yield "the body's IMU"


def _apart(streams: dict[str, StreamReport], one: str, other: str) -> tuple[str, ...]:
    """A sentence where two streams were never recorded at the same time."""
    if one not in streams or other not in streams:
        return ()
    start_ns = max(streams[one].start_ns, streams[other].start_ns)
    end_ns = min(streams[one].end_ns, streams[other].end_ns)
    apart_s = (start_ns - end_ns) / _NS_PER_S
    return (f"{one} and {other} at one time: their stamps are {apart_s:.3g} s apart",) if apart_s > 0.0 else ()
