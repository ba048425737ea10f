# SPDX-License-Identifier: BSD-3-Clause
"""The ground truth at the stamps of the estimate: the second step of an evaluation, after the clock.

Nothing is interpolated across a hole in the ground truth: such samples are left out and counted.
"""

from dataclasses import dataclass

import numpy as np

from coclo_vio.values.arrays import BoolArray, IntArray
from coclo_vio.values.errors import EvaluationError
from coclo_vio.values.trajectory import Trajectory
from coclo_vio.values.units import NS_PER_S


@dataclass(frozen=True, slots=True, eq=False)
class MatchedPair:
    """Two trajectories on the same stamps.

    Attributes:
        estimate: the poses of the estimate that have a counterpart, N of them, in the estimate's world.
        reference: the ground truth interpolated at their stamps, N poses, in the ground truth's world.
        outside_count: poses of the estimate left out because they lie before or after the ground truth.
        in_gap_count: poses of the estimate left out because they lie in a hole of the ground truth.
    """

    estimate: Trajectory
    reference: Trajectory
    outside_count: int
    in_gap_count: int


def gaps_ns(stamps_ns: IntArray, limit_s: float) -> IntArray:
    """Starts and ends, (K, 2) ns, of the intervals between successive stamps that are longer than ``limit_s``."""
    starts = np.flatnonzero(np.diff(stamps_ns) > limit_s * NS_PER_S)
    return np.stack((stamps_ns[starts], stamps_ns[starts + 1]), axis=1)


def in_gap(stamps_ns: IntArray, gaps: IntArray) -> BoolArray:
    """Which of ``stamps_ns`` (N,) lie strictly inside one of ``gaps`` (K, 2) ns; (N,)."""
    before = np.searchsorted(gaps[:, 0], stamps_ns, side="left") - 1
    inside: BoolArray = (before >= 0) & (stamps_ns < np.append(gaps[:, 1], 0)[before])
    return inside


def match(estimate: Trajectory, reference: Trajectory, max_gap_s: float) -> MatchedPair:
    """The reference interpolated at the stamps of the estimate, holes longer than ``max_gap_s`` left out.

    Raises:
        EvaluationError: the two do not overlap, or fewer than two poses of the estimate have a counterpart.
    """
    first_ns, last_ns = int(reference.stamps_ns[0]), int(reference.stamps_ns[-1])
    is_within = (estimate.stamps_ns >= first_ns) & (estimate.stamps_ns <= last_ns)
    if not is_within.any():
        raise EvaluationError(
            f"the estimate ({_span(estimate)}) and the ground truth ({_span(reference)}, clock offset included) do not "
            "overlap in time; set the clock offset, or check that both belong to the same recording"
        )
    is_in_gap = in_gap(estimate.stamps_ns, gaps_ns(reference.stamps_ns, max_gap_s)) & is_within
    keep = is_within & ~is_in_gap
    if keep.sum() < 2:
        raise EvaluationError(
            f"{int(keep.sum())} of {len(estimate)} estimated poses have a ground truth beside them, at least 2 are "
            f"needed; {int(is_in_gap.sum())} lie in holes of the ground truth longer than max_ground_truth_gap_s = "
            f"{max_gap_s:g} s: raise it if the ground truth is that sparse"
        )
    kept = estimate.select(keep)
    return MatchedPair(
        estimate=kept,
        reference=reference.interpolated(kept.stamps_ns),
        outside_count=int((~is_within).sum()),
        in_gap_count=int(is_in_gap.sum()),
    )


def coverage(estimate: Trajectory, start_ns: int, end_ns: int, max_gap_s: float) -> float | None:
    """Share, 0..1, of the interval in which the estimate has poses no further apart than ``max_gap_s``.

    None where the interval is empty.
    """
    if end_ns <= start_ns:
        return None
    clipped = np.clip(estimate.stamps_ns, start_ns, end_ns)
    is_close = np.diff(estimate.stamps_ns) <= max_gap_s * NS_PER_S
    return float(np.diff(clipped)[is_close].sum() / (end_ns - start_ns))


def _span(trajectory: Trajectory) -> str:
    first_s, last_s = trajectory.stamps_ns[0] / NS_PER_S, trajectory.stamps_ns[-1] / NS_PER_S
    return f"{first_s:.3f} to {last_s:.3f} s"
