# SPDX-License-Identifier: BSD-3-Clause
"""The KITTI odometry layout: rectified pairs of images numbered from zero, and three text files (``kitti_files``).

============================ =========================================================================================
``image_0``, ``image_1``     left, right camera, grey; otherwise ``image_2``, ``image_3`` (colour, turned to grey) or
                             ``image_l``, ``image_r``; files ``000000.png`` ..., named by frame number
``calib.txt``                the projections of the rectified cameras
``times.txt``                seconds; without it frames come at ``DatasetConfig.frame_rate_hz``
``poses.txt``                ground truth; otherwise ``poses/<sequence>.txt`` beside or above the folder
============================ =========================================================================================

The body is the benchmark's first camera (``P0``), with its axes x forward, y left, z up (REP 103); the world is the
frame of the body at the start of ``poses.txt``.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from coclo_vio.datasets import images, kitti_files
from coclo_vio.datasets.camera_axes import R_BODY_CAMERA
from coclo_vio.datasets.config import DatasetConfig
from coclo_vio.datasets.ground_truth import stamped_truth
from coclo_vio.datasets.image_pairs import ImagePair, read_bytes
from coclo_vio.datasets.read_report import ReadTally
from coclo_vio.datasets.recording_reader import RecordingReader
from coclo_vio.geometry import se3
from coclo_vio.robot.description import RobotDescription
from coclo_vio.values.arrays import BoolArray, IntArray
from coclo_vio.values.calibration import CameraCalibration, StereoCalibration, matrix4
from coclo_vio.values.errors import DatasetError, listing
from coclo_vio.values.trajectory import GroundTruth
from coclo_vio.values.units import NS_PER_S

LAYOUT = "image_0 and image_1 (or image_2 and image_3, image_l and image_r), calib.txt"
_SUFFIXES = (".png", ".jpg", ".jpeg")
_MAX_DIGITS = 9  # of a frame number; longer numbers are stamps
_T_BODY_CAMERA = se3.transform(R_BODY_CAMERA, np.zeros(3))


@dataclass(frozen=True, slots=True)
class CameraFolders:
    """Two folders of images, and the names of their cameras in ``calib.txt``."""

    left: str
    right: str
    left_projection: str
    right_projection: str


FOLDERS = (
    CameraFolders("image_0", "image_1", "P0", "P1"),
    CameraFolders("image_2", "image_3", "P2", "P3"),
    CameraFolders("image_l", "image_r", "P0", "P1"),
)


@dataclass(frozen=True, slots=True, eq=False)
class FrameClock:
    """Stamps of the frames: from ``times.txt``, or at a constant rate from zero.

    Attributes:
        rate_hz: the rate without times.
        times_ns: nanoseconds, (frames,), or None.
    """

    rate_hz: float
    times_ns: IntArray | None

    def has_stamp(self, numbers: IntArray) -> BoolArray:
        """Which of the frames (N,) have a stamp, (N,)."""
        return np.full(len(numbers), True) if self.times_ns is None else numbers < len(self.times_ns)

    def stamps_ns(self, numbers: IntArray) -> IntArray:
        """Stamps in nanoseconds of frames (N,) that have one."""
        if self.times_ns is not None:
            return self.times_ns[numbers]
        return np.array([round(int(number) * NS_PER_S / self.rate_hz) for number in numbers], dtype=np.int64)


class KittiOdometry(RecordingReader):
    """A sequence in the layout of the KITTI odometry benchmark."""

    format_name = "KITTI odometry"

    def __init__(self, path: Path, robot: RobotDescription | None, config: DatasetConfig) -> None:
        """Find the two folders of images; ``robot`` is not used, there are no joints.

        Raises:
            DatasetError: no complete pair of folders, or a list of times that cannot be read.
        """
        super().__init__(path.resolve().name, config)
        self._folder = path
        pairs = _pairs_of_folders(path)
        if not pairs:
            present = [name for pair in FOLDERS for name in (pair.left, pair.right) if (path / name).is_dir()]
            raise DatasetError(f"{path} has {listing(present)} but no pair of folders; a sequence has {LAYOUT}")
        self._read_pair, *self._unread_pairs = pairs
        times = path / "times.txt"
        self._clock = FrameClock(config.frame_rate_hz, kitti_files.read_times(times) if times.is_file() else None)

    def stereo_calibration(self) -> StereoCalibration | None:
        """The rectified pair in ``calib.txt``, or None without that file; the size is that of the first image.

        Raises:
            CalibrationMissing: the file lacks one of the two cameras.
            DatasetError: the file is malformed, or the first image cannot be read.
        """
        path = self._folder / "calib.txt"
        if not path.is_file():
            return None
        read = self._read_pair
        pair = kitti_files.read_pair(path, read.left_projection, read.right_projection)
        height_px, width_px = self._image_shape()
        (fx, _, cx), (_, fy, cy), _ = pair.camera_matrix.tolist()
        intrinsics = CameraCalibration.parse(
            {"width_px": width_px, "height_px": height_px, "focal_px": (fx, fy), "principal_point_px": (cx, cy)},
            str(path),
        )
        T_body_left = _T_BODY_CAMERA @ se3.transform(np.eye(3), pair.left_in_first)
        T_left_right = se3.transform(np.eye(3), np.array([pair.baseline_m, 0.0, 0.0]))
        return StereoCalibration(
            left=intrinsics,
            right=intrinsics,
            body_left_camera=matrix4(T_body_left),
            body_right_camera=matrix4(T_body_left @ T_left_right),
        )

    def _image_shape(self) -> tuple[int, int]:
        """Rows and columns of the first image of the left camera."""
        folder = self._folder / self._read_pair.left
        numbered = [(number, path) for number, path in _numbered(folder) if number is not None]
        if not numbered:
            raise DatasetError(f"{folder} holds no image named by a number, such as 000000.png")
        _, first = min(numbered)
        rows, columns = images.decoded(read_bytes(first), str(first)).shape
        return rows, columns

    def _cameras(self, tally: ReadTally) -> "_NumberedPairs":
        left, right = (self._folder / name for name in (self._read_pair.left, self._read_pair.right))
        for unread in self._unread_pairs:
            tally.note(f"{left.name} and {right.name} are read, {unread.left} and {unread.right} are not")
        if self._clock.times_ns is None:
            tally.note(
                f"times.txt is absent: the images are taken to be {self._clock.rate_hz:g} Hz, the first at 0 s "
                "(set dataset.frame_rate_hz to change this)"
            )
        if not (self._folder / "calib.txt").is_file():
            tally.note("calib.txt is absent: the cameras are not calibrated")
        tally.note("the body is the first camera (P0), its axes x forward, y left, z up; its tilt is unknown")
        return _NumberedPairs(left, right, self._clock)

    def _read_ground_truth(self, tally: ReadTally) -> GroundTruth | None:
        sequence = self._folder.resolve()
        candidates = (
            sequence / "poses.txt",
            sequence.parent / "poses" / f"{sequence.name}.txt",
            sequence.parent.parent / "poses" / f"{sequence.name}.txt",
        )
        path = next((candidate for candidate in candidates if candidate.is_file()), None)
        if path is None:
            return None
        T_first_camera = kitti_files.read_poses(path, tally)
        numbers = np.arange(len(T_first_camera))
        has_time = self._clock.has_stamp(numbers)
        if not has_time.all():
            tally.dropped["ground truth: pose without a line in times.txt"] += int((~has_time).sum())
        T_world_body = _T_BODY_CAMERA @ T_first_camera[has_time] @ se3.inverse(_T_BODY_CAMERA)
        return stamped_truth(self._clock.stamps_ns(numbers[has_time]), T_world_body, path.name, tally)


@dataclass(frozen=True, slots=True, eq=False)
class _NumberedPairs:
    """The images of two folders that have the same number."""

    left: Path
    right: Path
    clock: FrameClock

    def pairs(self, tally: ReadTally, config: DatasetConfig) -> list[ImagePair]:
        """The pairs by number, or sorted by stamp if so configured."""
        lefts, rights = (self._images(folder, tally) for folder in (self.left, self.right))
        for folder, alone in ((self.left, lefts.keys() - rights.keys()), (self.right, rights.keys() - lefts.keys())):
            if alone:
                tally.dropped[f"{folder.name}: no image of the other camera with this number"] += len(alone)
        numbers = np.array(sorted(lefts.keys() & rights.keys()), dtype=np.int64)
        has_time = self.clock.has_stamp(numbers)
        if not has_time.all():
            tally.dropped["stereo: image pair without a line in times.txt"] += int((~has_time).sum())
        numbers = numbers[has_time]
        stamps_ns = self.clock.stamps_ns(numbers).tolist()
        pairs = [ImagePair(at, lefts[n], rights[n]) for at, n in zip(stamps_ns, numbers.tolist(), strict=True)]
        return sorted(pairs, key=lambda pair: pair.stamp_ns) if config.sort else pairs

    @staticmethod
    def _images(folder: Path, tally: ReadTally) -> dict[int, Path]:
        found: dict[int, Path] = {}
        for number, path in _numbered(folder):
            if number is None or number in found:
                tally.dropped[f"{folder.name}: image name is not a number, or its number is repeated"] += 1
            else:
                found[number] = path
        return found


def is_kitti_odometry(path: Path) -> bool:
    """Whether ``path`` is a folder that holds the folder of a KITTI camera."""
    return any((path / name).is_dir() for pair in FOLDERS for name in (pair.left, pair.right))


def _pairs_of_folders(path: Path) -> list[CameraFolders]:
    return [pair for pair in FOLDERS if (path / pair.left).is_dir() and (path / pair.right).is_dir()]


def _numbered(folder: Path) -> Iterator[tuple[int | None, Path]]:
    """The image files by name, each with the number in its name, or None."""
    for path in sorted(folder.iterdir()):
        if path.suffix.lower() in _SUFFIXES:
            is_number = path.stem.isascii() and path.stem.isdigit() and len(path.stem) <= _MAX_DIGITS
            yield int(path.stem) if is_number else None, path
