# SPDX-License-Identifier: BSD-3-Clause
"""A run whose clock stepped beside a ground truth: by the clock before the step, or by one that stepped too."""

from collections.abc import Sequence

import numpy as np

from coclo_vio.runs.run_record import ClockStepRecord, Interval
from coclo_vio.values.arrays import IntArray
from coclo_vio.values.trajectory import Trajectory
from coclo_vio.values.units import NS_PER_S

_EDGE = 0.1  # of a step: as much of it may the ground truth have poses in
_LEAST_PERIODS = 5  # of the ground truth in a step: a shorter one is no hole


def sample_stamps_ns(stamps_ns: IntArray, steps: Sequence[ClockStepRecord]) -> IntArray:
    """Stamps of a run (N,) by the clock of the samples."""
    from_ns = np.array([step.at_ns for step in steps], dtype=np.int64)
    shifts_ns = np.concatenate(([0], np.cumsum([step.step_ns for step in steps], dtype=np.int64)))
    return np.asarray(stamps_ns + shifts_ns[np.searchsorted(from_ns, stamps_ns, side="right")])


def has_stepped_too(truth: Trajectory, steps: Sequence[ClockStepRecord]) -> bool:
    """Whether a ground truth follows the clock of the samples: it has a hole where that jumped ahead.

    Its stamps rise, so it has followed no clock that went back.
    """
    if not steps or len(truth) < 2 or any(step.step_ns <= 0 for step in steps):
        return False
    period_ns = float(np.median(np.diff(truth.stamps_ns)))
    shift_ns = 0
    for step in steps:
        before_ns, shift_ns = step.at_ns + shift_ns, shift_ns + step.step_ns
        edge_ns = round(_EDGE * step.step_ns)
        inside = (truth.stamps_ns > before_ns + edge_ns) & (truth.stamps_ns < before_ns + step.step_ns - edge_ns)
        spans = truth.stamps_ns[0] <= before_ns and truth.stamps_ns[-1] >= before_ns + step.step_ns
        if inside.any() or not spans or step.step_ns < _LEAST_PERIODS * period_ns:
            return False
    return True


def on_clock_of(
    truth: Trajectory, estimate: Trajectory, recording_ns: Interval | None, steps: Sequence[ClockStepRecord]
) -> tuple[Trajectory, Interval | None]:
    """Estimates and interval of a recording by the clock that a ground truth has: the first, or that of the samples."""
    if not has_stepped_too(truth, steps):
        return estimate, recording_ns
    moved = estimate.restamped(sample_stamps_ns(estimate.stamps_ns, steps))
    if recording_ns is None:
        return moved, None
    first_ns, last_ns = sample_stamps_ns(np.array(recording_ns, dtype=np.int64), steps).tolist()
    return moved, (first_ns, last_ns)


def step_note(truth: Trajectory, steps: Sequence[ClockStepRecord], recording_ns: Interval | None) -> str | None:
    """A sentence on the clock of a run that stepped; None of one that did not."""
    if not steps:
        return None
    start_ns = steps[0].at_ns if recording_ns is None else recording_ns[0]
    parts = [
        f"{'forward' if step.step_ns > 0 else 'back'} by {abs(step.step_ns) / NS_PER_S:.6g} s at "
        f"{(step.at_ns - start_ns) / NS_PER_S:.2f} s"
        for step in steps
    ]
    which = "the clock of the samples, as it stepped too" if has_stepped_too(truth, steps) else "the clock before that"
    return f"the clock of all streams stepped {', and '.join(parts)}; the ground truth is compared by {which}"
