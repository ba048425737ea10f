# SPDX-License-Identifier: BSD-3-Clause
"""Robustness: ``coclo``, ``vins`` and ``combined`` with and without faults, against the exact truth.

``python -m coclo_vio.experiments.studies.robustness_study --recordings DIR -o out/robustness.json``: recordings are
DIR/<trial>_<seed>, with another ground DIR/<trial>_<seed>_slippery, with larger shocks DIR/<trial>_<seed>_shocks3 and
..._shocks10; missing ones are simulated and kept there. Finished cases are kept: an interrupted study continues, and
the results of separate ``--modes`` add up. An estimator that reads no sensor with a fault has the figures of the
nominal run, and is not run again.

Recovery. The error at a time is the error of the motion over the second before it, m: the translation of the estimated
motion less the true one. An estimator has recovered at the first time, on a grid of 0.1 s from the end of the fault
on, from which that error stays for 1 s within the 95th percentile of the same estimator's errors in the nominal run
of the same trial and seed. If the trial ends within that second there is no recovery. So a fault without effect has a
recovery of 0 s, and one whose effect ends with it about 1 s, the length of the window.
"""

import argparse
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import yaml

from coclo_vio.evaluation.evaluation_record import EvaluationRecord
from coclo_vio.evaluation.metrics import relative_errors_m
from coclo_vio.experiments.studies.study import (
    AGAINST_TRUTH,
    JPEG,
    ResultFile,
    Row,
    parser,
    report,
    simulate_if_missing,
)
from coclo_vio.runs.evaluating import evaluate_run
from coclo_vio.runs.run_config import resolve
from coclo_vio.runs.run_folder import read_estimates
from coclo_vio.runs.running import run_modes
from coclo_vio.simulation.simulated_recording import (
    SIMULATED_ROBOT,
    simulation_config,
    truth_folder,
)
from coclo_vio.simulation.trial.terrain import TERRAINS, TerrainName
from coclo_vio.values.arrays import Array
from coclo_vio.values.trajectory import GroundTruth, Trajectory, read_tum
from coclo_vio.values.units import NS_PER_S

Span = tuple[float, float]
MODES: Mapping[str, tuple[str, ...]] = {
    "coclo": ("coclo",),
    "vins": ("vins",),
    "combined": ("combined_coclo", "combined_vins"),
}
ESTIMATORS = tuple(name for names in MODES.values() for name in names)
FIGURES = ("drift_percent", "rpe_1m_percent", "ate_m", "yaw_drift_deg", "anees_pose", "coverage")
_UNCHANGED = ("imu0", "joints0")  # sensors of a recording with other shocks
_CAMERAS = ("cam0", "cam1")
_GRID_NS, _WINDOW_NS = NS_PER_S // 10, NS_PER_S
_HOLD_S = 1.0  # time within the limit that makes a recovery
_PERCENTILE = 95.0  # of the nominal errors: the limit


@dataclass(frozen=True)
class Case:
    """A fault.

    Attributes:
        touches: the modes that read a sensor with the fault.
        settings: of the run; MID is the middle of the recording, s.
        seconds: its duration from MID on; None where it has no end, or where the recording's truth holds its time.
        variant: of the recording; empty for the nominal one.
        changes: of the simulation of the variant.
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


def run_case(
    name: TerrainName, seed: int, case_name: str, modes: tuple[str, ...], recordings: Path, usual: Mapping[str, float]
) -> Row:
    """One trial with one fault through some modes.

    Args:
        name: the trial.
        seed: of the trial.
        case_name: the case.
        modes: with a sensor of the fault.
        recordings: folder in which recordings are kept.
        usual: for each estimator the 95th percentile of its errors without a fault, m; empty for the nominal case.
    """
    case = CASES[case_name]
    path = _recording(name, seed, case, recordings)
    truth = read_tum(truth_folder(path) / "groundtruth.tum")
    middle_s = round(0.5 * truth.duration_s)
    fault_s = _fault_span(case, middle_s, path)
    settings = [setting.replace("MID", str(middle_s)) for setting in case.settings]
    estimators: Row = {}
    for mode in modes:
        estimators |= _run(path, mode, settings, GroundTruth(truth, True, "truth"), fault_s, usual)
    return {"trial": name, "seed": seed, "case": case_name, "fault_s": fault_s, "estimators": estimators}


def _run(
    path: Path, mode: str, settings: list[str], truth: GroundTruth, fault_s: Span | None, usual: Mapping[str, float]
) -> Row:
    """Every estimator of a mode on a recording."""
    results: Row = {}
    with TemporaryDirectory() as scratch:
        folder = Path(scratch)
        records = run_modes(path, [mode], resolve(SIMULATED_ROBOT, settings=settings), folder).estimators
        evaluations, failures = evaluate_run(folder, AGAINST_TRUTH, truth)
        for name in MODES[mode]:
            record = records[name]
            events = [event.model_dump(mode="json") for event in record.events]
            result: Row = {"failure": failures.get(name, record.failure), "events": events}
            if name in evaluations:
                figures = EvaluationRecord.of(evaluations[name]).to_json()
                times_s, errors_m = error_history(read_estimates(folder, name).trajectory, truth.trajectory)
                result |= {key: figures[key] for key in FIGURES} | {
                    "usual_m": float(np.percentile(errors_m, _PERCENTILE))
                }
                if fault_s is not None and name in usual:
                    result["recovery_s"] = recovery_s(times_s, errors_m, fault_s[1], usual[name])
                    during = (times_s > fault_s[0]) & (times_s <= fault_s[1] + _HOLD_S)
                    result["worst_m"] = float(errors_m[during].max(initial=0.0))
            results[name] = result
    return results


def error_history(estimate: Trajectory, truth: Trajectory) -> tuple[Array, Array]:
    """Times, s after the truth's first, and the error of the motion in the second before each, m."""
    first_ns = max(int(estimate.stamps_ns[0]), int(truth.stamps_ns[0]))
    last_ns = min(int(estimate.stamps_ns[-1]), int(truth.stamps_ns[-1]))
    origin_ns = int(truth.stamps_ns[0])
    begin_ns = origin_ns + -(-(first_ns - origin_ns) // _GRID_NS) * _GRID_NS
    stamps = np.arange(begin_ns, last_ns + 1, _GRID_NS, dtype=np.int64)
    apart = _WINDOW_NS // _GRID_NS
    pairs = np.stack((np.arange(len(stamps) - apart), np.arange(apart, len(stamps))), axis=1)
    errors_m = relative_errors_m(estimate.interpolated(stamps), truth.interpolated(stamps), pairs)
    return (stamps[apart:] - origin_ns) / NS_PER_S, errors_m


def recovery_s(times_s: Array, errors_m: Array, end_s: float, usual_m: float) -> float | None:
    """Time after ``end_s`` from which the errors stay within ``usual_m`` for a second, s; None if never."""
    steps = round(_HOLD_S * NS_PER_S / _GRID_NS)
    for start in np.flatnonzero(times_s >= end_s - 1e-9):
        ahead = errors_m[start : start + steps + 1]
        if len(ahead) <= steps:
            return None
        if (ahead <= usual_m).all():
            return max(round(float(times_s[start]) - end_s, 3), 0.0)
    return None


def _fault_span(case: Case, middle_s: float, path: Path) -> Span | None:
    """Begin and end of the fault, s after the beginning; None where it has none."""
    if case.seconds is not None:
        return middle_s, middle_s + case.seconds
    if case.variant == "slippery":
        record = yaml.safe_load((truth_folder(path) / "trial.yaml").read_text(encoding="utf-8"))
        first_s, last_s = record["slippery_tile"]["feet_on_it_s"]
        return first_s, last_s
    return None


def _recording(name: TerrainName, seed: int, case: Case, recordings: Path) -> Path:
    """The recording of a case, simulated where it is missing."""
    nominal = recordings / f"{name}_{seed}"
    simulate_if_missing(nominal, name, seed, simulation_config(name, JPEG))
    if not case.variant:
        return nominal
    path = recordings / f"{name}_{seed}_{case.variant}"
    has_shocks = case.variant.startswith("shocks")
    config = simulation_config(name, JPEG, case.changes or {})
    if simulate_if_missing(path, name, seed, config, images=not has_shocks) and has_shocks:
        _share_images(nominal / "mav0", path / "mav0")
    return path


def _share_images(nominal: Path, variant: Path) -> None:
    """Link the images of the nominal recording into one that differs only in its accelerometer.

    Raises:
        ValueError: more differs than that.
    """
    for sensor in _UNCHANGED:
        if (nominal / sensor / "data.csv").read_bytes() != (variant / sensor / "data.csv").read_bytes():
            raise ValueError(f"{nominal} is of another simulation than {variant}: {sensor} differs; remove both")
    for camera in _CAMERAS:
        (variant / camera).symlink_to((nominal / camera).resolve(), target_is_directory=True)


def summary(rows: Iterable[Row]) -> Row:
    """By trial, case and estimator: medians over seeds, failures, events, and the longest recovery."""
    rows = tuple(rows)
    nominal = {(row["trial"], row["seed"]): row["estimators"] for row in rows if row["case"] == "nominal"}
    by_trial: dict[str, dict[str, dict[str, list[Row]]]] = {}
    for row in rows:
        of_case = by_trial.setdefault(row["trial"], {}).setdefault(row["case"], {})
        for name, result in _completed(row, nominal.get((row["trial"], row["seed"]), {})).items():
            of_case.setdefault(name, []).append(result)
    return {
        trial: {
            case: {name: _summed(results) for name, results in estimators.items()} for case, estimators in cases.items()
        }
        for trial, cases in by_trial.items()
    }


def _completed(row: Row, nominal: Row) -> Row:
    """The estimators of a row, with the nominal results of those that read no sensor with the fault."""
    touched = {name for mode in CASES[row["case"]].touches for name in MODES[mode]}
    same = {name: {**result, "as_nominal": True} for name, result in nominal.items() if name not in touched}
    return {**same, **row["estimators"]}


def _summed(results: list[Row]) -> Row:
    summed: Row = {"seeds": len(results), "failed": sum(each["failure"] is not None for each in results)}
    for key in (*FIGURES, "worst_m"):
        known = [each[key] for each in results if each.get(key) is not None]
        summed[key] = float(np.median(np.abs(known))) if known else None
    recoveries = [each["recovery_s"] for each in results if "recovery_s" in each]
    summed["never_recovered"] = sum(each is None for each in recoveries)
    summed["recovery_s"] = max((each for each in recoveries if each is not None), default=None)
    summed["events"] = sum(len(each["events"]) for each in results)
    summed["as_nominal"] = all(each.get("as_nominal", False) for each in results)
    return summed


def table(by_trial: Row) -> str:
    """The summary in Markdown: drift / RPE in percent, the longest recovery in s; "=" is equal to the nominal run."""
    lines = [f"| trial | fault | {' | '.join(ESTIMATORS)} |", "|---" * (2 + len(ESTIMATORS)) + "|"]
    for trial, cases in by_trial.items():
        for case, estimators in cases.items():
            cells = [_cell(estimators[name]) if name in estimators else "" for name in ESTIMATORS]
            lines.append(f"| {trial} | {case} | {' | '.join(cells)} |")
    return "\n".join(lines)


def _cell(figures: Row) -> str:
    if figures["as_nominal"]:
        return "="
    if figures["drift_percent"] is None:
        return "failed"
    text = f"{figures['drift_percent']:.2f} / {figures['rpe_1m_percent']:.2f}"
    if figures["recovery_s"] is not None:
        text += f", {figures['recovery_s']:.1f} s"
    if figures["never_recovered"]:
        text += f", {figures['never_recovered']} of {figures['seeds']} never"
    return text if not figures["failed"] else f"{text}, {figures['failed']} of {figures['seeds']} stopped early"


def _missing(options: argparse.Namespace, rows: list[Row]) -> Iterator[tuple[TerrainName, int, str, tuple[str, ...]]]:
    """Cases without a result of some mode, and those modes; the nominal case of a trial comes before its faults."""
    done = {_key(row): row["estimators"] for row in rows}
    for pair in options.trials.split(","):
        trial, _, seed = pair.partition(":")
        name: TerrainName = next(terrain for terrain in TERRAINS if terrain == trial)
        for case_name, case in CASES.items():
            finished = done.get(_key({"trial": name, "seed": int(seed), "case": case_name}), {})
            chosen = [mode for mode in case.touches if mode in options.modes.split(",")]
            missing = tuple(mode for mode in chosen if not set(MODES[mode]) <= set(finished))
            if missing:
                yield name, int(seed), case_name, missing


def _usual(rows: list[Row], name: TerrainName, seed: int) -> Row:
    """For each estimator the 95th percentile of its errors in the nominal run of a trial, m."""
    nominal = [row["estimators"] for row in rows if _key(row) == _key({"trial": name, "seed": seed, "case": "nominal"})]
    return {key: result["usual_m"] for results in nominal for key, result in results.items() if "usual_m" in result}


def _key(row: Row) -> tuple[int, int, int]:
    return TERRAINS.index(row["trial"]), row["seed"], tuple(CASES).index(row["case"])


def _line(row: Row) -> str:
    parts = [f"{row['trial']} {row['seed']}, {row['case']}:"]
    for name, result in row["estimators"].items():
        figures = result["failure"] or f"{result['drift_percent']:.2f} / {result['rpe_1m_percent']:.2f} %"
        recovery = f", {result['recovery_s']} s" if "recovery_s" in result else ""
        parts.append(f"{name} {figures}{recovery}, {len(result['events'])} events;")
    return " ".join(parts)


def main() -> None:
    """Run what is missing, writing after each case."""
    arguments = parser(__doc__, Path("out/robustness.json"))
    arguments.add_argument(
        "--trials", default="ramp:12,stairs:12,flat:12,ramp:13,stairs:13", help="trial:seed, separated by commas"
    )
    arguments.add_argument("--modes", default=",".join(MODES), help="separated by commas")
    arguments.add_argument("--recordings", type=Path, required=True, help="folder in which recordings are kept")
    options = arguments.parse_args()
    results = ResultFile(options.output, summary, _key, parts="estimators", rows_name="rows")
    for name, seed, case_name, modes in _missing(options, results.rows):
        usual = {} if case_name == "nominal" else _usual(results.rows, name, seed)
        row = run_case(name, seed, case_name, modes, options.recordings, usual)
        report(_line(row))
        results.add(row)
    print(table(results.summary()))


if __name__ == "__main__":
    main()
