# SPDX-License-Identifier: BSD-3-Clause
"""The bridge between legs and eyes: what each may tell the other without either hearing its own words again.

Both keep a belief of the newest keyframe, and it is the same one: the common knowledge. At the next keyframe each
believes something of both keyframes; what that is beyond the common knowledge is evidence that the other one lacks,
and nothing else is handed over. Derivation, and what is exact: ``docs/bridge.md``.
Source: Grime and Durrant-Whyte, "Data fusion in decentralized sensor networks", 1994 (channel filter).
"""

from typing import Annotated, Literal

import numpy as np
from pydantic import BeforeValidator, Field
from scipy.optimize import minimize_scalar

from coclo_vio.geometry import se3
from coclo_vio.values.arrays import Array
from coclo_vio.values.config import StageConfig
from coclo_vio.values.errors import SmootherError
from coclo_vio.values.keyframes import PoseEvidence, PoseMarginal, PosePair

Policy = Annotated[
    Literal["off", "paper", "ci", "decorrelated"],
    BeforeValidator(lambda value: "off" if value is False else value),  # YAML reads a plain off as false
]
_JITTER = 1e-12  # relative: a belief that leaves directions open still has a triangle


class BridgeConfig(StageConfig):
    """What goes from the smoother back to the filter, and when."""

    feedback: Annotated[
        Policy,
        Field(
            description="off: nothing; paper: the smoothed pose as if it were independent (section IV); ci: covariance "
            "intersection; decorrelated: what the eyes know beyond what both know"
        ),
    ] = "decorrelated"
    vision_latency_s: Annotated[
        float, Field(ge=0, le=5, description="a frame's result reaches the filter this long after its stamp, s")
    ] = 0.05
    min_novel_share: Annotated[
        float,
        Field(ge=0, lt=0.5, description="directions in which a smaller share of a belief is new count as nothing new"),
    ] = 1e-4
    floor_m: Annotated[
        float, Field(gt=0, le=0.1, description="no motion of legs is believed better than this, m and rad, one sigma")
    ] = 1e-4


def news(information: Array, vector: Array, known: Array, known_vector: Array, least: float) -> tuple[Array, Array]:
    """Information beyond what is known: a difference, without the directions in which there is nothing new.

    Where all went well, the difference is positive semi-definite: a belief that was made from the known one and from
    something else knows more. Linearisation and outliers that were dropped may take something away again; what
    would be negative, and what is less than a share ``least`` of the belief, is left out.

    Args:
        information: of the belief, (n, n).
        vector: ``information @ mean``, (n,).
        known: information of what is known, (n, n).
        known_vector: ``known @ mean``, (n,).
        least: share of the belief below which nothing is new.

    Raises:
        SmootherError: the belief is not positive definite.
    """
    scale = np.trace(information) / len(information)
    try:
        lower = np.linalg.cholesky(information + _JITTER * scale * np.eye(len(information)))
    except np.linalg.LinAlgError as error:
        raise SmootherError("a belief of two keyframes is not positive definite, nothing is told of it") from error
    half = np.linalg.solve(lower, information - known)
    shares, axes = np.linalg.eigh(_symmetric(np.linalg.solve(lower, half.T)))
    kept = shares > least
    into = lower @ axes[:, kept]
    difference = axes[:, kept].T @ np.linalg.solve(lower, vector - known_vector)
    return (into * shares[kept]) @ into.T, into @ difference


def legs_evidence(pair: PosePair, known: PoseMarginal | None, config: BridgeConfig) -> PoseEvidence:
    """What the filter knows of two keyframes beyond what is known of the earlier one.

    Args:
        pair: what the filter believes.
        known: common knowledge of the earlier one; None for none at all.
        config: least news and floor.
    """
    to_motion = np.eye(12)  # errors of [earlier pose, motion] from those of both poses
    to_motion[6:, :6] = -se3.adjoint(se3.inverse(pair.T_world_end) @ pair.T_world_start)
    covariance = to_motion @ pair.covariance @ to_motion.T + np.eye(12) * config.floor_m**2
    information = to_motion.T @ _inverse(covariance) @ to_motion
    believed = PoseEvidence(
        pair.start_ns, pair.end_ns, pair.T_world_start, pair.T_world_end, _symmetric(information), np.zeros(12)
    )
    return evidence_beyond(believed, known, config.min_novel_share)


def evidence_beyond(believed: PoseEvidence, known: PoseMarginal | None, least: float) -> PoseEvidence:
    """A belief of two keyframes without what is known of the earlier one."""
    if known is None:
        return believed
    information, vector = np.zeros((12, 12)), np.zeros(12)
    away = se3.log(se3.inverse(believed.T_world_start) @ known.T_world_body)
    jacobian = se3.right_jacobian(away)
    information[:6, :6] = jacobian.T @ _inverse(known.covariance) @ jacobian
    vector[:6] = information[:6, :6] @ away
    told = news(believed.information, believed.vector, information, vector, least)
    return PoseEvidence(
        believed.start_ns, believed.end_ns, believed.T_world_start, believed.T_world_end, _symmetric(told[0]), told[1]
    )


def of_end(start: PoseMarginal, end: PoseMarginal, share: float = 1.0) -> PoseEvidence:
    """A belief of the later pose alone as evidence; nothing is said of the earlier one.

    Args:
        start: of the earlier pose, for its time and place.
        end: what is believed.
        share: of its information.
    """
    information = np.zeros((12, 12))
    information[6:, 6:] = share * _inverse(end.covariance)
    return PoseEvidence(start.stamp_ns, end.stamp_ns, start.T_world_body, end.T_world_body, information, np.zeros(12))


def intersection_weight(one: Array, other: Array) -> float:
    """The share ``w`` of the first for which ``w one^-1 + (1 - w) other^-1`` knows most (largest determinant).

    Whatever two beliefs have in common, no such sum is too sure (Julier and Uhlmann, "A non-divergent estimation
    algorithm in the presence of unknown correlations", 1997).

    Args:
        one: covariance, (n, n).
        other: covariance, (n, n).
    """
    first, second = _inverse(one), _inverse(other)

    def unknown(weight: float) -> float:
        return -float(np.linalg.slogdet(weight * first + (1.0 - weight) * second)[1])

    return float(minimize_scalar(unknown, bounds=(1e-3, 1.0 - 1e-3), method="bounded").x)


def _symmetric(matrix: Array) -> Array:
    symmetric: Array = 0.5 * (matrix + matrix.T)
    return symmetric


def _inverse(covariance: Array) -> Array:
    try:
        inverse = np.asarray(np.linalg.inv(covariance), dtype=np.float64)
    except np.linalg.LinAlgError as error:
        raise SmootherError("the covariance of a keyframe is singular, nothing is told of it") from error
    return _symmetric(inverse)
