# SPDX-License-Identifier: BSD-3-Clause
"""Marginal of the newest keyframe, and evidence of the two newest ones, everything else eliminated.

The evidence leaves out the factors of a relative motion that another estimator measured, so that this estimator does
not receive its own information back. What of it is novel is worked out in ``coclo_vio.fusion.information``.
"""

from collections.abc import Sequence

import numpy as np

from coclo_vio.backend.window import factors
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
    information, vector = window.evidence((before.number, newest.number), without)
    T_before, T_newest = window.pose(before.number), window.pose(newest.number)
    return PoseEvidence(before.stamp_ns, newest.stamp_ns, T_before, T_newest, information, vector)


def newest_marginal(window: Window) -> PoseMarginal:
    """Marginal of the last keyframe.

    Raises:
        SmootherError: the keyframe is not determined.
    """
    newest = window.newest
    information, vector = window.evidence((newest.number,))
    try:
        covariance: Array = np.asarray(np.linalg.inv(information), dtype=np.float64)
    except np.linalg.LinAlgError as error:
        raise SmootherError("the newest keyframe is not determined") from error
    T_world_body = window.pose(newest.number) @ se3.exp(covariance @ vector)
    return PoseMarginal(newest.stamp_ns, T_world_body, covariance)
