# SPDX-License-Identifier: BSD-3-Clause
"""What the window and whoever measures its odometry tell each other of the last two keyframes.

The window says what it knows of both without the other's word, so that the other hears nothing of its own again; what
may be handed over of that is ``coclo_vio.fusion.bridge``'s to work out.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import gtsam
import numpy as np

from coclo_vio.backend.window import factors
from coclo_vio.backend.window.marginalisation import evidence_of_poses
from coclo_vio.backend.window.start import HELD_SIGMA
from coclo_vio.backend.window.window import Window
from coclo_vio.geometry import se3
from coclo_vio.values.arrays import Array
from coclo_vio.values.errors import SmootherError
from coclo_vio.values.keyframes import OdometryDelta, PoseEvidence, PoseMarginal


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
        self.given: PoseMarginal | None = None
        self._evidence: PoseEvidence | None = None
        self._belief: PoseMarginal | None = None

    def start_from(self, belief: PoseMarginal) -> None:
        """Note where to start; a start without any uncertainty could not be solved for."""
        self.given = PoseMarginal(belief.stamp_ns, belief.T_world_body, belief.covariance + np.eye(6) * HELD_SIGMA**2)

    def note_evidence(self, window: Window, ties: Sequence[factors.Term]) -> None:
        """Work out what is known of the newest keyframes, for whoever gave these ties.

        Raises:
            SmootherError: landmarks or older keyframes are not determined; there is nothing to say then.
        """
        self._evidence = None
        self._evidence = newest_pair(window, ties)

    def note_marginal(self, window: Window) -> None:
        """Work out what is known of the newest keyframe, once the window has forgotten what it does not keep.

        Raises:
            SmootherError: the newest keyframe is not determined.
        """
        self._belief = None
        if self._evidence is not None:
            self._belief = newest_marginal(window)

    def marginal(self, stamp_ns: int) -> PoseMarginal | None:
        """What is known of the keyframe of this stamp, if it is the one that was noted."""
        return self._belief if self._belief is not None and self._belief.stamp_ns == stamp_ns else None

    def evidence(self, stamp_ns: int | None) -> PoseEvidence | None:
        """What is known of that keyframe and the one before it without the other's word."""
        return self._evidence if self._evidence is not None and self._evidence.end_ns == stamp_ns else None


def newest_pair(window: Window, without: Sequence[factors.Term]) -> PoseEvidence:
    """What is known of the last two keyframes without some terms between them.

    Raises:
        SmootherError: landmarks or older keyframes are not determined.
    """
    before, newest = window.keyframes[-2:]
    information, vector = _evidence_of(window, (before.number, newest.number), without)
    T_before, T_newest = window.pose(before.number), window.pose(newest.number)
    return PoseEvidence(before.stamp_ns, newest.stamp_ns, T_before, T_newest, information, vector)


def newest_marginal(window: Window) -> PoseMarginal:
    """What is known of the last keyframe.

    Raises:
        SmootherError: it is not determined.
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
    landmark_ids = window.solved_landmarks  # one that was only just placed may be far from where it is linear
    values = gtsam.Values(window.values)
    for landmark_id in landmark_ids:
        values.insert_or_assign(factors.landmark_key(landmark_id), window.landmarks.point(landmark_id))
    poses = [factors.pose_key(number) for number in numbers]
    left_out = {id(term) for term in without}
    terms = [term for term in window.terms(landmark_ids) if id(term) not in left_out]
    leaving = [key for key in window.elimination(landmark_ids) if key not in poses]
    return evidence_of_poses(terms, leaving, poses, values)
