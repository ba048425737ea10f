# SPDX-License-Identifier: BSD-3-Clause
"""Stereo tracks in a MATLAB file: observations of landmarks and the body's twist, no images.

========================== ===========================================================================================
``t``                      stamps of the K frames, s
``y_k_j``                  (4, K, landmarks) px: uL, vL, uR, vR in rectified images; negative where not observed
``fu fv cu cv b``          focal lengths and principal point, px; baseline, m
``C_c_v``, ``rho_v_c_v``   maps vehicle axes to the left camera's, (3, 3); its position on the vehicle, (3, 1) m
``v_vk_vk_i``,             velocity (m/s) and angular velocity (rad/s) of the vehicle in its own axes, (3, K or more)
``w_vk_vk_i``
``r_i_vk_i``,              ground truth: position of the vehicle, m, and its rotation vector, rad, (3, K or more):
``theta_vk_i``             ``R_world_vehicle = exp(theta)``, of which ``C_vk_i`` is the inverse
========================== ===========================================================================================

The layout is that of Barfoot's course on state estimation and of Clement et al., "The battle for filter supremacy: a
comparative study of the multi-state constraint Kalman filter and the sliding window filter", CRV 2015. The signs were
determined on its three recordings: see docs/recordings.md. The body is the vehicle, with its axes renamed where they
are not x forward, y left, z up.
"""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from coclo_vio.datasets import mat_file
from coclo_vio.datasets.camera_axes import nearest_body_axes
from coclo_vio.datasets.config import DatasetConfig
from coclo_vio.datasets.ground_truth import stamped_truth
from coclo_vio.datasets.landmark_observations import LandmarkObservations
from coclo_vio.datasets.read_report import ReadTally
from coclo_vio.datasets.recording_reader import RecordingReader
from coclo_vio.datasets.sequencer import merge_streams
from coclo_vio.geometry import se3, so3
from coclo_vio.robot.description import RobotDescription
from coclo_vio.values.arrays import Array, IntArray
from coclo_vio.values.calibration import CameraCalibration, StereoCalibration, matrix4
from coclo_vio.values.errors import CalibrationMissing, DatasetError, TimestampError, listing
from coclo_vio.values.measurements import BodyTwistSample, Measurement
from coclo_vio.values.trajectory import GroundTruth
from coclo_vio.values.units import NS_PER_S

LAYOUT = "a MATLAB file (.mat) with y_k_j and t"
_TRACKS = ("t", "y_k_j")
_PINHOLE = ("fu", "fv", "cu", "cv", "b")
_MOUNTING = ("C_c_v", "rho_v_c_v")
_TRUTH = ("r_i_vk_i", "theta_vk_i")
_TWIST = ("v_vk_vk_i", "w_vk_vk_i")
_NOISE = ("y_var", "v_var", "w_var")
_ALL_BUT_TRACKS = ("t", *_PINHOLE, *_MOUNTING, *_TRUTH, *_TWIST, *_NOISE)
_ROTATION_TOLERANCE = 1e-3
_MAX_STAMP_S = 9.2e9  # 64-bit nanoseconds


class StereoTrackFile(RecordingReader):
    """A recording of stereo tracks."""

    format_name = "stereo tracks"

    def __init__(self, path: Path, robot: RobotDescription | None, config: DatasetConfig) -> None:
        """Read the stamps; ``robot`` is not used, there are no joints.

        Raises:
            DatasetError: the file cannot be read, or lacks the tracks or their stamps; lists its arrays.
            TimestampError: a stamp is not finite, or beyond 64-bit nanoseconds.
        """
        super().__init__(path.stem, config)
        self._path = path
        self._names = mat_file.variable_names(path)
        missing = self._missing(_TRACKS)
        if missing:
            raise DatasetError(
                f"{path} has no {listing(missing)}, so it is not a file of stereo tracks; its arrays are "
                f"{listing(self._names)}; copy it again if it was cut off"
            )
        self._arrays = mat_file.read_arrays(path, [name for name in _ALL_BUT_TRACKS if name in self._names])
        self._stamps_ns = _stamps_ns(path, self._arrays["t"].ravel())
        self._order = np.arange(len(self._stamps_ns))
        if config.sort:
            self._order = np.argsort(self._stamps_ns, kind="stable")
        self._observations: LandmarkObservations | None = None

    def stereo_calibration(self) -> StereoCalibration | None:
        """The rectified pair, or None where the file has no calibration.

        Raises:
            CalibrationMissing: it has a part of the calibration only.
            DatasetError: a value of the calibration is invalid.
        """
        missing = self._missing(_PINHOLE + _MOUNTING)
        if len(missing) == len(_PINHOLE + _MOUNTING):
            return None
        if missing:
            raise CalibrationMissing(f"{self._path} has no {listing(missing)}; its arrays are {listing(self._names)}")
        fu, fv, cu, cv, baseline_m = (self._number(name) for name in _PINHOLE)
        for name, value in (("fu", fu), ("fv", fv), ("b", baseline_m)):
            if value <= 0.0:
                raise DatasetError(f"{self._path}: {name} = {value} must be positive; correct it in the file")
        width_px, height_px = self._image_size(cu, cv)
        intrinsics = CameraCalibration.parse(
            {"width_px": width_px, "height_px": height_px, "focal_px": (fu, fv), "principal_point_px": (cu, cv)},
            str(self._path),
        )
        R_body_vehicle = self._rotation_vehicle_body().T
        camera_in_vehicle = self._arrays["rho_v_c_v"].ravel()
        if len(camera_in_vehicle) != 3 or not np.isfinite(camera_in_vehicle).all():
            raise DatasetError(
                f"{self._path}: rho_v_c_v must be three finite numbers, it is {camera_in_vehicle.tolist()}"
            )
        T_body_left = se3.transform(
            R_body_vehicle @ self._rotation_vehicle_camera(), R_body_vehicle @ camera_in_vehicle
        )
        T_left_right = se3.transform(np.eye(3), np.array([baseline_m, 0.0, 0.0]))
        return StereoCalibration(
            left=intrinsics,
            right=intrinsics,
            body_left_camera=matrix4(T_body_left),
            body_right_camera=matrix4(T_body_left @ T_left_right),
        )

    def _samples(self, tally: ReadTally) -> Iterator[Measurement]:
        self._describe(tally)
        tracks = self._read_observations().tracks(self._order, self._stamps_ns)
        return merge_streams([self._twists(tally), tracks])

    def _twists(self, tally: ReadTally) -> Iterator[BodyTwistSample]:
        if self._missing(_TWIST):
            return
        R_vehicle_body = self._rotation_vehicle_body()
        velocity, rate = (self._columns(name) @ R_vehicle_body for name in _TWIST)
        for frame in self._order[self._order < min(len(velocity), len(rate))]:
            if np.isfinite(velocity[frame]).all() and np.isfinite(rate[frame]).all():
                yield BodyTwistSample(int(self._stamps_ns[frame]), rate[frame], velocity[frame])
            else:
                tally.dropped["body twist: NaN"] += 1

    def _read_ground_truth(self, tally: ReadTally) -> GroundTruth | None:
        if self._missing(_TRUTH):
            return None
        position, rotation = (self._columns(name) for name in _TRUTH)
        frames = self._order[self._order < min(len(position), len(rotation))]
        if len(frames) < len(self._order):
            tally.note(f"ground truth ends before the tracks: {len(frames)} poses for {len(self._order)} frames")
        R_world_body = so3.exp(rotation[frames]) @ self._rotation_vehicle_body()
        poses = se3.transform(R_world_body, position[frames])
        starts_at_body = len(frames) and np.allclose(poses[0], np.eye(4), atol=1e-6)
        world = "the first pose of the body, whose tilt is unknown" if starts_at_body else "the file's inertial frame"
        tally.note(f"the world frame of the ground truth is {world}")
        return stamped_truth(self._stamps_ns[frames], poses, self._path.name, tally)

    def _describe(self, tally: ReadTally) -> None:
        """Note the assumptions, and what of the file is not read."""
        moved = int((np.diff(self._stamps_ns) < 0).sum())
        if self._config.sort and moved:
            tally.note(f"{moved} frames were older than the one before them: all frames were sorted by time")
        if self._missing(_TWIST):
            tally.note(f"no body twist: the file has no {listing(self._missing(_TWIST))}")
        frames = len(self._stamps_ns)
        per_frame = [name for name in (*_TRUTH, *_TWIST) if name in self._names]
        longer = [name for name in per_frame if len(self._columns(name)) > frames]
        if longer:
            tally.note(f"{listing(longer)} continue after the last of the {frames} frames: left out, without stamps")
        if np.array_equal(self._rotation_vehicle_body(), np.eye(3)):
            tally.note("the body is the vehicle of the file")
        else:
            tally.note(
                "the body is the vehicle of the file with its axes renamed: x along the optical axis of the camera, "
                "z up in its image"
            )
        noise = [name for name in _NOISE if name in self._names]
        if noise:
            values = ", ".join(f"{name} = {self._arrays[name].ravel().round(4).tolist()}" for name in noise)
            tally.note(f"variances in the file are not used: {values}")
        if not self._missing(_PINHOLE):
            tally.note(
                "the file has no image size: the smallest with all tracks and a central principal point is assumed"
            )

    def _read_observations(self) -> LandmarkObservations:
        if self._observations is None:
            table = mat_file.read_arrays(self._path, ["y_k_j"])["y_k_j"]
            if table.ndim == 2:  # MATLAB drops a last dimension of size one
                table = table[:, :, None]
            frames = len(self._stamps_ns)
            if table.ndim != 3 or table.shape[:2] != (4, frames):
                raise DatasetError(
                    f"{self._path}: y_k_j must have shape (4, {frames}, landmarks) for the {frames} stamps of t, "
                    f"it has {table.shape}"
                )
            self._observations = LandmarkObservations.of(table)
        return self._observations

    def _image_size(self, cu: float, cv: float) -> tuple[int, int]:
        """The smallest width and height that hold all tracks and twice the principal point."""
        left_right = np.nan_to_num(self._read_observations().pixels, nan=0.0).reshape(-1, 2)
        across, down = left_right.max(axis=0, initial=0.0)
        return int(np.ceil(max(across + 1.0, 2.0 * cu))), int(np.ceil(max(down + 1.0, 2.0 * cv)))

    def _rotation_vehicle_camera(self) -> Array:
        C_c_v = self._arrays["C_c_v"]
        if C_c_v.shape != (3, 3) or not np.allclose(C_c_v @ C_c_v.T, np.eye(3), atol=_ROTATION_TOLERANCE):
            raise DatasetError(f"{self._path}: C_c_v must be a rotation (3 x 3), it is {C_c_v.tolist()}")
        if np.linalg.det(C_c_v) < 0.0:
            raise DatasetError(f"{self._path}: C_c_v is a reflection; its determinant must be 1")
        return so3.exp(so3.log(C_c_v.T))

    def _rotation_vehicle_body(self) -> Array:
        return np.eye(3) if "C_c_v" not in self._names else nearest_body_axes(self._rotation_vehicle_camera())

    def _columns(self, name: str) -> Array:
        """The columns of a (3, N) array as rows (N, 3)."""
        array = self._arrays[name]
        if array.ndim != 2 or array.shape[0] != 3:
            raise DatasetError(
                f"{self._path}: {name} must have 3 rows and a column for each frame, its shape is {array.shape}"
            )
        return array.T

    def _number(self, name: str) -> float:
        array = self._arrays[name]
        if array.size != 1 or not np.isfinite(array).all():
            raise DatasetError(f"{self._path}: {name} must be one finite number, it is {array.tolist()}")
        return float(array.item())

    def _missing(self, names: tuple[str, ...]) -> list[str]:
        return [name for name in names if name not in self._names]


def is_stereo_track_file(path: Path) -> bool:
    """Whether ``path`` is a MATLAB file."""
    return path.is_file() and path.suffix.lower() == ".mat"


def _stamps_ns(path: Path, seconds: Array) -> IntArray:
    """Nanoseconds (N,) of seconds (N,); converting whole seconds separately keeps the digits of the fraction."""
    bad = np.flatnonzero(~(np.abs(seconds) < _MAX_STAMP_S))
    if len(bad):
        raise TimestampError(f"{path}: t has {seconds[bad[0]]} s at frame {bad[0] + 1}; stamps must be finite")
    if not len(seconds):
        raise TimestampError(f"{path}: t is empty; it must hold the seconds of the frames")
    whole = np.floor(seconds)
    return whole.astype(np.int64) * NS_PER_S + np.rint((seconds - whole) * NS_PER_S).astype(np.int64)
