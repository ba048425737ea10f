# SPDX-License-Identifier: BSD-3-Clause
"""The smoother's factors, all of them GTSAM's own: observations, motion, priors. A ``Term`` is one with its keys."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import gtsam
import numpy as np

from coclo_vio.backend.window.config import PixelNoiseConfig
from coclo_vio.backend.window.pixel_noise import PixelNoise
from coclo_vio.backend.window.variables import BIASES, LANDMARK, POSE, VELOCITY
from coclo_vio.values.arrays import Array
from coclo_vio.values.calibration import RectifiedStereo
from coclo_vio.values.keyframes import PoseEvidence

_UNKNOWN_MPS2 = 1e3  # of an accelerometer's bias, on which a standstill alone holds no information
_FIRST_LANDMARK = LANDMARK.key(0)

pose_key = POSE.key  # of a keyframe's pose, by the keyframe's number
velocity_key = VELOCITY.key
bias_key = BIASES.key


def landmark_key(landmark_id: int) -> int:
    """The key of a landmark."""
    return _FIRST_LANDMARK + landmark_id


def landmark_id(key: int) -> int | None:
    """The landmark with this key; None where it is the key of something else."""
    return key - _FIRST_LANDMARK if gtsam.Symbol(key).chr() == ord(LANDMARK.letter) else None


def ordered(keys: Sequence[int]) -> gtsam.Ordering:
    """Keys as GTSAM's ordering."""
    ordering = gtsam.Ordering()
    for key in keys:
        ordering.push_back(key)
    return ordering


@dataclass(frozen=True, slots=True, eq=False)
class Term:
    """A factor and the keys of its variables."""

    factor: Any
    keys: tuple[int, ...]


class ObservationFactors:
    """Makes factors of observations: stereo where both cameras observe the point, a projection where the left one does.

    Left pixel and disparity are independent, so the two columns are not: a track that drifts moves both.
    """

    def __init__(self, rig: RectifiedStereo, noise: PixelNoiseConfig | PixelNoise) -> None:
        self._rig = rig
        (fx, fy), (cx, cy) = rig.focal_px, rig.principal_point_px
        self._stereo = gtsam.Cal3_S2Stereo(fx, fy, 0.0, cx, cy, rig.baseline_m)
        self._mono = gtsam.Cal3_S2(fx, fy, 0.0, cx, cy)
        self._T_body_camera = gtsam.Pose3(rig.T_body_camera)
        self._noise, self._made_with = noise, (0.0, 0.0)
        self._made: dict[int, dict[int, Term]] = {}  # by keyframe and landmark

    def checkpoint_fields(self) -> dict[str, Any]:
        """What a checkpoint keeps: not the factors, they are made again of the observations."""
        return {"rig": self._rig, "noise": self._noise}

    def restore_fields(self, fields: dict[str, Any]) -> None:
        """Take what a checkpoint kept."""
        ObservationFactors.__init__(self, **fields)

    def term(self, landmark_id: int, number: int, observation: Array, *, is_first: bool) -> Term:
        """The same as ``make``, which is asked once as long as the noise is the same."""
        if self._made_with != (self._noise.track_px, self._noise.huber):
            self._set_noise()
        made = self._made.setdefault(number, {})
        term = made.get(landmark_id)
        if term is None:
            term = made[landmark_id] = self.make(number, landmark_id, observation, is_first=is_first)
        return term

    def forget(self, number: int, landmark_id: int | None = None) -> None:
        """Forget the factor of an observation, or all those of a keyframe: they are removed, or change."""
        if landmark_id is None:
            self._made.pop(number, None)
        else:
            self._made.get(number, {}).pop(landmark_id, None)

    def make(self, number: int, landmark_id: int, observation: Array, *, is_first: bool) -> Term:
        """The factor of an observation (left column, row, right column or NaN), px, (3,)."""
        if self._made_with != (self._noise.track_px, self._noise.huber):
            self._set_noise()
        pose, point = pose_key(number), landmark_key(landmark_id)
        left, row, right = (float(value) for value in observation)
        if np.isnan(right):
            factor: Any = gtsam.GenericProjectionFactorCal3_S2(
                np.array([left, row]), self._mono_noise, pose, point, self._mono, self._T_body_camera
            )
        else:
            noise = self._first_noise if is_first else self._repeated_noise
            factor = gtsam.GenericStereoFactor3D(
                gtsam.StereoPoint2(left, right, row), noise, pose, point, self._stereo, self._T_body_camera
            )
        return Term(factor, (pose, point))

    def _set_noise(self) -> None:
        """Take over the noise as it is now; factors with another one are forgotten."""
        noise = self._noise
        huber = gtsam.noiseModel.mEstimator.Huber.Create(noise.huber)
        self._first_noise = _robust(huber, noise.track_px, noise.disparity_px)
        self._repeated_noise = _robust(huber, noise.track_px, noise.repeated_disparity_px)
        left_only = gtsam.noiseModel.Isotropic.Sigma(2, noise.track_px)
        self._mono_noise = gtsam.noiseModel.Robust.Create(huber, left_only)
        self._made_with = noise.track_px, noise.huber
        self._made.clear()


def _robust(huber: Any, track_px: float, disparity_px: float) -> Any:
    """Noise of [left column, right column, row]: left pixel and disparity are independent, the columns are not."""
    track, disparity = track_px**2, disparity_px**2
    covariance = np.array([[track, track, 0.0], [track, track + disparity, 0.0], [0.0, 0.0, track]])
    return gtsam.noiseModel.Robust.Create(huber, gtsam.noiseModel.Gaussian.Covariance(covariance))


def relative_pose(start: int, end: int, T_start_end: Array, covariance: Array) -> Term:
    """The motion between two keyframes, with the covariance (6, 6) of its right/local error."""
    keys = (pose_key(start), pose_key(end))
    noise = gtsam.noiseModel.Gaussian.Covariance(covariance)
    return Term(gtsam.BetweenFactorPose3(*keys, gtsam.Pose3(T_start_end), noise), keys)


def evidence(start: int, end: int, poses: PoseEvidence) -> Term | None:
    """Evidence of two keyframes, linear at its own poses; None where it holds no information."""
    rows, measured = poses.rows()
    if not len(rows):
        return None
    keys = (pose_key(start), pose_key(end))
    linearised_at = gtsam.Values()
    linearised_at.insert(keys[0], gtsam.Pose3(poses.T_world_start))
    linearised_at.insert(keys[1], gtsam.Pose3(poses.T_world_end))
    unit = gtsam.noiseModel.Unit.Create(len(rows))
    linear = gtsam.JacobianFactor(keys[0], rows[:, :6], keys[1], rows[:, 6:], measured, unit)
    return Term(gtsam.LinearContainerFactor(linear, linearised_at), keys)


def pose_prior(number: int, T_world_body: Array, covariance: Array) -> Term:
    """A keyframe's pose, with the covariance (6, 6) of its right/local error."""
    key = pose_key(number)
    noise = gtsam.noiseModel.Gaussian.Covariance(covariance)
    return Term(gtsam.PriorFactorPose3(key, gtsam.Pose3(T_world_body), noise), (key,))


def velocity_prior(number: int, velocity_world: Array, sigma_mps: float) -> Term:
    """A keyframe's velocity, m/s, (3,)."""
    key = velocity_key(number)
    noise = gtsam.noiseModel.Isotropic.Sigma(3, sigma_mps)
    return Term(gtsam.PriorFactorVector(key, velocity_world, noise), (key,))


def bias_prior(number: int, accelerometer: Array, gyroscope: Array, sigmas: Array) -> Term:
    """A keyframe's biases, m/s^2 and rad/s, imu frame; ``sigmas`` (6,), accelerometer first."""
    key = bias_key(number)
    mean = gtsam.imuBias.ConstantBias(accelerometer, gyroscope)
    return Term(gtsam.PriorFactorConstantBias(key, mean, gtsam.noiseModel.Diagonal.Sigmas(sigmas)), (key,))


def rest(number: int, speed_mps: float, rate: Array, sigma_radps: float) -> tuple[Term, Term]:
    """A keyframe at rest: zero velocity with its sigma, m/s, and the gyroscope's bias, rad/s, (3,), with its own."""
    sigmas = np.repeat([_UNKNOWN_MPS2, sigma_radps], 3)
    return velocity_prior(number, np.zeros(3), speed_mps), bias_prior(number, np.zeros(3), rate, sigmas)


def inertial(start: int, end: int, measured: Any) -> Term:
    """The preintegrated readings between two keyframes, with the random walk of the biases."""
    poses = (pose_key(start), velocity_key(start), pose_key(end), velocity_key(end))
    biases = (bias_key(start), bias_key(end))
    return Term(gtsam.CombinedImuFactor(*poses, *biases, measured), poses + biases)
