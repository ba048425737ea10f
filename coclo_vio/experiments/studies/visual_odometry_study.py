# SPDX-License-Identifier: BSD-3-Clause
"""Visual odometry on the simulated trials over many seeds: ``vins`` and ``stereo`` against noisy Vicon and the truth.

``python -m coclo_vio.experiments.studies.visual_odometry_study --ideal --first-seed 11 -o out/visual_odometry.json``
does the same as ``coclo-vio run`` and ``coclo-vio evaluate``, with images; a minute and a half a trial and core for
both modes, and three to simulate a missing recording. Finished trials are kept: an interrupted study continues.
``--recordings DIR`` uses the recordings in DIR and keeps there those that it simulates; without it each is deleted
after its trial. Images are JPEG, a third as large as PNG and a little harder to track.
"""

import argparse
import json
import time
from collections import Counter
from collections.abc import Iterable, Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from coclo_vio.evaluation.evaluation_record import EvaluationRecord
from coclo_vio.experiments.studies.study import (
    AGAINST_TRUTH,
    JPEG,
    ResultFile,
    Row,
    add_seeds_and_workers,
    parser,
    report,
    run_jobs,
    seeds_of,
    simulate_if_missing,
)
from coclo_vio.runs.evaluating import evaluate_run
from coclo_vio.runs.run_config import resolve
from coclo_vio.runs.run_record import TrajectoryRecord
from coclo_vio.runs.running import run_modes
from coclo_vio.simulation.simulated_recording import (
    IDEAL_ROBOT,
    SIMULATED_ROBOT,
    simulation_config,
    truth_folder,
)
from coclo_vio.simulation.trial.terrain import TERRAINS, TerrainName
from coclo_vio.values.trajectory import GroundTruth, read_tum
from coclo_vio.values.units import MS_PER_S

FIGURES = (
    "drift_percent",
    "rpe_1m_percent",
    "ate_m",
    "yaw_drift_deg",
    "path_length_ratio",
    "velocity_rmse_mps",
    "anees_pose",
    "coverage",
)


def run_trial(name: TerrainName, seed: int, modes: tuple[str, ...], ideal: bool, recordings: Path | None) -> Row:
    """One trial through every mode; its recording is kept if there is a folder for recordings."""
    with TemporaryDirectory() as scratch:
        path = (recordings or Path(scratch)) / f"{name}_{seed}_{'ideal' if ideal else 'real'}"
        changes = (IDEAL_ROBOT, JPEG) if ideal else (JPEG,)
        simulate_if_missing(path, name, seed, simulation_config(name, *changes))
        return {"trial": name, "seed": seed, "ideal": ideal, "modes": {mode: _run_mode(path, mode) for mode in modes}}


def _run_mode(path: Path, mode: str) -> Row:
    """A recording through one mode, and its estimates against both references."""
    config = resolve(SIMULATED_ROBOT)
    with TemporaryDirectory() as scratch:
        folder, began_s = Path(scratch), time.process_time()
        record = run_modes(path, [mode], config, folder).estimators[mode]
        cpu_s = time.process_time() - began_s
        truth = GroundTruth(read_tum(truth_folder(path) / "groundtruth.tum"), True, "truth")
        against = {
            "vicon": evaluate_run(folder, config.evaluation),
            "truth": evaluate_run(folder, AGAINST_TRUTH, truth),
        }
    result = _health(record, cpu_s)
    for reference, (evaluations, failures) in against.items():
        if mode in evaluations:
            figures = EvaluationRecord.of(evaluations[mode]).to_json()
            result[reference] = {key: figures[key] for key in FIGURES}
        else:
            result |= {reference: None, "failure": failures[mode]}
    return result


def _health(record: TrajectoryRecord, cpu_s: float) -> Row:
    """How a run fared; its processor time includes reading, decoding and writing."""
    frames = record.counts.get("frames", 0)
    kept = record.model_dump(mode="json", include={"estimates", "keyframes", "counts", "events", "failure"})
    return {"frames": frames, "cpu_ms_per_frame": MS_PER_S * cpu_s / frames if frames else None, **kept}


def summary(rows: Iterable[Row]) -> Row:
    """Median and worst over seeds, by robot, trial and mode."""
    by_trial: dict[str, dict[str, list[Row]]] = {}
    for row in rows:
        of_trial = by_trial.setdefault(f"{'ideal' if row['ideal'] else 'imperfect'} {row['trial']}", {})
        for mode, result in row["modes"].items():
            of_trial.setdefault(mode, []).append(result)
    return {trial: {mode: _summed(results) for mode, results in modes.items()} for trial, modes in by_trial.items()}


def _summed(results: list[Row]) -> Row:
    timed = [each["cpu_ms_per_frame"] for each in results if each["cpu_ms_per_frame"] is not None]
    solved = [each["keyframes"]["compute_ms_median"] for each in results if each["keyframes"] is not None]
    return {
        "seeds": len(results),
        "failed": sum(each["failure"] is not None for each in results),
        **{
            reference: _spread([each[reference] for each in results if each[reference] is not None])
            for reference in ("vicon", "truth")
        },
        "cpu_ms_per_frame": float(np.median(timed)) if timed else None,
        "keyframe_ms": float(np.median(solved)) if solved else None,
        "keyframes": [each["keyframes"]["count"] for each in results if each["keyframes"] is not None],
        "events": dict(Counter(event["kind"] for each in results for event in each["events"])),
    }


def _spread(figures: list[Row]) -> Row | None:
    """Median and worst of each figure: of yaw the largest, of coverage the least, of ratios the farthest from 1."""
    if not figures:
        return None
    spread: Row = {}
    for key in FIGURES:
        known = np.array([each[key] for each in figures if each[key] is not None])
        known = np.abs(known) if key == "yaw_drift_deg" else known
        if not len(known):
            continue
        badness = {"coverage": -known, "path_length_ratio": np.abs(known - 1.0)}.get(key, known)
        spread[key] = {"median": float(np.median(known)), "worst": float(known[np.argmax(badness)])}
    return spread


def _key(row: Row) -> tuple[int, int, int]:
    return int(not row["ideal"]), TERRAINS.index(row["trial"]), row["seed"]


def _missing(options: argparse.Namespace, rows: list[Row]) -> Iterator[tuple[TerrainName, int, tuple[str, ...]]]:
    """Trials without a result of some mode, and those modes."""
    done = {(row["trial"], row["seed"]): row["modes"] for row in rows if row["ideal"] == options.ideal}
    for seed in seeds_of(options):
        for name in TERRAINS:
            missing = tuple(mode for mode in options.modes.split(",") if mode not in done.get((name, seed), {}))
            if missing and name in options.trials.split(","):
                yield name, seed, missing


def _line(row: Row) -> str:
    parts = [f"{row['trial']} {row['seed']}:"]
    for mode, result in row["modes"].items():
        truth = result["truth"]
        figures = (
            result["failure"] if truth is None else f"{truth['drift_percent']:.2f} / {truth['rpe_1m_percent']:.2f} %"
        )
        parts.append(f"{mode} {figures}, {len(result['events'])} events;")
    return " ".join(parts)


def main() -> None:
    """Run what is missing, writing after each trial."""
    arguments = parser(__doc__, Path("out/visual_odometry.json"))
    add_seeds_and_workers(arguments, 10)
    arguments.add_argument("--trials", default=",".join(TERRAINS), help="separated by commas")
    arguments.add_argument("--modes", default="vins,stereo", help="separated by commas")
    arguments.add_argument(
        "--ideal", action="store_true", help="a robot, with its cameras, that equals its description"
    )
    arguments.add_argument("--recordings", type=Path, help="folder in which recordings are kept; none are without it")
    options = arguments.parse_args()
    results = ResultFile(options.output, summary, _key, parts="modes")
    jobs = [(*missing, options.ideal, options.recordings) for missing in _missing(options, results.rows)]
    for row in run_jobs(run_trial, jobs, options.workers):
        report(_line(row))
        results.add(row)
    print(json.dumps(results.summary(), indent=2))


if __name__ == "__main__":
    main()
