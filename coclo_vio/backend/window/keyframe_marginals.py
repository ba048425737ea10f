# SPDX-License-Identifier: BSD-3-Clause
"""Marginal of the newest keyframe, and evidence of the two newest ones, everything else eliminated.

The evidence leaves out the factors of a relative motion that another estimator measured, so that this estimator does
not receive its own information back. What of it is novel is worked out in ``coclo_vio.fusion.information``.
"""

from collections.abc import Sequence

import gtsam
import numpy as np

from coclo_vio.backend.window import factors
from coclo_vio.backend.window.marginalisation import evidence_of_poses
from coclo_vio.backend.window.window import Window
from coclo_vio.geometry import se3
from coclo_vio.values.arrays import Array
from coclo_vio.values.errors import SmootherError
from coclo_vio.values.keyframes import PoseEvidence, PoseMarginal


def pair_evidence(window: Window, without: Sequence[factors.Term]) -> PoseEvidence:
    """Evidence of the last two keyframes from everything in the window but some terms between them.

    Raises:
        SmootherError: landmarks or older keyframes are not determined.
    """
    before, newest = window.keyframes[-2:]
    information, vector = _evidence_of(window, (before.number, newest.number), without)
    T_before, T_newest = window.pose(before.number), window.pose(newest.number)
    return PoseEvidence(before.stamp_ns, newest.stamp_ns, T_before, T_newest, information, vector)


def newest_marginal(window: Window) -> PoseMarginal:
    """Marginal of the last keyframe.

    Raises:
        SmootherError: the keyframe is not determined.
    """
    newest = window.newest
    information, vector = _evidence_of(window, (newest.number,), ())
    try:
        covariance: Array = np.asarray(np.linalg.inv(information), dtype=np.float64)
    except np.linalg.LinAlgError as error:
        raise SmootherError("the newest keyframe is not determined") from error
    T_world_body = window.pose(newest.number) @ se3.exp(covariance @ vector)
    return PoseMarginal(newest.stamp_ns, T_world_body, covariance)


def _evidence_of(window: Window, numbers: Sequence[int], without: Sequence[factors.Term]) -> tuple[Array, Array]:
    """Information and vector of some keyframes' poses, everything else eliminated."""
    landmark_ids = window.solved_landmarks  # others may be far from the minimum, where a linearisation is worthless
    values = gtsam.Values(window.values)
    for landmark_id in landmark_ids:
        values.insert_or_assign(factors.landmark_key(landmark_id), window.landmarks.point(landmark_id))
    poses = [factors.pose_key(number) for number in numbers]
    left_out = {id(term) for term in without}
    terms = [term for term in window.terms(landmark_ids) if id(term) not in left_out]
    leaving = [key for key in window.elimination(landmark_ids) if key not in poses]
    return evidence_of_poses(terms, leaving, poses, values)
