# SPDX-License-Identifier: BSD-3-Clause
"""What goes wrong on purpose: ``coclo``, ``vins`` and ``combined`` with and without faults, against the exact truth.

``python -m coclo_vio.experiments.studies.robustness --recordings DIR -o out/robustness.json``: trials are
DIR/<trial>_<seed>, those whose
robot or ground is another DIR/<trial>_<seed>_slippery and ..._shocks3, ..._shocks10; what is missing is simulated and
stays there. What is finished is kept: a run that was stopped goes on where it was, and ``--modes`` run apart add up. An
estimator that reads no sensor that a fault touches has the figures of the nominal run, and is not run again.

Recovery. The error of a moment is that of the motion over the second before it, m: the translation of the estimated
motion less the true one. An estimator has recovered at the first moment, on a grid of 0.1 s from the end of the fault
on, from which on that error stays for 1 s within the 95th percentile of the same estimator's errors in the nominal run
of the same trial and seed. A trial that ends within that second is no recovery. So a fault that did no harm has a
recovery of 0 s, and one that is over but for its second in the window about 1 s.
"""

import argparse
import json
import os
import sys
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before NumPy: one core a process
os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
import yaml

from coclo_vio.evaluation.clock import ClockConfig
from coclo_vio.evaluation.evaluate import EvaluationConfig
from coclo_vio.evaluation.metrics import relative_errors_m
from coclo_vio.evaluation.records import EvaluationRecord
from coclo_vio.runs.comparison import evaluate_run, run_all
from coclo_vio.runs.run_config import resolve
from coclo_vio.runs.run_folder import read_estimates
from coclo_vio.simulation.simulated_recording import (
    SIMULATED_ROBOT,
    simulate_recording,
    simulation_config,
    truth_folder,
)
from coclo_vio.simulation.trial.terrain import TERRAINS, TerrainName
from coclo_vio.values.arrays import Array
from coclo_vio.values.trajectory import GroundTruth, Trajectory, read_tum
from coclo_vio.values.units import NS_PER_S

Row = dict[str, Any]
Span = tuple[float, float]
MODES: Mapping[str, tuple[str, ...]] = {
    "coclo": ("coclo",),
    "vins": ("vins",),
    "combined": ("combined_coclo", "combined_vins"),
}
ESTIMATORS = tuple(name for names in MODES.values() for name in names)
FIGURES = ("drift_percent", "rpe_1m_percent", "ate_m", "yaw_drift_deg", "anees_pose", "coverage")
_JPEG = {"camera": {"encoding": "jpeg"}}
_UNTOUCHED = ("imu0", "joints0")  # of a recording with other shocks
_EYES = ("cam0", "cam1")
_AGAINST_TRUTH = EvaluationConfig(
    clock=ClockConfig(offset_s=0.0), ground_truth_rotation_noise_rad=0.0, ground_truth_position_noise_m=0.0
)
_GRID_NS, _WINDOW_NS = NS_PER_S // 10, NS_PER_S
_STAYS_S = 1.0
_USUAL = 95.0  # percentile


@dataclass(frozen=True)
class Case:
    """A fault.

    Attributes:
        touches: the modes that read a sensor that it touches.
        settings: of the run; MID is the middle of the recording, s.
        seconds: how long it lasts from MID on; None where it has no end, or the recording says when it is.
        variant: of the recording.
        changes: of the simulation that makes the variant.
    """

    touches: tuple[str, ...] = tuple(MODES)
    settings: tuple[str, ...] = ()
    seconds: float | None = None
    variant: str = ""
    changes: Mapping[str, Any] | None = None


def _shocks(scale: float) -> Case:
    changes = {"trial": {"camera_imu": {"shock_scale": scale}}}
    return Case(touches=("vins",), variant=f"shocks{scale:.0f}", changes=changes)


CASES: Mapping[str, Case] = {
    "nominal": Case(),
    "blackout 5 s": Case(("vins", "combined"), ("faults.blackouts=['MID:5']",), 5.0),
    "30 % of frames lost": Case(("vins", "combined"), ("faults.frame_loss=0.3",)),
    "leg2 frozen 3 s": Case(("coclo", "combined"), ("faults.frozen_legs=['leg2:MID:3']",), 3.0),
    "tile of friction 0.3": Case(variant="slippery", changes={"trial": {"slippery_tile": 0.3}}),
    "camera shocks x3": _shocks(3.0),
    "camera shocks x10": _shocks(10.0),
}


def suffer(
    name: TerrainName, seed: int, called: str, modes: tuple[str, ...], recordings: Path, usual: Mapping[str, float]
) -> Row:
    """One trial with one fault through some modes.

    Args:
        name: the trial.
        seed: of the trial.
        called: the case.
        modes: of those that the fault touches.
        recordings: where recordings are and stay.
        usual: for each estimator the 95th percentile of its errors without a fault, m; empty if there is none here.
    """
    case = CASES[called]
    path = _recording(name, seed, case, recordings)
    truth = read_tum(truth_folder(path) / "groundtruth.tum")
    middle_s = round(0.5 * truth.duration_s)
    fault_s = _when(case, middle_s, path)
    settings = [setting.replace("MID", str(middle_s)) for setting in case.settings]
    told: Row = {}
    for mode in modes:
        told |= _run(path, mode, settings, GroundTruth(truth, True, "truth"), fault_s, usual)
    return {"trial": name, "seed": seed, "case": called, "fault_s": fault_s, "estimators": told}


def _run(
    path: Path, mode: str, settings: list[str], truth: GroundTruth, fault_s: Span | None, usual: Mapping[str, float]
) -> Row:
    """Every estimator of a mode on a recording."""
    told: Row = {}
    with TemporaryDirectory() as scratch:
        folder = Path(scratch)
        run = run_all(path, [mode], resolve(SIMULATED_ROBOT, settings=settings), folder)["estimators"]
        evaluations, failures = evaluate_run(folder, _AGAINST_TRUTH, truth)
        for name in MODES[mode]:
            seen: Row = {"failure": failures.get(name, run[name]["failure"]), "events": run[name]["events"]}
            if name in evaluations:
                figures = EvaluationRecord.of(evaluations[name]).to_json()
                moments_s, errors_m = moments(read_estimates(folder, name).trajectory, truth.trajectory)
                seen |= {key: figures[key] for key in FIGURES} | {"usual_m": float(np.percentile(errors_m, _USUAL))}
                if fault_s is not None and name in usual:
                    seen["recovery_s"] = recovery_s(moments_s, errors_m, fault_s[1], usual[name])
                    during = (moments_s > fault_s[0]) & (moments_s <= fault_s[1] + _STAYS_S)
                    seen["worst_m"] = float(errors_m[during].max(initial=0.0))
            told[name] = seen
    return told


def moments(estimate: Trajectory, truth: Trajectory) -> tuple[Array, Array]:
    """Moments, s after the truth's first, and the error of the motion in the second before each, m."""
    first_ns = max(int(estimate.stamps_ns[0]), int(truth.stamps_ns[0]))
    last_ns = min(int(estimate.stamps_ns[-1]), int(truth.stamps_ns[-1]))
    origin_ns = int(truth.stamps_ns[0])
    begin_ns = origin_ns + -(-(first_ns - origin_ns) // _GRID_NS) * _GRID_NS
    stamps = np.arange(begin_ns, last_ns + 1, _GRID_NS, dtype=np.int64)
    apart = _WINDOW_NS // _GRID_NS
    pairs = np.stack((np.arange(len(stamps) - apart), np.arange(apart, len(stamps))), axis=1)
    errors_m = relative_errors_m(estimate.interpolated(stamps), truth.interpolated(stamps), pairs)
    return (stamps[apart:] - origin_ns) / NS_PER_S, errors_m


def recovery_s(moments_s: Array, errors_m: Array, end_s: float, usual_m: float) -> float | None:
    """How long after ``end_s`` the errors are within ``usual_m`` to stay there for a second; None if never."""
    steps = round(_STAYS_S * NS_PER_S / _GRID_NS)
    for start in np.flatnonzero(moments_s >= end_s - 1e-9):
        ahead = errors_m[start : start + steps + 1]
        if len(ahead) <= steps:
            return None
        if (ahead <= usual_m).all():
            return max(round(float(moments_s[start]) - end_s, 3), 0.0)
    return None


def _when(case: Case, middle_s: float, path: Path) -> Span | None:
    """From when to when the fault is, s after the beginning; None where it always is."""
    if case.seconds is not None:
        return middle_s, middle_s + case.seconds
    if case.variant == "slippery":
        story = yaml.safe_load((truth_folder(path) / "trial.yaml").read_text(encoding="utf-8"))
        first_s, last_s = story["slippery_tile"]["feet_on_it_s"]
        return first_s, last_s
    return None


def _recording(name: TerrainName, seed: int, case: Case, recordings: Path) -> Path:
    """The recording of a case, simulated where it is missing."""
    nominal = recordings / f"{name}_{seed}"
    _simulated(nominal, name, seed, {}, images=True)
    if not case.variant:
        return nominal
    path = recordings / f"{name}_{seed}_{case.variant}"
    shakes = case.variant.startswith("shocks")
    is_new = _simulated(path, name, seed, case.changes or {}, images=not shakes)
    if is_new and shakes:
        _share_pictures(nominal / "mav0", path / "mav0")
    return path


def _simulated(path: Path, name: TerrainName, seed: int, changes: Mapping[str, Any], *, images: bool) -> bool:
    """See that a recording is there; whether it had to be made."""
    if path.exists():
        return False
    print(f"{path.name}: simulating", file=sys.stderr)
    simulate_recording(path, name, simulation_config(name, _JPEG, changes), seed, images=images, workers=1)
    return True


def _share_pictures(nominal: Path, shaken: Path) -> None:
    """Give a recording whose accelerometer alone differs the pictures of the nominal one.

    Raises:
        ValueError: more differs than that.
    """
    for sensor in _UNTOUCHED:
        if (nominal / sensor / "data.csv").read_bytes() != (shaken / sensor / "data.csv").read_bytes():
            raise ValueError(f"{nominal} is of another simulation than {shaken}: {sensor} differs; simulate it anew")
    for camera in _EYES:
        (shaken / camera).symlink_to((nominal / camera).resolve(), target_is_directory=True)


def summary(rows: Iterable[Row]) -> Row:
    """By trial, case and estimator: medians over seeds, failures, events, and the longest recovery."""
    rows = tuple(rows)
    nominal = {(row["trial"], row["seed"]): row["estimators"] for row in rows if row["case"] == "nominal"}
    by_trial: dict[str, dict[str, dict[str, list[Row]]]] = {}
    for row in rows:
        of_case = by_trial.setdefault(row["trial"], {}).setdefault(row["case"], {})
        for name, one in _completed(row, nominal.get((row["trial"], row["seed"]), {})).items():
            of_case.setdefault(name, []).append(one)
    return {
        trial: {case: {name: _summed(seen) for name, seen in told.items()} for case, told in cases.items()}
        for trial, cases in by_trial.items()
    }


def _completed(row: Row, nominal: Row) -> Row:
    """The estimators of a row, those too that its fault does not touch."""
    touched = {name for mode in CASES[row["case"]].touches for name in MODES[mode]}
    same = {name: {**one, "as_nominal": True} for name, one in nominal.items() if name not in touched}
    return {**same, **row["estimators"]}


def _summed(seen: list[Row]) -> Row:
    told: Row = {"seeds": len(seen), "failed": sum(one["failure"] is not None for one in seen)}
    for key in (*FIGURES, "worst_m"):
        known = [one[key] for one in seen if one.get(key) is not None]
        told[key] = float(np.median(np.abs(known))) if known else None
    asked = [one["recovery_s"] for one in seen if "recovery_s" in one]
    told["never_recovered"] = sum(one is None for one in asked)
    told["recovery_s"] = max((one for one in asked if one is not None), default=None)
    told["events"] = sum(len(one["events"]) for one in seen)
    told["as_nominal"] = all(one.get("as_nominal", False) for one in seen)
    return told


def table(told: Row) -> str:
    """The summary in Markdown: drift / RPE in percent, and the longest recovery in s; "=" is as without the fault."""
    lines = [f"| trial | fault | {' | '.join(ESTIMATORS)} |", "|---" * (2 + len(ESTIMATORS)) + "|"]
    for trial, cases in told.items():
        for case, estimators in cases.items():
            cells = [_cell(estimators[name]) if name in estimators else "" for name in ESTIMATORS]
            lines.append(f"| {trial} | {case} | {' | '.join(cells)} |")
    return "\n".join(lines)


def _cell(one: Row) -> str:
    if one["as_nominal"]:
        return "="
    if one["drift_percent"] is None:
        return "failed"
    shown = f"{one['drift_percent']:.2f} / {one['rpe_1m_percent']:.2f}"
    if one["recovery_s"] is not None:
        shown += f", {one['recovery_s']:.1f} s"
    if one["never_recovered"]:
        shown += f", {one['never_recovered']} of {one['seeds']} never"
    return shown if not one["failed"] else f"{shown}, {one['failed']} of {one['seeds']} stopped early"


def _jobs(given: argparse.Namespace, rows: list[Row]) -> Iterator[tuple[TerrainName, int, str, tuple[str, ...]]]:
    """What is missing, and the modes that miss it; the nominal run of a trial comes before its faults."""
    done = {_key(row): row["estimators"] for row in rows}
    for pair in given.trials.split(","):
        trial, _, seed = pair.partition(":")
        name: TerrainName = next(one for one in TERRAINS if one == trial)
        for called, case in CASES.items():
            there = done.get(_key({"trial": name, "seed": int(seed), "case": called}), {})
            asked = [mode for mode in case.touches if mode in given.modes.split(",")]
            missing = tuple(mode for mode in asked if not set(MODES[mode]) <= set(there))
            if missing:
                yield name, int(seed), called, missing


def _with(rows: list[Row], new: Row) -> list[Row]:
    """The rows with a new one; of a case that is among them the estimators add up."""
    same = [row for row in rows if _key(row) == _key(new)]
    estimators = {name: one for row in [*same, new] for name, one in row["estimators"].items()}
    return sorted([*(row for row in rows if _key(row) != _key(new)), {**new, "estimators": estimators}], key=_key)


def _usual(rows: list[Row], name: TerrainName, seed: int) -> Row:
    """For each estimator the 95th percentile of its errors in the nominal run of a trial, m."""
    nominal = [row["estimators"] for row in rows if _key(row) == _key({"trial": name, "seed": seed, "case": "nominal"})]
    return {key: one["usual_m"] for told in nominal for key, one in told.items() if "usual_m" in one}


def _key(row: Row) -> tuple[int, int, int]:
    return TERRAINS.index(row["trial"]), row["seed"], tuple(CASES).index(row["case"])


def _line(row: Row) -> str:
    told = [f"{row['trial']} {row['seed']}, {row['case']}:"]
    for name, one in row["estimators"].items():
        shown = one["failure"] or f"{one['drift_percent']:.2f} / {one['rpe_1m_percent']:.2f} %"
        recovery = f", {one['recovery_s']} s" if "recovery_s" in one else ""
        told.append(f"{name} {shown}{recovery}, {len(one['events'])} events;")
    return " ".join(told)


def main() -> None:
    """Run what is missing, writing after each row."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument(
        "--trials", default="ramp:12,stairs:12,flat:12,ramp:13,stairs:13", help="trial:seed, separated by commas"
    )
    parser.add_argument("--modes", default=",".join(MODES), help="separated by commas")
    parser.add_argument("--recordings", type=Path, required=True, help="where recordings are, and stay")
    parser.add_argument("-o", "--output", type=Path, default=Path("out/robustness.json"))
    given = parser.parse_args()
    given.output.parent.mkdir(parents=True, exist_ok=True)
    rows: list[Row] = json.loads(given.output.read_text())["rows"] if given.output.is_file() else []
    for name, seed, called, modes in _jobs(given, rows):
        usual = {} if called == "nominal" else _usual(rows, name, seed)
        row = suffer(name, seed, called, modes, given.recordings, usual)
        print(_line(row), file=sys.stderr)
        rows = _with(rows, row)
        text = {"summary": summary(rows), "rows": rows}
        given.output.write_text(json.dumps(text, indent=1) + "\n", encoding="utf-8")
    print(table(summary(rows)))


if __name__ == "__main__":
    main()
