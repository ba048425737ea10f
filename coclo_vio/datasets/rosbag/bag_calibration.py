# SPDX-License-Identifier: BSD-3-Clause
"""Calibrations of a bag: mountings from static transforms, intrinsics from CameraInfo, noise from covariances.

Configured files of Kalibr take precedence over the bag.
"""

from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from coclo_vio.datasets.kalibr import KalibrCamera, KalibrImu, read_camchain, read_imu
from coclo_vio.datasets.read_report import ReadTally
from coclo_vio.datasets.rosbag.bag_preview import BagPreview
from coclo_vio.datasets.rosbag.calibration_conflicts import baseline_conflict, stereo_conflicts
from coclo_vio.datasets.rosbag.camera_info import T_camera_rectified, baseline_m, intrinsics_of
from coclo_vio.datasets.rosbag.config import RosbagConfig
from coclo_vio.datasets.rosbag.poses import FrameTree
from coclo_vio.geometry import se3
from coclo_vio.robot.description import RobotDescription
from coclo_vio.values.arrays import Array
from coclo_vio.values.calibration import CameraCalibration, ImuCalibration, StereoCalibration, matrix4
from coclo_vio.values.errors import CalibrationMissing, ConfigError

_PLAUSIBLE_DENSITY = {"gyroscope": (1e-6, 0.1), "accelerometer": (1e-5, 1.0)}  # noise densities, per sqrt(Hz)
_SAME_BASELINE = 0.03  # relative
_IMU_ROLES = {"imu": "the body's IMU", "camera_imu": "the camera's IMU"}


class BagCalibration:
    """Calibrations of the sensors from a bag and the files of Kalibr."""

    def __init__(
        self,
        preview: BagPreview,
        topics: dict[str, str | None],
        frames: FrameTree,
        robot: RobotDescription | None,
        config: RosbagConfig,
        tally: ReadTally,
    ) -> None:
        """Read the files of Kalibr.

        Args:
            preview: the first messages.
            topics: the topic of each role.
            frames: the static transforms.
            robot: its IMU calibration is used for values that the bag does not have.
            config: names the body's frame and the files.
            tally: gets a note on each assumption.

        Raises:
            CalibrationMissing: a file of Kalibr holds no calibration, contradicts itself, or is of another IMU.
            ConfigError: a file does not exist.
        """
        self._preview, self._topics, self._frames, self._config = preview, topics, frames, config
        self._robot_imu = ImuCalibration() if robot is None else robot.imu
        self._body = frames.body(config.body_frame, None if robot is None else robot.body_frame)
        self._tally = tally
        kalibr = config.kalibr
        self._camchain = () if kalibr.camchain is None else read_camchain(kalibr.camchain)
        self._kalibr_imu = None if kalibr.imu is None else read_imu(kalibr.imu)
        if self._kalibr_imu is not None:
            self._check_imu(self._kalibr_imu)

    def imu(self, role: str) -> ImuCalibration | None:
        """Mounting and noise of the IMU of a role, ``imu`` or ``camera_imu``; None without a calibration."""
        topic = self._topics[role]
        if topic is None:
            return None
        values = self._noise_of(topic, self._topics[f"{role}_acceleration"] or topic)
        if self._kalibr_imu is not None and self._config.kalibr.calibrated_imu == role:
            values |= self._kalibr_imu.noise
        T_body_imu = self._mounting_of_imu(role, topic)
        if T_body_imu is not None:
            values["position_body_m"] = tuple(T_body_imu[:3, 3].tolist())
            values["rotation_body_imu_rpy_rad"] = tuple(
                Rotation.from_matrix(T_body_imu[:3, :3]).as_euler("xyz").tolist()
            )
        elif role == "camera_imu":
            self._tally.note(f"the mounting of the camera's IMU {topic} is unknown: {self._no_transform(topic)}")
            return None
        if not values:
            return None
        base = self._robot_imu if role == "imu" else ImuCalibration()
        return ImuCalibration.parse(base.model_dump() | values, topic)

    def stereo(self) -> StereoCalibration | None:
        """Intrinsics and mountings of the two cameras, from the camchain or the bag; None where one is unknown.

        Raises:
            CalibrationMissing: the camchain has one camera, the mounting of its IMU is unknown, or a distortion model
                is not supported.
        """
        if self._topics["left_image"] is None or self._topics["right_image"] is None:
            return None
        return self._stereo_of_camchain() if self._camchain else self._stereo_of_bag()

    def conflicts(self) -> tuple[str, ...]:
        """Where two sources have different numbers for the cameras, a sentence each.

        Raises:
            CalibrationMissing: a calibration is malformed.
        """
        used = self.stereo()
        if used is None:
            return ()
        found: list[str] = []
        if self._camchain:
            tally, self._tally = self._tally, ReadTally("", 1.0)  # what the bag lacks is no matter then
            try:
                of_bag = self._stereo_of_bag()
            finally:
                self._tally = tally
            if of_bag is not None:
                found += stereo_conflicts(used, str(self._config.kalibr.camchain), of_bag, "CameraInfo and /tf_static")
        right = self._first("right_info")
        by_p = None if right is None or self._camchain else baseline_m(right)
        if by_p is not None and abs(used.baseline_m / max(abs(by_p), 1e-9) - 1.0) > _SAME_BASELINE:
            found.append(baseline_conflict(used.baseline_m, "the static transforms", by_p, "P of the CameraInfo"))
        return tuple(found)

    def _stereo_of_camchain(self) -> StereoCalibration:
        left, right = self._sides()
        T_body_imu = self._mounting_of_calibrated_imu(left)
        self._tally.note(
            f"cameras from {self._config.kalibr.camchain}, whose IMU is taken to be {_IMU_ROLES[self._role]} "
            "(dataset.rosbag.kalibr.calibrated_imu)"
        )
        values = {
            "left": left.intrinsics,
            "right": right.intrinsics,
            "body_left_camera": matrix4(T_body_imu @ se3.inverse(left.T_camera_imu)),
            "body_right_camera": matrix4(T_body_imu @ se3.inverse(right.T_camera_imu)),
            "time_offset_s": left.time_shift_s,
        }
        return _stereo(values, str(self._config.kalibr.camchain))

    def _stereo_of_bag(self) -> StereoCalibration | None:
        infos = [self._first(role) for role in ("left_info", "right_info")]
        if None in infos:
            self._tally.note(
                "no intrinsics: a CameraInfo is missing; name a camchain in dataset.rosbag.kalibr.camchain"
            )
            return None
        left, right = (self._intrinsics(side, info) for side, info in zip(("left", "right"), infos, strict=True))
        T_left, T_right = self._camera_mountings(*infos)
        if left is None or right is None or T_left is None or T_right is None:
            self._tally.note(
                "the intrinsics or mountings of the cameras are unknown: K is zero, or "
                f"{self._no_transform(self._topics['left_info'] or '')}; name a camchain in dataset.rosbag.kalibr"
            )
            return None
        values = {
            "left": left,
            "right": right,
            "body_left_camera": matrix4(T_left),
            "body_right_camera": matrix4(T_right),
        }
        return _stereo(values, f"{self._topics['left_info']} and {self._topics['right_info']}")

    def _first(self, role: str) -> Any | None:
        """The first message of a role, or None."""
        topic = self._topics[role]
        return None if topic is None else self._preview.first.get(topic)

    def _intrinsics(self, side: str, info: Any) -> CameraCalibration | None:
        return intrinsics_of(info, self._topics[f"{side}_info"] or "", is_rectified=self._is_rectified(side))

    def _is_rectified(self, side: str) -> bool:
        topic = self._topics[f"{side}_image"] or ""
        configured = self._config.is_rectified
        return "rect" in topic.replace("rect_raw", "") if configured is None else configured

    def _camera_mountings(self, left: Any, right: Any) -> tuple[Array | None, Array | None]:
        """``T_body_camera`` of both, the right one from the baseline in its P where its frame is unknown."""
        found = []
        for side, info in (("left", left), ("right", right)):
            T = self._frames.between(self._body, str(info.header.frame_id).lstrip("/"))
            if T is not None and self._is_rectified(side):
                T = T @ T_camera_rectified(info)
            found.append(T)
        T_left, T_right = found
        shares_frame = left.header.frame_id == right.header.frame_id
        baseline = baseline_m(right)
        if T_left is not None and baseline is not None and (T_right is None or shares_frame):
            beside = np.eye(4)
            beside[0, 3] = baseline
            T_right = T_left @ beside
        elif shares_frame:
            T_right = None
        return T_left, T_right

    @property
    def _role(self) -> str:
        return self._config.kalibr.calibrated_imu

    def _mounting_of_imu(self, role: str, topic: str) -> Array | None:
        """``T_body_imu`` by frame; of the camera's IMU otherwise from the camchain and the camera's frame."""
        T = self._frames.between(self._body, self._preview.frame(topic))
        if T is None and self._topics[f"{role}_acceleration"]:  # the two halves are in one housing
            T = self._frames.between(self._body, self._preview.frame(self._topics[f"{role}_acceleration"] or ""))
        if T is not None or not self._camchain or role != self._role:
            return T
        left, _ = self._sides()
        info = self._first("left_info")
        if info is None:
            return None
        T_body_left = self._frames.between(self._body, str(info.header.frame_id).lstrip("/"))
        return None if T_body_left is None else T_body_left @ left.T_camera_imu

    def _mounting_of_calibrated_imu(self, left: KalibrCamera) -> Array:
        topic = self._topics[self._role]
        T = None if topic is None else self._mounting_of_imu(self._role, topic)
        if T is None and self._role == "imu":
            return self._robot_imu.T_body_imu
        if T is None:
            raise CalibrationMissing(
                f"{self._config.kalibr.camchain} mounts the cameras on {_IMU_ROLES[self._role]}, whose own mounting on "
                f"the body is unknown: {self._no_transform(topic or '')}; if its IMU is the body's, set "
                "dataset.rosbag.kalibr.calibrated_imu=imu"
            )
        return T

    def _sides(self) -> tuple[KalibrCamera, KalibrCamera]:
        """The camchain's left and right camera: by its topics, otherwise cam0 is left and cam1 right."""
        if len(self._camchain) < 2:
            raise CalibrationMissing(
                f"{self._config.kalibr.camchain} has one camera; a stereo pair needs cam0 and cam1"
            )
        by_topic = {_base_topic(camera.topic): camera for camera in self._camchain if camera.topic}
        left, right = (by_topic.get(_base_topic(self._topics[f"{side}_image"] or "")) for side in ("left", "right"))
        if left is not None and right is not None:
            return left, right
        return self._camchain[0], self._camchain[1]

    def _check_imu(self, imu: KalibrImu) -> None:
        other = "camera_imu" if self._role == "imu" else "imu"
        if imu.topic and imu.topic == self._topics[other] and imu.topic != self._topics[self._role]:
            raise CalibrationMissing(
                f"{self._config.kalibr.imu} is of {imu.topic}, which is {_IMU_ROLES[other]}; "
                f"set dataset.rosbag.kalibr.calibrated_imu={other}"
            )

    def _noise_of(self, rate_topic: str, acceleration_topic: str) -> dict[str, Any]:
        """Noise densities from the covariances: the variance of a reading is density^2 times the rate."""
        values: dict[str, Any] = {}
        for topic, sensor, field in (
            (rate_topic, "gyroscope", "angular_velocity"),
            (acceleration_topic, "accelerometer", "linear_acceleration"),
        ):
            message, rate_hz = self._preview.first.get(topic), self._preview.rate_hz(topic)
            if message is None or rate_hz is None:  # none can be decoded, or too few
                continue
            variance = float(np.mean(getattr(message, f"{field}_covariance")[::4]))
            if not np.isfinite(variance) or variance <= 0.0:
                continue
            density = float(np.sqrt(variance / rate_hz))
            low, high = _PLAUSIBLE_DENSITY[sensor]
            if low <= density <= high:
                values[f"{sensor}_noise_density"] = density
            else:
                self._tally.note(
                    f"{topic}: the covariance of the {sensor} means {density:.3g} per sqrt(Hz), which is outside "
                    f"{low:g} to {high:g} and not used"
                )
        return values

    def _no_transform(self, topic: str) -> str:
        frame = self._preview.frame(topic) or "without a name"
        known = ", ".join(self._frames.frames) or "none"
        return f"no static transform from {self._body} to the frame {frame} (known frames: {known})"


def _stereo(values: dict[str, Any], source: str) -> StereoCalibration:
    try:
        return StereoCalibration.parse(values, source)
    except ConfigError as error:
        raise CalibrationMissing(f"{error}; correct it, or name another camchain in dataset.rosbag.kalibr") from error


def _base_topic(topic: str) -> str:
    """A topic without the suffix of image_transport."""
    return topic.removesuffix("/compressed")
