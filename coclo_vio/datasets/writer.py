# SPDX-License-Identifier: BSD-3-Clause
"""Writers of recordings: a leg-log folder and an EuRoC-style folder; ``rosbag.writing`` writes bags.

Every reading is written with all digits of its float (``repr``), so that a log that is read back is equal value by
value; ``nan`` is a failed reading, an empty cell means that a sensor has no sample. Encoded images are written as they
are.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import TextIO

import numpy as np

from coclo_vio.datasets import euroc_sensor
from coclo_vio.datasets.image_pairs import CAMERAS
from coclo_vio.datasets.images import suffix_of
from coclo_vio.datasets.recording_contents import RecordingContents
from coclo_vio.datasets.sequencer import order_key
from coclo_vio.geometry import so3
from coclo_vio.robot.description import RobotDescription
from coclo_vio.values.arrays import Array
from coclo_vio.values.errors import DatasetError
from coclo_vio.values.measurements import (
    CameraImuSample,
    EncodedStereoFrame,
    FootForceSample,
    ImuSample,
    JointSample,
    Measurement,
    StereoFrame,
)
from coclo_vio.values.trajectory import GroundTruth, Trajectory, write_tum

_IMU_COLUMNS = (*(f"gyro_{axis}_radps" for axis in "xyz"), *(f"accel_{axis}_mps2" for axis in "xyz"))
_EUROC_IMU_COLUMNS = (
    *(f"w_RS_S_{axis} [rad s^-1]" for axis in "xyz"),
    *(f"a_RS_S_{axis} [m s^-2]" for axis in "xyz"),
)
_POSE_COLUMNS = ("x", "y", "z", "qx", "qy", "qz", "qw")
_EUROC_POSE_COLUMNS = (*(f"p_RS_R_{axis} [m]" for axis in "xyz"), *(f"q_RS_{axis} []" for axis in "wxyz"))
_SENSORS: Mapping[type, str] = {
    FootForceSample: "foot_force0",
    ImuSample: "imu0",
    CameraImuSample: "imu1",
    JointSample: "joints0",
}


@dataclass(frozen=True, slots=True)
class RecordedJoints:
    """Which of the joints' readings are written; columns that are left out are read back as absent.

    Attributes:
        with_velocity: whether velocities are.
        with_effort: whether torques are.
        with_feet: whether a bag holds the foot forces as further entries of the joints' message, as the logs of a Go1
            do, and not on topics of their own.
    """

    with_velocity: bool = True
    with_effort: bool = True
    with_feet: bool = False

    def columns(self, robot: RobotDescription) -> list[str]:
        """Column names: all angles, all velocities, all torques."""
        kinds = ["position", *(["velocity"] if self.with_velocity else []), *(["effort"] if self.with_effort else [])]
        return [f"{joint}.{kind}" for kind in kinds for joint in robot.joint_names]

    def cells_of(self, sample: Measurement) -> list[str]:
        """The cells of a sample: of joints those of ``columns``, of the other sensors all."""
        match sample:
            case FootForceSample():
                arrays = [sample.force]
            case ImuSample() | CameraImuSample():
                arrays = [sample.angular_velocity, sample.specific_force]
            case JointSample():
                velocity = [sample.velocity] if self.with_velocity else []
                arrays = [sample.position, *velocity, *([sample.effort] if self.with_effort else [])]
            case StereoFrame():
                raise DatasetError("a decoded image cannot be a row of a table; pass encoded images as `frames`")
        return [cell for array in arrays for cell in _cells(array)]


ALL_JOINT_READINGS = RecordedJoints()


def write_leg_log(
    folder: Path,
    robot: RobotDescription,
    measurements: Iterable[Measurement],
    ground_truth: GroundTruth | None = None,
    *,
    joints: RecordedJoints = ALL_JOINT_READINGS,
) -> Path:
    """Write ``leg_log.csv`` with the canonical columns, and the ground truth beside it.

    Ground truth goes to ``groundtruth.tum`` (12 digits), or to ``mocap.csv`` where it has no stamps.

    Returns:
        The path of the log.

    Raises:
        DatasetError: the folder cannot be written, or the measurements hold what a leg log has no column for.
    """
    path = folder / "leg_log.csv"
    headers = _headers(robot, _IMU_COLUMNS, joints)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with path.open("w", encoding="ascii", newline="\n") as out:
            out.write(_line(["stamp_ns", *chain.from_iterable(headers.values())]))
            for row in _rows(measurements):
                cells = {type(sample): joints.cells_of(sample) for sample in row}
                if not cells.keys() <= headers.keys():
                    raise DatasetError("a leg log cannot hold the sensors of a camera; write an EuRoC folder or a bag")
                blanks = {kind: [""] * len(names) for kind, names in headers.items()}
                out.write(_line([str(row[0].stamp_ns), *chain.from_iterable((blanks | cells).values())]))
        if ground_truth is not None:
            _write_leg_log_truth(folder, ground_truth)
    except OSError as error:
        raise DatasetError(f"cannot write {folder}: {error.strerror}; choose another folder") from error
    return path


def write_euroc_folder(
    folder: Path, contents: RecordingContents, *, joints: RecordedJoints = ALL_JOINT_READINGS
) -> Path:
    """Write ``mav0``: a folder for each sensor that has samples, its calibration, and the ground truth.

    Encoded images are written as they are, named by their stamp.

    Args:
        folder: the parent of ``mav0``; made if needed.
        contents: what to write; streamed.
        joints: which of the joints' readings to write.

    Returns:
        The path of ``mav0``.

    Raises:
        DatasetError: ``mav0`` exists already; the folder cannot be written; or the ground truth has no stamps, which
            the layout requires.
    """
    truth = contents.ground_truth
    if truth is not None and not truth.has_stamps:
        raise DatasetError("an EuRoC folder cannot hold ground truth without stamps; write a leg log instead")
    mav0 = folder / "mav0"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        mav0.mkdir()
        _write_euroc_samples(mav0, contents, joints)
        _write_euroc_images(mav0, contents.frames)
        _write_euroc_calibrations(mav0, contents)
        if truth is not None:
            _write_euroc_truth(mav0 / "state_groundtruth_estimate0", truth.trajectory)
    except FileExistsError as error:
        raise DatasetError(f"{error.filename} exists already; delete it, or choose another folder") from error
    except OSError as error:
        raise DatasetError(f"cannot write {folder}: {error.strerror}; choose another folder") from error
    return mav0


def _write_euroc_samples(mav0: Path, contents: RecordingContents, joints: RecordedJoints) -> None:
    headers = _headers(contents.robot, _EUROC_IMU_COLUMNS, joints) | {CameraImuSample: _EUROC_IMU_COLUMNS}
    with ExitStack() as stack:
        files: dict[type, TextIO] = {}
        for sample in contents.measurements:
            kind, cells = type(sample), joints.cells_of(sample)
            if kind not in files:
                files[kind] = stack.enter_context(_open_csv(mav0 / _SENSORS[kind], headers[kind]))
            files[kind].write(_line([str(sample.stamp_ns), *cells]))


def _write_euroc_images(mav0: Path, frames: Iterable[EncodedStereoFrame]) -> None:
    with ExitStack() as stack:
        files: list[TextIO] = []
        for frame in frames:
            if not files:
                files = [stack.enter_context(_open_csv(mav0 / camera, ["filename"])) for camera in CAMERAS]
                for camera in CAMERAS:
                    (mav0 / camera / "data").mkdir()
            name = f"{frame.stamp_ns}{suffix_of(frame.encoding)}"
            for camera, file, data in zip(CAMERAS, files, (frame.left, frame.right), strict=True):
                (mav0 / camera / "data" / name).write_bytes(data)
                file.write(_line([str(frame.stamp_ns), name]))


def _write_euroc_calibrations(mav0: Path, contents: RecordingContents) -> None:
    for sensor, imu in (("imu0", contents.imu), ("imu1", contents.camera_imu)):
        if imu is not None:
            euroc_sensor.write_imu(mav0 / sensor, imu)
    stereo = contents.stereo
    if stereo is not None:
        cameras = (stereo.left, stereo.right)
        mountings = (stereo.T_body_left_camera, stereo.T_body_right_camera)
        for name, intrinsics, T_body_camera in zip(CAMERAS, cameras, mountings, strict=True):
            euroc_sensor.write_camera(mav0 / name, intrinsics, T_body_camera, stereo.time_offset_s)


def _rows(measurements: Iterable[Measurement]) -> Iterator[list[Measurement]]:
    """Samples that share a row: of one stamp, and in the order in which a row is read back."""
    row: list[Measurement] = []
    for sample in measurements:
        if row and (sample.stamp_ns != row[-1].stamp_ns or order_key(sample) <= order_key(row[-1])):
            yield row
            row = []
        row.append(sample)
    if row:
        yield row


def _write_leg_log_truth(folder: Path, ground_truth: GroundTruth) -> None:
    if ground_truth.has_stamps:
        write_tum(ground_truth.trajectory, folder / "groundtruth.tum")
        return
    poses = _poses_xyzw(ground_truth.trajectory)
    with (folder / "mocap.csv").open("w", encoding="ascii", newline="\n") as out:
        out.write(_line(_POSE_COLUMNS))
        out.writelines(_line(_cells(pose)) for pose in poses)


def _write_euroc_truth(folder: Path, trajectory: Trajectory) -> None:
    poses = _poses_xyzw(trajectory)[:, [0, 1, 2, 6, 3, 4, 5]]
    columns = list(_EUROC_POSE_COLUMNS)
    if trajectory.velocity_world is not None:
        poses = np.hstack((poses, trajectory.velocity_world))
        columns += [f"v_RS_R_{axis} [m s^-1]" for axis in "xyz"]
    with _open_csv(folder, columns) as out:
        for stamp_ns, pose in zip(trajectory.stamps_ns, poses, strict=True):
            out.write(_line([str(int(stamp_ns)), *_cells(pose)]))


def _open_csv(folder: Path, columns: Iterable[str]) -> TextIO:
    """``data.csv`` of a sensor, with its header written."""
    folder.mkdir(parents=True, exist_ok=True)
    out = (folder / "data.csv").open("w", encoding="ascii", newline="\n")
    out.write(_line(["#timestamp [ns]", *columns]))
    return out


def _headers(robot: RobotDescription, imu: Sequence[str], joints: RecordedJoints) -> dict[type, Sequence[str]]:
    """Column names by sensor, in the order of a row."""
    return {
        FootForceSample: [f"{leg}.force" for leg in robot.leg_names],
        ImuSample: imu,
        JointSample: joints.columns(robot),
    }


def _poses_xyzw(trajectory: Trajectory) -> Array:
    """[x y z qx qy qz qw] (N, 7)."""
    return np.hstack((trajectory.positions, so3.to_quat_xyzw(trajectory.rotations)))


def _cells(values: Array) -> list[str]:
    return [repr(value) for value in values.tolist()]


def _line(cells: Iterable[str]) -> str:
    return ",".join(cells) + "\n"
