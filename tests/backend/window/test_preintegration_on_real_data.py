# SPDX-License-Identifier: BSD-3-Clause
"""Preintegration of a real drone's IMU between the keyframes of EuRoC V1_01, against ground truth.

Estimated besides: one bias of gyroscope and accelerometer for all pairs and one constant rotation between
the axes of the truth and those of the IMU, nine numbers by least squares over 684 residuals. The truth's own attitude
is the weak side here: over half a second it departs from the gyroscope by 2 mrad (rms), fifteen times the gyroscope's
noise, whatever constant bias, scale and rotation are subtracted.
"""

from dataclasses import dataclass
from pathlib import Path

import gtsam
import numpy as np
import pytest
from scipy.optimize import least_squares

from coclo_vio.backend.window.config import InertialConfig
from coclo_vio.backend.window.inertial import Preintegration
from coclo_vio.geometry import se3, so3
from coclo_vio.values.arrays import Array
from coclo_vio.values.calibration import ImuCalibration
from coclo_vio.values.measurements import InertialReading
from coclo_vio.values.trajectory import Trajectory, read_tum

LONGEST_NS = 2_000_000_000
FITTED_NS = 50_000_000  # a cubic through the truth this far to both sides gives the velocity
TRUTH_SIGMAS = np.repeat([3e-3, 1e-3, 5e-3], 3)  # rad, m, m/s of one state, constant errors subtracted
ADIS16448 = ImuCalibration(
    gyroscope_noise_density=1.6968e-4,
    gyroscope_bias_walk=1.9393e-5,
    accelerometer_noise_density=2e-3,
    accelerometer_bias_walk=3e-3,
)


@dataclass(frozen=True, eq=False)
class State:
    """The truth at one time: T_world_body (4, 4), and velocity in the world, m/s, (3,)."""

    pose: Array
    velocity: Array

    def moved(self, by: Array) -> "State":
        """With [rotation rad body, position m world, velocity m/s world] (9,) added."""
        pose = se3.transform(self.pose[:3, :3] @ so3.exp(by[:3]), self.pose[:3, 3] + by[3:6])
        return State(pose, self.velocity + by[6:])


@dataclass(frozen=True, eq=False)
class Pair:
    """Two true states and the preintegrated readings between them."""

    first: State
    second: State
    measured: gtsam.PreintegratedCombinedMeasurements

    def residual(self, bias: Array, rotation: Array, moved: Array | None = None) -> Array:
        """[rotation, position, velocity] (9,) of the truth less the prediction, in the axes of the prediction.

        Args:
            bias: accelerometer, then gyroscope, (6,).
            rotation: rotation vector from the axes of the IMU to those of the truth, (3,).
            moved: changes of both states, (18,).
        """
        turn = np.concatenate((rotation, np.zeros(6)))
        first, second = self.first.moved(turn), self.second.moved(turn)
        if moved is not None:
            first, second = first.moved(moved[:9]), second.moved(moved[9:])
        start = gtsam.NavState(gtsam.Pose3(first.pose), first.velocity)
        end = self.measured.predict(start, gtsam.imuBias.ConstantBias(bias[:3], bias[3:]))
        T, velocity = np.asarray(end.pose().matrix()), np.asarray(end.velocity())
        off = se3.inverse(T) @ second.pose
        return np.concatenate((so3.log(off[:3, :3]), off[:3, 3], T[:3, :3].T @ (second.velocity - velocity)))

    def covariance(self, bias: Array, rotation: Array) -> Array:
        """Of the residual: that of the preintegration, and that of the truth, (9, 9)."""
        step = 1e-6
        still = self.residual(bias, rotation)
        columns = [(self.residual(bias, rotation, step * axis) - still) / step for axis in np.eye(18)]
        by_truth = np.stack(columns, axis=1) * np.tile(TRUTH_SIGMAS, 2)
        return np.array(self.measured.preintMeasCov())[:9, :9] + by_truth @ by_truth.T


def true_state(truth: Trajectory, stamp_ns: int) -> State | None:
    """A cubic through the truth around ``stamp_ns``; None where there is no truth on one side."""
    first, end = np.searchsorted(truth.stamps_ns, [stamp_ns - FITTED_NS, stamp_ns + FITTED_NS])
    if first == 0 or end >= len(truth):
        return None
    time_s = (truth.stamps_ns[first:end] - stamp_ns) / 1e9
    middle = truth.rotations[(first + end) // 2]
    turn = np.polynomial.polynomial.polyfit(time_s, so3.log(middle.T @ truth.rotations[first:end]), 3)
    path = np.polynomial.polynomial.polyfit(time_s, truth.positions[first:end], 3)
    return State(se3.transform(middle @ so3.exp(turn[0]), path[0]), path[1])


@pytest.fixture(scope="module")
def recording(shared_data: Path) -> tuple[list[InertialReading], Array, Trajectory]:
    """Readings, the stamps of the keyframes, and the truth."""
    folder = shared_data / "euroc_v1_01_keyframes"
    table = folder / "mav0/imu0/data.csv"
    stamps = np.loadtxt(table, delimiter=",", usecols=0, dtype=np.int64).tolist()
    values = np.loadtxt(table, delimiter=",", usecols=range(1, 7))
    readings = [InertialReading(stamp, row[:3], row[3:]) for stamp, row in zip(stamps, values, strict=True)]
    keyframes = np.loadtxt(folder / "mav0/cam0/data.csv", delimiter=",", usecols=0, dtype=np.int64)
    return readings, keyframes, read_tum(folder / "groundtruth.tum")


def pairs_of(recording: tuple[list[InertialReading], Array, Trajectory], config: InertialConfig) -> list[Pair]:
    """Neighbouring keyframes less than two seconds apart; the bias is near the mean rate of the drone at rest."""
    readings, keyframes, truth = recording
    stamps = np.array([each.stamp_ns for each in readings])
    bias = gtsam.imuBias.ConstantBias(np.zeros(3), np.mean([each.angular_velocity for each in readings[:200]], axis=0))
    pairs = []
    for start_ns, end_ns in zip(keyframes[:-1].tolist(), keyframes[1:].tolist(), strict=True):
        first, second = true_state(truth, start_ns), true_state(truth, end_ns)
        if end_ns - start_ns >= LONGEST_NS or first is None or second is None:
            continue
        motion = Preintegration(ADIS16448, config)
        begin, end = np.searchsorted(stamps, [start_ns, end_ns])
        for sample in readings[begin - 3 : end + 3]:
            if sample.stamp_ns > start_ns and motion.start_ns is None:
                motion.restart(start_ns, bias)
            motion.push(sample)
        assert motion.advance(end_ns)
        pairs.append(Pair(first, second, motion.measured))
    return pairs


def fitted(pairs: list[Pair]) -> tuple[Array, Array, list[Array]]:
    """Bias (6,), rotation (3,) and covariances that explain the pairs best."""
    bias, rotation = np.concatenate((np.zeros(3), pairs[0].measured.biasHat().gyroscope())), np.zeros(3)
    covariances = [pair.covariance(bias, rotation) for pair in pairs]
    whiten = [np.linalg.inv(np.linalg.cholesky(each)) for each in covariances]

    def cost(x: Array) -> Array:
        return np.concatenate([w @ pair.residual(x[:6], x[6:]) for w, pair in zip(whiten, pairs, strict=True)])

    found = least_squares(cost, np.concatenate((bias, rotation))).x
    return found[:6], found[6:], covariances


@pytest.mark.long
def test_preintegration_agrees_with_the_truth_and_its_noise_is_neither_too_small_nor_too_large(
    recording: tuple[list[InertialReading], Array, Trajectory],
) -> None:
    pairs = pairs_of(recording, InertialConfig())
    assert len(pairs) >= 70
    bias, rotation, covariances = fitted(pairs)
    np.testing.assert_allclose(bias[3:], [-0.0024, 0.0208, 0.0763], atol=1e-3)  # as the data set's own estimate
    assert np.linalg.norm(rotation) < np.deg2rad(3.0)
    errors = np.array([pair.residual(bias, rotation) for pair in pairs])
    in_sigmas = errors / np.sqrt([np.diag(each) for each in covariances])
    assert np.mean(np.abs(in_sigmas) < 3.0) > 0.95
    nees = [error @ np.linalg.solve(each, error) / 9.0 for error, each in zip(errors, covariances, strict=True)]
    assert 0.6 < np.mean(nees) < 1.6


@pytest.mark.long
def test_the_noise_of_the_data_sheet_alone_would_be_too_small(
    recording: tuple[list[InertialReading], Array, Trajectory],
) -> None:
    """Why the configuration has a lower bound: shocks and vibration are in no calibration."""
    nothing = InertialConfig(
        gyroscope_noise_density=0.0,
        accelerometer_noise_density=0.0,
        gyroscope_bias_walk=0.0,
        accelerometer_bias_walk=0.0,
    )
    pairs = pairs_of(recording, nothing)
    bias, rotation, covariances = fitted(pairs)
    errors = [pair.residual(bias, rotation) for pair in pairs]
    nees = [error @ np.linalg.solve(each, error) / 9.0 for error, each in zip(errors, covariances, strict=True)]
    assert np.mean(nees) > 1.8
