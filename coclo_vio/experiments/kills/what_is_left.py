# SPDX-License-Identifier: BSD-3-Clause
"""What an ended run left against the whole one, and whether the resumed one is the same."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from coclo_vio.evaluation.evaluate import EvaluationConfig, evaluate
from coclo_vio.experiments.kills.kill_record import Left
from coclo_vio.runs import run_folder
from coclo_vio.runs.evaluating import evaluate_run, evaluation_config
from coclo_vio.values.errors import CocloError, DatasetError
from coclo_vio.values.units import NS_PER_S

_MOMENT_NS = NS_PER_S  # that may be missing


@dataclass(frozen=True, slots=True)
class WhatIsLeft:
    """What an ended run left.

    Attributes:
        left: what ``evaluate`` makes of it.
        reason: why it is not evaluated.
        lost_s: estimates that are missing of the mode that ran, s; None where that is not known.
    """

    left: Left
    reason: str
    lost_s: float | None


def left_of(folder: Path, whole: Path, mode: str, read_ns: int) -> WhatIsLeft:
    """Look at an ended run.

    Args:
        folder: of it.
        whole: folder of the same run that was not ended.
        mode: that ran when it was ended.
        read_ns: stamp of the newest measurement that it had read.
    """
    try:
        config = evaluation_config(folder / "config.yaml")
        found = run_folder.read_record(folder)
        evaluations, failures = evaluate_run(folder, config)
    except CocloError as error:
        return WhatIsLeft("failed", str(error), None)
    names = {name: run for name, run in found.estimators.items() if run.mode == mode}
    if not names:
        return WhatIsLeft("failed", f"run.json has nothing of {mode}", None)
    lost = {name: _lost_ns(run.last_ns, whole, name, read_ns) for name, run in names.items()}
    lost_s = max((each for each in lost.values() if each is not None), default=0) / NS_PER_S
    lefts: dict[str, Left] = dict.fromkeys(evaluations, "evaluated")
    for name in failures:
        run = found.estimators[name]
        if run.estimates:
            lefts[name] = "too short" if _is_too_short(whole, name, run.estimates, config) else "failed"
        else:
            missing_ns = lost.get(name)
            is_early = missing_ns is not None and missing_ns <= _MOMENT_NS and not _has_lines(folder / f"{name}.tum")
            lefts[name] = "no estimate yet" if is_early else "failed"
    order: tuple[Left, ...] = ("failed", "no estimate yet", "too short", "evaluated")
    worst: Left = next((each for each in order if each in lefts.values()), "failed")
    return WhatIsLeft(worst, "; ".join(failures.values()), lost_s)


def _has_lines(path: Path) -> bool:
    """Whether a file is there and has a whole line."""
    return path.is_file() and b"\n" in path.read_bytes()


def _lost_ns(last_ns: int | None, whole: Path, name: str, read_ns: int) -> int | None:
    """From the last estimate that is there to the last that the whole run has up to a stamp; None: it has none."""
    try:
        stamps_ns = run_folder.read_estimates(whole, name).trajectory.stamps_ns
    except DatasetError:
        return None
    known = stamps_ns[stamps_ns <= read_ns]
    if not len(known):
        return 0
    since_ns = int(known[0]) if last_ns is None else last_ns
    return max(0, int(known[-1]) - since_ns)


def _is_too_short(whole: Path, name: str, count: int, config: EvaluationConfig) -> bool:
    """Whether the first estimates of the whole run cannot be evaluated either."""
    record = run_folder.read_record(whole)
    truth = run_folder.read_ground_truth(whole, record)
    estimates = run_folder.read_estimates(whole, name).trajectory
    if truth is None:
        return False
    try:
        evaluate(estimates.select(np.arange(min(count, len(estimates)))), truth, config)
    except CocloError:
        return True
    return False


@dataclass(frozen=True, slots=True)
class Comparison:
    """A resumed run beside the whole one.

    Attributes:
        difference: largest difference of all numbers in the files; None where their shapes differ.
        has_same_events: whether events, counts and names agree.
        resumed_from_s: seconds after the first measurement where modes went on, by mode.
    """

    difference: float | None
    has_same_events: bool
    resumed_from_s: dict[str, tuple[float, ...]]


def compared(whole: Path, resumed: Path) -> Comparison:
    """Compare all files of two run folders, but for times of computing.

    Raises:
        DatasetError: one is no run folder.
    """
    one, other = run_folder.read_record(whole), run_folder.read_record(resumed)
    start_ns = 0 if one.recording_ns is None else one.recording_ns[0]
    from_s = {
        mode: tuple((stamp_ns - start_ns) / NS_PER_S for stamp_ns in run.resumed_ns)
        for mode, run in other.by_mode().items()
    }
    same = one.estimators.keys() == other.estimators.keys() and all(
        run.events == other.estimators[name].events and run.counts == other.estimators[name].counts
        for name, run in one.estimators.items()
    )
    return Comparison(largest_difference(whole, resumed), same, from_s)


def largest_difference(whole: Path, resumed: Path) -> float | None:
    """Of all numbers in the files of lines; None where one has other lines, or is missing."""
    worst = 0.0
    for path in sorted((*whole.glob("*.tum"), *whole.glob("*.csv"))):
        twin = resumed / path.name
        if not twin.is_file():
            return None
        if twin.read_bytes() == path.read_bytes():
            continue
        delimiter, skip = (None, 0) if path.suffix == ".tum" else (",", 1)
        before, after = (np.loadtxt(each, delimiter=delimiter, skiprows=skip, ndmin=2) for each in (path, twin))
        if before.shape != after.shape:
            return None
        if path.name.endswith("_keyframes.csv"):  # computing time is another one
            before, after = np.delete(before, 7, axis=1), np.delete(after, 7, axis=1)
        if (np.isnan(before) != np.isnan(after)).any():
            return None
        worst = max(worst, float(np.nanmax(np.abs(before - after), initial=0.0)))
    return worst
