# SPDX-License-Identifier: BSD-3-Clause
"""NEES of errors drawn from a covariance averages to its dimension."""

import numpy as np
import pytest
from scipy.stats import chi2

from coclo_vio.evaluation.consistency import anees, anees_pose, nees, pose_errors, twists
from coclo_vio.geometry import se3
from coclo_vio.values.errors import EvaluationError
from coclo_vio.values.trajectory import Trajectory


def test_nees_by_hand():
    values = nees(np.array([[3.0, 4.0], [1.0, 0.0]]), np.array([np.diag([9.0, 4.0]), np.diag([1.0, 0.0])]))
    assert values[0] == pytest.approx(5.0)
    assert np.isnan(values[1])
    assert anees(values, 2) == pytest.approx(2.5)
    assert anees(values[1:], 2) is None


def test_wrong_shapes_are_errors():
    with pytest.raises(EvaluationError, match=r"\(4, 6\)"):
        nees(np.zeros((4, 6)), np.zeros((4, 3, 3)))


@pytest.mark.parametrize("scale", [1.0, 4.0])
def test_anees_of_the_pose_is_the_ratio_of_true_to_estimated_variance(scale):
    rng = np.random.default_rng(7)
    root = rng.normal(0.0, 0.02, (6, 6))
    covariance = root @ root.T + 1e-5 * np.eye(6)
    means = np.array([se3.exp(rng.normal(0.0, 1.0, 6)) for _ in range(3000)])
    errors = rng.multivariate_normal(np.zeros(6), scale * covariance, 3000)
    true = means @ np.array([se3.exp(error) for error in errors])
    stamps = np.arange(3000) * 10_000_000
    estimate = Trajectory(stamps, means, covariance=np.tile(covariance, (3000, 1, 1)))
    reference = Trajectory(stamps, true)
    np.testing.assert_allclose(pose_errors(estimate, reference), errors, atol=1e-9)
    low, high = chi2.ppf([0.0005, 0.9995], 6 * 3000) / (6 * 3000)
    assert low < anees_pose(estimate, reference) / scale < high
    assert anees_pose(reference, estimate) is None


def test_noise_of_the_ground_truth_keeps_a_certain_start_from_counting_for_all():
    stamps = np.arange(2) * 10_000_000
    poses = np.tile(np.eye(4), (2, 1, 1))
    estimate = Trajectory(stamps, poses, covariance=np.tile(1e-10 * np.eye(6), (2, 1, 1)))
    moved = poses.copy()
    moved[:, 0, 3] = 0.001
    assert anees_pose(estimate, Trajectory(stamps, moved)) > 1000.0
    assert anees_pose(estimate, Trajectory(stamps, moved), 0.002, 0.001) == pytest.approx(1.0 / 6.0, rel=1e-3)


def test_a_wrong_time_of_the_ground_truth_moves_poses_along_their_twist():
    """A body that goes and turns steadily, 30 ms late in the ground truth: as sigma that is one sigma."""
    stamps, late_s = np.arange(200) * 10_000_000, 0.03
    twist = np.array([0.0, 0.0, 0.5, 0.6, 0.0, 0.1])
    poses = np.array([se3.exp(twist * stamp * 1e-9) for stamp in stamps])
    np.testing.assert_allclose(twists(Trajectory(stamps, poses)), np.tile(twist, (200, 1)), atol=1e-9)
    estimate = Trajectory(stamps, poses, covariance=np.tile(1e-8 * np.eye(6), (200, 1, 1)))
    late = Trajectory(stamps, poses @ se3.exp(twist * late_s))
    assert anees_pose(estimate, late) > 1000.0
    assert anees_pose(estimate, late, time_noise_s=late_s) == pytest.approx(1.0 / 6.0, rel=1e-3)
