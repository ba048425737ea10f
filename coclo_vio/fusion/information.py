# SPDX-License-Identifier: BSD-3-Clause
"""Information that one estimator has of two keyframes beyond what both estimators know already.

Filter and window share one marginal of the newest keyframe, the common knowledge. At the next keyframe each has a
marginal of both keyframes; its information beyond the common knowledge is evidence that the other one lacks, and
nothing else is exchanged. Derivation, and what is exact: ``docs/bridge.md``.
Source: Grime and Durrant-Whyte, "Data fusion in decentralized sensor networks", 1994 (channel filter).
"""

import numpy as np
from scipy.optimize import minimize_scalar

from coclo_vio.geometry import se3
from coclo_vio.values.arrays import Array
from coclo_vio.values.errors import SmootherError
from coclo_vio.values.keyframes import PoseEvidence, PoseMarginal, PosePair

_JITTER = 1e-12  # relative: a marginal that leaves directions open still has a triangle


def novel_information(
    information: Array, vector: Array, known: Array, known_vector: Array, min_share: float
) -> tuple[Array, Array]:
    """Information beyond what is known: a difference, without the directions in which nothing is novel.

    The difference is positive semi-definite where the marginal was made from the known one and from further evidence.
    Linearisation and dropped outliers may remove information; directions of negative difference, and of less than a
    share ``min_share`` of the marginal, are left out.

    Args:
        information: of the marginal, (n, n).
        vector: ``information @ mean``, (n,).
        known: information of what is known, (n, n).
        known_vector: ``known @ mean``, (n,).
        min_share: share of the marginal below which nothing is novel.

    Returns:
        The novel information, (n, n), and its vector, (n,).

    Raises:
        SmootherError: the marginal is not positive definite.
    """
    scale = np.trace(information) / len(information)
    try:
        lower = np.linalg.cholesky(information + _JITTER * scale * np.eye(len(information)))
    except np.linalg.LinAlgError as error:
        raise SmootherError(
            "the marginal of two keyframes is not positive definite: no evidence is exchanged at this keyframe"
        ) from error
    half = np.linalg.solve(lower, information - known)
    shares, axes = np.linalg.eigh(_symmetric(np.linalg.solve(lower, half.T)))
    kept = shares > min_share
    into = lower @ axes[:, kept]
    difference = axes[:, kept].T @ np.linalg.solve(lower, vector - known_vector)
    return (into * shares[kept]) @ into.T, into @ difference


def pair_evidence(pair: PosePair, known: PoseMarginal | None, min_share: float, floor_m: float) -> PoseEvidence:
    """The filter's information of two keyframes beyond the common knowledge of the earlier one.

    Args:
        pair: the filter's poses of both.
        known: common knowledge of the earlier one; None for none at all.
        min_share: share of the marginal below which nothing is novel.
        floor_m: smallest sigma of poses, m and rad.

    Raises:
        SmootherError: a marginal is not positive definite.
    """
    to_motion = np.eye(12)  # errors of [earlier pose, motion] from those of both poses
    to_motion[6:, :6] = -se3.adjoint(se3.inverse(pair.T_world_end) @ pair.T_world_start)
    covariance = to_motion @ pair.covariance @ to_motion.T + np.eye(12) * floor_m**2
    information = to_motion.T @ _inverse(covariance) @ to_motion
    evidence = PoseEvidence(
        pair.start_ns, pair.end_ns, pair.T_world_start, pair.T_world_end, _symmetric(information), np.zeros(12)
    )
    return evidence_beyond(evidence, known, min_share)


def evidence_beyond(evidence: PoseEvidence, known: PoseMarginal | None, min_share: float) -> PoseEvidence:
    """Evidence of two keyframes without the common knowledge of the earlier one.

    Args:
        evidence: of both poses, the common knowledge included.
        known: the common knowledge of the earlier pose; None for none at all.
        min_share: share of the evidence below which nothing is novel.

    Raises:
        SmootherError: the evidence is not positive definite.
    """
    if known is None:
        return evidence
    information, vector = np.zeros((12, 12)), np.zeros(12)
    away = se3.log(se3.inverse(evidence.T_world_start) @ known.T_world_body)
    jacobian = se3.right_jacobian(away)
    information[:6, :6] = jacobian.T @ _inverse(known.covariance) @ jacobian
    vector[:6] = information[:6, :6] @ away
    novel = novel_information(evidence.information, evidence.vector, information, vector, min_share)
    return PoseEvidence(
        evidence.start_ns, evidence.end_ns, evidence.T_world_start, evidence.T_world_end, _symmetric(novel[0]), novel[1]
    )


def end_evidence(pair: PosePair, end: PoseMarginal, share: float = 1.0) -> PoseEvidence:
    """The marginal of the later keyframe as evidence; of the earlier one it has no information.

    Args:
        pair: for time and place of the earlier keyframe.
        end: the marginal.
        share: of its information.

    Raises:
        SmootherError: the marginal's covariance is singular.
    """
    information = np.zeros((12, 12))
    information[6:, 6:] = share * _inverse(end.covariance)
    return PoseEvidence(pair.start_ns, end.stamp_ns, pair.T_world_start, end.T_world_body, information, np.zeros(12))


def intersection_weight(one: Array, other: Array) -> float:
    """The share ``w`` of the first covariance for which ``w one^-1 + (1 - w) other^-1`` has the largest determinant.

    No such sum is overconfident, whatever evidence the two have in common (Julier and Uhlmann, "A non-divergent
    estimation algorithm in the presence of unknown correlations", 1997).

    Args:
        one: covariance, (n, n).
        other: covariance, (n, n).
    """
    first, second = _inverse(one), _inverse(other)

    def negative_log_determinant(weight: float) -> float:
        return -float(np.linalg.slogdet(weight * first + (1.0 - weight) * second)[1])

    return float(minimize_scalar(negative_log_determinant, bounds=(1e-3, 1.0 - 1e-3), method="bounded").x)


def _symmetric(matrix: Array) -> Array:
    symmetric: Array = 0.5 * (matrix + matrix.T)
    return symmetric


def _inverse(covariance: Array) -> Array:
    try:
        inverse = np.asarray(np.linalg.inv(covariance), dtype=np.float64)
    except np.linalg.LinAlgError as error:
        raise SmootherError(
            "the covariance of a keyframe is singular: no evidence is exchanged at this keyframe"
        ) from error
    return _symmetric(inverse)
