# SPDX-License-Identifier: BSD-3-Clause
"""The study of what filter and window exchange: motions out of evidence, and NEES over a keyframe and over a metre."""

import numpy as np
import pytest

from coclo_vio.experiments.studies.exchange_study import Piece, joined_errors, motion_of, nees_of, piece_errors
from coclo_vio.geometry import se3
from coclo_vio.values.arrays import Array
from coclo_vio.values.keyframes import PoseEvidence
from coclo_vio.values.trajectory import Trajectory

STEP = se3.exp(np.array([0.0, 0.02, 0.1, 0.1, 0.01, 0.0]))
SIGMAS = np.array([1e-3, 2e-3, 1e-3, 3e-3, 2e-3, 4e-3])
SECOND = 1_000_000_000


def walk(count: int) -> Trajectory:
    poses = [np.eye(4)]
    for _ in range(count):
        poses.append(poses[-1] @ STEP)
    return Trajectory(np.arange(count + 1) * SECOND, np.array(poses))


def pieces(errors: Array) -> list[Piece]:
    """Pieces of the walk with these right/local errors (n, 6)."""
    covariance = np.diag(SIGMAS**2)
    return [
        Piece(index * SECOND, (index + 1) * SECOND, STEP @ se3.exp(-error), covariance)
        for index, error in enumerate(errors)
    ]


def test_evidence_of_two_poses_contains_their_motion_whatever_it_knows_of_the_first() -> None:
    generator = np.random.default_rng(3)
    start, off = se3.exp(generator.normal(size=6)), 1e-3 * generator.normal(size=6)
    covariance = np.diag(SIGMAS**2)
    from_motion = np.concatenate((-se3.adjoint(se3.inverse(STEP)), np.eye(6)), axis=1)
    information = from_motion.T @ np.linalg.inv(covariance) @ from_motion
    vector = from_motion.T @ np.linalg.inv(covariance) @ off
    for known in (0.0, 1e4):
        prior = np.zeros((12, 12))
        prior[:6, :6] = known * np.eye(6)
        motion = motion_of(PoseEvidence(0, SECOND, start, start @ STEP, information + prior, vector))
        assert motion is not None
        np.testing.assert_allclose(motion.covariance, covariance, rtol=1e-6, atol=1e-12)
        np.testing.assert_allclose(motion.T_start_end, STEP @ se3.exp(off), atol=1e-9)


def test_evidence_that_leaves_a_direction_open_is_no_motion() -> None:
    information = np.zeros((12, 12))
    information[6:11, 6:11] = np.eye(5)
    assert motion_of(PoseEvidence(0, SECOND, np.eye(4), STEP, information, np.zeros(12))) is None


def test_honest_pieces_have_a_nees_of_one_over_a_keyframe_and_over_a_metre() -> None:
    errors = np.random.default_rng(5).normal(size=(1000, 6)) * SIGMAS
    noted = piece_errors(pieces(errors), walk(1000))
    assert nees_of(noted)["both"]["mean"] == pytest.approx(1.0, abs=0.1)
    joined = joined_errors(noted)
    assert 90 < len(joined) < 101
    assert nees_of(joined)["both"]["mean"] == pytest.approx(1.0, abs=0.25)


def test_an_error_that_repeats_shows_over_a_metre_only() -> None:
    repeated = np.tile(0.7 * SIGMAS, (300, 1))
    noted = piece_errors(pieces(repeated), walk(300))
    assert nees_of(noted)["translation"]["mean"] < 0.6
    assert nees_of(joined_errors(noted))["translation"]["mean"] > 3.0


def test_pieces_beside_the_truth_are_left_out_and_a_gap_ends_a_metre() -> None:
    noted = piece_errors(pieces(np.zeros((30, 6))), walk(14))
    assert len(noted) == 14
    assert nees_of([]) == {"count": 0}
    assert joined_errors([*noted[:6], *noted[8:]]) == []
