# SPDX-License-Identifier: BSD-3-Clause
"""What the window and whoever measures its odometry tell each other of the last two keyframes.

The window says what it knows of both without the other's word, so that the other hears nothing of its own again; what
may be handed over of that is ``coclo_vio.bridge``'s to work out.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import gtsam
import numpy as np

from coclo_vio.arrays import Array
from coclo_vio.backend.window import factors
from coclo_vio.backend.window.marginalisation import evidence_of_pair
from coclo_vio.backend.window.start import HELD_SIGMA
from coclo_vio.backend.window.window import Window
from coclo_vio.errors import SmootherError
from coclo_vio.estimates import OdometryDelta, PoseBelief, PoseEvidence
from coclo_vio.geometry import se3


@dataclass(frozen=True, slots=True, eq=False)
class Told:
    """What somebody says of a frame.

    Attributes:
        odometry: the motion from the last keyframe to the frame, as measured.
        evidence: what is known of the poses at both times besides; where the frame becomes a keyframe, it takes the
            place of the odometry, whose knowledge it holds.
    """

    odometry: OdometryDelta | None = None
    evidence: PoseEvidence | None = None


class Exchange:
    """Where the window was told to start, and what it has to say of its newest keyframes."""

    def __init__(self) -> None:
        self.given: PoseBelief | None = None
        self._said: tuple[PoseEvidence, PoseBelief] | None = None

    def start_from(self, belief: PoseBelief) -> None:
        """Note where to start; a start without any uncertainty could not be solved for."""
        self.given = PoseBelief(belief.stamp_ns, belief.T_world_body, belief.covariance + np.eye(6) * HELD_SIGMA**2)

    def note(self, window: Window, ties: Sequence[factors.Term]) -> None:
        """Work out what is known of the newest keyframes, for whoever gave these ties.

        Raises:
            SmootherError: landmarks or older keyframes are not determined; there is nothing to say then.
        """
        self._said = None
        self._said = newest_pair(window, ties)

    def belief(self, stamp_ns: int) -> PoseBelief | None:
        """What is known of the keyframe of this stamp, if it is the one that was noted."""
        return self._said[1] if self._said is not None and self._said[1].stamp_ns == stamp_ns else None

    def evidence(self, stamp_ns: int | None) -> PoseEvidence | None:
        """What is known of that keyframe and the one before it without the other's word."""
        return self._said[0] if self._said is not None and self._said[1].stamp_ns == stamp_ns else None


def newest_pair(window: Window, without: Sequence[factors.Term]) -> tuple[PoseEvidence, PoseBelief]:
    """What is known of the last two keyframes without some terms between them, and of the last one with all.

    Raises:
        SmootherError: landmarks or older keyframes are not determined.
    """
    landmark_ids = window.solvable_landmarks
    values = gtsam.Values(window.values)
    for landmark_id in landmark_ids:
        values.insert_or_assign(factors.landmark_key(landmark_id), window.landmarks.point(landmark_id))
    before, newest = window.keyframes[-2:]
    pair = (factors.pose_key(before.number), factors.pose_key(newest.number))
    left_out = {id(term) for term in without}
    terms = [term for term in window.terms() if id(term) not in left_out]
    leaving = [key for key in window.elimination(landmark_ids) if key not in pair]
    information, vector = evidence_of_pair(terms, leaving, pair, values)
    T_before, T_newest = window.pose(before.number), window.pose(newest.number)
    told = PoseEvidence(before.stamp_ns, newest.stamp_ns, T_before, T_newest, information, vector)
    with_ties = evidence_of_pair(without, (), pair, values)
    return told, _end_of(newest.stamp_ns, T_newest, information + with_ties[0], vector + with_ties[1])


def _end_of(stamp_ns: int, T_world_end: Array, information: Array, vector: Array) -> PoseBelief:  # noqa: N803
    try:
        covariance: Array = np.asarray(np.linalg.inv(information), dtype=np.float64)
    except np.linalg.LinAlgError as error:
        raise SmootherError("the newest keyframes are not determined") from error
    step = covariance @ vector
    return PoseBelief(stamp_ns, T_world_end @ se3.exp(step[6:]), covariance[6:, 6:])
