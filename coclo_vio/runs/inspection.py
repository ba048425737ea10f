# SPDX-License-Identifier: BSD-3-Clause
"""What a recording holds, and for which modes that is enough: the content of ``coclo-vio inspect``.

Everything is read through once; no image is decoded.
"""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Protocol, TypeVar, runtime_checkable

import numpy as np

from coclo_vio.datasets.config import DatasetConfig
from coclo_vio.datasets.dataset import Dataset, RobotFit, guess_robot, open_dataset, robot_fit
from coclo_vio.datasets.read_report import STREAM_NAMES, ReadReport
from coclo_vio.diagnosis.diagnose import Diagnosis
from coclo_vio.diagnosis.finding import Finding
from coclo_vio.evaluation.metrics import travelled_m
from coclo_vio.robot.description import RobotDescription, robot_names
from coclo_vio.robot.model import RobotModel
from coclo_vio.runs.mode_requirements import Holdings, camera_angle_deg, missing_needs
from coclo_vio.runs.modes.mode import Mode
from coclo_vio.runs.modes.registry import modes
from coclo_vio.runs.run_config import RunConfig, resolve
from coclo_vio.values.calibration import ImuCalibration, SensorCalibrations, StereoCalibration
from coclo_vio.values.errors import CocloError, DatasetError, TopicNotFound, listing
from coclo_vio.values.measurements import ALL_SENSORS, JointSample, StereoFrame
from coclo_vio.values.trajectory import GroundTruth

_PATH_SPACING_S = 0.1
_LONGEST_S = 30 * 24 * 3600  # a longer trajectory has a stamp that is wrong, and would be resampled for ever
_NOTED_ANGLE_DEG = 5.0
_NOT_READ_THROUGH = "a recording that can be read through (see problems)"
_T = TypeVar("_T")


@runtime_checkable
class HasTopics(Protocol):
    """A dataset whose sensors come from topics, and whose joints may be mapped to those of the robot."""

    def matched_joints(self) -> tuple[str, ...]:
        """The robot's joints that it has, by the robot's names."""

    def topics(self) -> Sequence[Any]:
        """The choices: objects with ``role``, ``topics``, ``msgtype``, ``reason`` and ``others``."""


@dataclass(frozen=True, slots=True)
class Topic:
    """What plays a role, and why.

    Attributes:
        role: such as ``imu``.
        topics: the topics chosen, none where there is none.
        msgtype: their type.
        reason: why these.
        others: further topics of a type that fits, which play no role.
    """

    role: str
    topics: tuple[str, ...]
    msgtype: str
    reason: str
    others: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Joints:
    """How the recording's joints fit the robot.

    Attributes:
        matched: joints of the robot that the recording has.
        missing: joints of the robot, or where none is named of the nearest, that it has not.
        there: all joints of the recording, by its own names.
        fitting: the known robots all of whose joints it has.
        nearest: where none fits, the known robot most of whose joints it has, or None.
        has_effort: whether any torque is measured.
    """

    matched: tuple[str, ...]
    missing: tuple[str, ...]
    there: tuple[str, ...]
    fitting: tuple[str, ...]
    nearest: str | None
    has_effort: bool

    @property
    def hint(self) -> str:
        """What to give where no robot is named."""
        if self.nearest is not None:
            return f"{len(self.missing)} of {self.nearest}'s joints, or another robot (--robot)"
        if not self.there:
            return "joints"
        fits = f"fit {listing(self.fitting)}" if self.fitting else "are those of no known one"
        return f"a robot (the joints {fits}; name one with --robot)"


@dataclass(frozen=True, slots=True)
class Truth:
    """The reference trajectory.

    Attributes:
        source: the file or topic.
        has_stamps: whether its poses have stamps.
        poses: how many.
        duration_s: from the first to the last, s; None without stamps.
        path_length_m: what was travelled, m; positions are averaged over 0.1 s first where they have stamps.
    """

    source: str
    has_stamps: bool
    poses: int
    duration_s: float | None
    path_length_m: float


@dataclass(frozen=True, slots=True)
class Inspection:
    """All that is known of a recording.

    Attributes:
        name: of the recording.
        robot: name of the robot whose joints were looked for, None where none is known.
        report: streams, what was left out, notes.
        topics: which topic plays which role; empty for a format without topics.
        joints: how they fit the robot.
        calibrations: by sensor, what is known of it in a sentence, None where the recording has none.
        ground_truth: the reference trajectory, None where there is none.
        problems: what could not be read, a sentence each.
        missing: by mode, what it lacks; nothing for a mode that is ready.
        findings: what physics, the recording itself or the robot's description contradict.
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
    findings: tuple[Finding, ...] = ()

    def to_json(self) -> dict[str, Any]:
        """The same as plain values, with each mode's ``ready``."""
        values = {**asdict(self), "findings": [finding.to_json() for finding in self.findings]}
        modes = {mode: {"ready": not lacks, "missing": list(lacks)} for mode, lacks in values.pop("missing").items()}
        return {**values, "modes": modes}


def resolve_if_known(
    path: Path, robot: str | RobotDescription | None, file: Path | None, settings: Sequence[str]
) -> tuple[RunConfig, RobotDescription | None]:
    """The configuration for a recording, and its robot, None where none is named and no known one fits.

    Args:
        path: the recording.
        robot: name or YAML file of the robot, or its description.
        file: YAML configuration.
        settings: ``a.b=value`` strings.

    Raises:
        DatasetError: no recording.
        ConfigError: an unknown robot or key, a value out of bounds, or changes to a robot that is not known.
    """
    guess = None
    if robot is None:
        any_robot = robot_names()[0]  # settings may name keys of a robot; only those of the dataset are used
        guess = guess_robot(path, resolve(None, file, settings, any_robot).dataset)
    config = resolve(robot, file, settings, guess)
    return config, config.robot


def inspect_recording(
    path: Path,
    robot: RobotDescription | None,
    config: DatasetConfig,
    diagnosed: Callable[[Dataset], Diagnosis] | None = None,
) -> Inspection:
    """Read a recording through and describe it.

    What cannot be read (joints of another robot, stamps that go back, a calibration that is malformed) is listed as a
    problem, as far as the rest can be read without it.

    Args:
        path: the recording.
        robot: whose joints to look for, None where it is not known.
        config: how to read.
        diagnosed: carries out the checks on the recording; none if None.

    Raises:
        DatasetError: no recording, or one that cannot be read at all.
    """
    problems: list[str] = []
    dataset = _opened(path, robot, config, problems)
    has_effort, broken = _read_through(dataset)
    if broken is not None:
        problems.append(str(broken))
        has_effort = has_effort or _read_through(_opened_in_part(path, robot, config), is_for_effort=True)[0]
    calibrations = _calibrations(dataset, problems)
    joints = _joints(robot_fit(path, config), robot, dataset, has_effort=has_effort)
    report = dataset.report()  # what was assumed of a calibration is part of it
    truth = _truth(_tried(dataset.ground_truth, problems))
    holdings = Holdings(
        robot=robot,
        report=report,
        missing_joints=joints.missing,
        has_joints=bool(joints.matched),
        has_effort=has_effort,
        calibrations=calibrations,
        allows_partial=config.allow_partial,
        robot_hint=joints.hint,
        fits_urdf=robot is None or _tried(lambda: RobotModel(robot), problems) is not None,
    )
    stopped = broken is not None and not isinstance(broken, TopicNotFound)
    findings = () if diagnosed is None else diagnosed(dataset).findings
    return Inspection(
        name=dataset.name,
        robot=None if robot is None else robot.name,
        report=report,
        topics=_topics(dataset),
        joints=joints,
        calibrations=_calibration_sentences(calibrations),
        ground_truth=truth,
        problems=tuple(dict.fromkeys(problems)),
        missing=_missing(holdings, findings, config, stopped=stopped),
        findings=findings,
    )


def _missing(
    holdings: Holdings, findings: Sequence[Finding], config: DatasetConfig, *, stopped: bool
) -> dict[str, tuple[str, ...]]:
    """By mode, what it lacks."""
    first = (_NOT_READ_THROUGH,) if stopped else ()
    return {
        mode.name: (*first, *missing_needs(mode, holdings), *_contradicted(mode, findings, config))
        for mode in modes().values()
    }


def _contradicted(mode: Mode, findings: Sequence[Finding], config: DatasetConfig) -> tuple[str, ...]:
    """What a mode reads that cannot be right, as something that it lacks."""
    read = {STREAM_NAMES[sensor] for sensor in mode.sensors}
    wrong = {stream for finding in findings if finding.is_error for stream in finding.streams & read}
    return () if config.allow_partial or not wrong else (f"right readings of {listing(wrong)} (see findings)",)


def _calibration_sentences(calibrations: SensorCalibrations) -> dict[str, str | None]:
    """By sensor, what is known of it."""
    return {
        "imu": _imu_sentence(calibrations.imu),
        "camera_imu": _imu_sentence(calibrations.camera_imu),
        "cameras": _stereo_sentence(calibrations.stereo),
    }


def _calibrations(dataset: Dataset, problems: list[str]) -> SensorCalibrations:
    return SensorCalibrations(
        stereo=_tried(dataset.stereo_calibration, problems),
        imu=_tried(dataset.imu_calibration, problems),
        camera_imu=_tried(dataset.camera_imu_calibration, problems),
    )


def _opened(path: Path, robot: RobotDescription | None, config: DatasetConfig, problems: list[str]) -> Dataset:
    """The recording; in part where it lacks joints of the robot, which is a problem then."""
    try:
        return open_dataset(path, robot, config)
    except TopicNotFound as error:
        if robot is None:
            raise
        problems.append(str(error))
        return _opened_in_part(path, robot, config)


def _opened_in_part(path: Path, robot: RobotDescription | None, config: DatasetConfig) -> Dataset:
    """The recording with what joints of the robot it has; without them where its format does not know that."""
    try:
        return open_dataset(path, robot, config.model_copy(update={"allow_partial": True}))
    except TopicNotFound:
        return open_dataset(path, None, config)


def _read_through(dataset: Dataset, *, is_for_effort: bool = False) -> tuple[bool, DatasetError | None]:
    """Read all but the images; whether any joint torque was measured, and what stopped the reading."""
    has_effort = False
    try:
        for sample in dataset.measurements(ALL_SENSORS - {StereoFrame}):
            if not has_effort and isinstance(sample, JointSample):
                has_effort = bool(np.isfinite(sample.effort).any())
                if has_effort and is_for_effort:
                    break
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
    choices = dataset.topics()
    taken = {topic for choice in choices for topic in choice.topics}
    return tuple(
        Topic(one.role, tuple(one.topics), one.msgtype, one.reason, tuple(t for t in one.others if t not in taken))
        for one in choices
    )


def _joints(fit: RobotFit, robot: RobotDescription | None, dataset: Dataset, *, has_effort: bool) -> Joints:
    if robot is None:
        missing = () if fit.nearest is None else fit.absent[fit.nearest]
        return Joints((), missing, fit.joints, fit.fitting, fit.nearest, has_effort)
    matched = dataset.matched_joints() if isinstance(dataset, HasTopics) else fit.matched(robot)
    missing = tuple(joint for joint in robot.joint_names if joint not in matched)
    return Joints(matched, missing, fit.joints, fit.fitting, fit.nearest, has_effort)


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
    apart = f", axes {camera_angle_deg(stereo):.0f} deg apart" if camera_angle_deg(stereo) > _NOTED_ANGLE_DEG else ""
    return (
        f"{left.width_px} x {left.height_px}, f {left.focal_px[0]:.1f} px, {lens}, "
        f"baseline {stereo.baseline_m:.4f} m{apart}"
    )


def _truth(truth: GroundTruth | None) -> Truth | None:
    if truth is None:
        return None
    trajectory = truth.trajectory
    duration_s = trajectory.duration_s if truth.has_stamps else None
    is_paced = truth.has_stamps and len(trajectory) > 1 and trajectory.duration_s < _LONGEST_S
    path_m = float(travelled_m(trajectory, _PATH_SPACING_S)[-1]) if is_paced else trajectory.path_length_m()
    return Truth(truth.source, truth.has_stamps, len(trajectory), duration_s, path_m)
