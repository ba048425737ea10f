# SPDX-License-Identifier: BSD-3-Clause
"""Observations as factors: the noise of the stereo model, and GTSAM's derivatives with a mounted camera."""

import gtsam
import numpy as np
import pytest
from worlds import RIG

from coclo_vio.backend.window import factors
from coclo_vio.backend.window.config import PixelNoiseConfig
from coclo_vio.backend.window.factors import ObservationFactors
from coclo_vio.backend.window.stereo_model import StereoModel
from coclo_vio.geometry import se3

NOISE = PixelNoiseConfig(track_px=0.8, disparity_px=0.5, repeated_disparity_px=2.0, huber=1.3)
AS_FIRST = NOISE.model_copy(update={"repeated_disparity_px": NOISE.disparity_px})
POSE = se3.exp(np.array([0.3, -0.2, 0.9, 1.0, -2.0, 0.4]))
POINT = se3.apply(POSE @ RIG.T_body_camera, np.array([0.4, -0.3, 3.0]))
PROJECTED = StereoModel(RIG, NOISE).project(POSE, POINT[None])[0]
OFF = np.array([0.7, -0.5, 0.3])


def values(pose: np.ndarray = POSE, point: np.ndarray = POINT) -> gtsam.Values:
    holds = gtsam.Values()
    holds.insert(factors.pose_key(3), gtsam.Pose3(pose))
    holds.insert(factors.landmark_key(7), point)
    return holds


def cost(term: factors.Term) -> float:
    return float(term.factor.error(values()))


def huber(norm: float) -> float:
    k = NOISE.huber
    return 0.5 * norm**2 if norm <= k else k * (norm - 0.5 * k)


@pytest.mark.parametrize("scale", [0.3, 1.0, 4.0], ids=["small", "near the threshold", "large"])
@pytest.mark.parametrize("is_first", [True, False])
def test_the_cost_of_an_observation_is_that_of_the_stereo_model(is_first: bool, scale: float) -> None:
    observation = PROJECTED + scale * OFF
    model = StereoModel(RIG, AS_FIRST if is_first else NOISE)
    norm = model.residual_norms(observation[None] - model.project(POSE, POINT[None]))[0]
    term = ObservationFactors(RIG, NOISE).make(3, 7, observation, is_first=is_first)
    assert cost(term) == pytest.approx(huber(norm), rel=1e-9)


def test_an_observation_of_the_left_camera_alone_costs_the_same_as_there() -> None:
    observation = np.array([PROJECTED[0] + 0.7, PROJECTED[1] - 0.5, np.nan])
    model = StereoModel(RIG, NOISE)
    norm = model.residual_norms(observation[None] - model.project(POSE, POINT[None]))[0]
    term = ObservationFactors(RIG, NOISE).make(3, 7, observation, is_first=False)
    assert cost(term) == pytest.approx(huber(norm), rel=1e-9)


def test_a_drifting_track_moves_both_columns() -> None:
    """Both columns off by 2 px leave the disparity as it is: 2 / 0.8 sigmas of the track and no more."""
    make = ObservationFactors(RIG, NOISE.model_copy(update={"huber": 50.0})).make
    together = make(3, 7, PROJECTED + np.array([2.0, 0.0, 2.0]), is_first=True)
    assert cost(together) == pytest.approx(0.5 * (2.0 / 0.8) ** 2)
    right_only = make(3, 7, PROJECTED + np.array([0.0, 0.0, 2.0]), is_first=True)
    assert cost(right_only) == pytest.approx(0.5 * (2.0 / 0.5) ** 2)


@pytest.mark.parametrize("right", [PROJECTED[2], np.nan], ids=["stereo", "left alone"])
@pytest.mark.parametrize("pose", [POSE, np.eye(4)], ids=["generic", "no rotation"])
def test_derivatives_with_a_mounted_camera_are_right(pose: np.ndarray, right: float) -> None:
    point = se3.apply(pose @ RIG.T_body_camera, np.array([0.4, -0.3, 3.0]))
    projected = StereoModel(RIG, NOISE).project(pose, point[None])[0]
    observation = np.array([*projected[:2], projected[2] if np.isfinite(right) else np.nan]) + 1e-9
    term = ObservationFactors(RIG, NOISE).make(3, 7, observation, is_first=True)
    linear = term.factor.linearize(values(pose, point))
    jacobian, _ = linear.jacobian()

    def whitened(step: np.ndarray) -> np.ndarray:
        moved = values(pose @ se3.exp(step[:6]), point + step[6:])
        _, minus_error = term.factor.linearize(moved).jacobian()
        return -minus_error

    step = 1e-6
    columns = [(whitened(step * axis) - whitened(-step * axis)) / (2.0 * step) for axis in np.eye(9)]
    order = np.concatenate(
        [np.arange(6) if key == factors.pose_key(3) else np.arange(6, 9) for key in linear.keys()]  # noqa: SIM118
    )
    np.testing.assert_allclose(jacobian, np.stack(columns, axis=1)[:, order], rtol=1e-6, atol=1e-5)


def test_a_relative_pose_is_at_its_minimum_where_it_was_measured() -> None:
    delta = se3.exp(np.array([0.1, 0.2, -0.1, 0.5, 0.1, 0.0]))
    covariance = np.diag(np.square([0.01, 0.02, 0.03, 0.1, 0.2, 0.3]))
    term = factors.relative_pose(3, 4, delta, covariance)
    holds = values()
    holds.insert(factors.pose_key(4), gtsam.Pose3(POSE @ delta))
    assert term.factor.error(holds) == pytest.approx(0.0, abs=1e-20)
    holds.update(factors.pose_key(4), gtsam.Pose3(POSE @ delta @ se3.exp(np.array([0, 0, 0, 0.2, 0, 0]))))
    assert term.factor.error(holds) == pytest.approx(0.5 * (0.2 / 0.1) ** 2)
    assert term.keys == (factors.pose_key(3), factors.pose_key(4))


def test_a_pose_prior_is_of_the_right_local_error() -> None:
    covariance = np.diag(np.square([0.01, 0.02, 0.03, 0.1, 0.2, 0.3]))
    term = factors.pose_prior(3, POSE, covariance)
    moved = values(POSE @ se3.exp(np.array([0.0, 0.0, 0.0, 0.0, 0.4, 0.0])))
    assert term.factor.error(moved) == pytest.approx(0.5 * (0.4 / 0.2) ** 2)


def test_keys_of_different_variables_are_different() -> None:
    numbers = range(0, 5000, 7)
    makers = (factors.landmark_key, factors.pose_key, factors.velocity_key, factors.bias_key)
    assert len({make(number) for make in makers for number in numbers}) == len(makers) * len(numbers)
