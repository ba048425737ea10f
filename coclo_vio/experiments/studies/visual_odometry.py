# SPDX-License-Identifier: BSD-3-Clause
"""Seeing on the simulated trials over many seeds: ``vins`` and ``stereo`` against noisy Vicon, and against the truth.

``python -m coclo_vio.experiments.studies.visual_odometry --ideal --first-seed 11 -o out/visual_odometry.json``: what
``coclo-vio run`` and
``coclo-vio evaluate`` do, images and all; a minute and a half a trial and core for both modes, and three to simulate
one that is not there. Finished trials are kept: a run that was stopped goes on where it was. ``--recordings DIR`` uses
the recordings in DIR, and leaves there what it has to simulate; without it they are deleted once they have been seen.
Images are JPEG, a third as large as PNG and a little harder to see with.
"""

import argparse
import json
import os
import sys
import time
from collections import Counter
from collections.abc import Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before NumPy: one core a process
os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np

from coclo_vio.evaluation.clock import ClockConfig
from coclo_vio.evaluation.evaluate import EvaluationConfig
from coclo_vio.evaluation.records import EvaluationRecord
from coclo_vio.runs import comparison
from coclo_vio.runs.run_config import resolve
from coclo_vio.simulation.simulated_recording import (
    IDEAL_ROBOT,
    SIMULATED_ROBOT,
    simulate_recording,
    simulation_config,
    truth_folder,
)
from coclo_vio.simulation.trial.terrain import TERRAINS, TerrainName
from coclo_vio.values.trajectory import GroundTruth, read_tum
from coclo_vio.values.units import MS_PER_S

Row = dict[str, Any]
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
_JPEG = {"camera": {"encoding": "jpeg"}}
# The truth is exact and on the recording's own clock: nothing of either is to be estimated.
_AGAINST_TRUTH = EvaluationConfig(
    clock=ClockConfig(offset_s=0.0), ground_truth_rotation_noise_rad=0.0, ground_truth_position_noise_m=0.0
)


def see(name: TerrainName, seed: int, modes: tuple[str, ...], *, ideal: bool, recordings: Path | None) -> Row:
    """One trial through every mode."""
    with _recording(name, seed, ideal=ideal, recordings=recordings) as path:
        return {"trial": name, "seed": seed, "ideal": ideal, "modes": {mode: _see(path, mode) for mode in modes}}


def _see(path: Path, mode: str) -> Row:
    """A recording through one mode, and its estimates against both references."""
    config = resolve(SIMULATED_ROBOT)
    with TemporaryDirectory() as scratch:
        folder, began_s = Path(scratch), time.process_time()
        told = comparison.run_all(path, [mode], config, folder)["estimators"][mode]
        cpu_s = time.process_time() - began_s
        true = GroundTruth(read_tum(truth_folder(path) / "groundtruth.tum"), True, "truth")
        against = {
            "vicon": comparison.evaluate_run(folder, config.evaluation),
            "truth": comparison.evaluate_run(folder, _AGAINST_TRUTH, true),
        }
    seen = _health(told, cpu_s)
    for reference, (evaluations, failures) in against.items():
        if mode in evaluations:
            figures = EvaluationRecord.of(evaluations[mode]).to_json()
            seen[reference] = {key: figures[key] for key in FIGURES}
        else:
            seen |= {reference: None, "failure": failures[mode]}
    return seen


@contextmanager
def _recording(name: TerrainName, seed: int, *, ideal: bool, recordings: Path | None) -> Iterator[Path]:
    """The recording of a trial, simulated where it is missing; it stays where there is a folder for it."""
    called = f"{name}_{seed}_{'ideal' if ideal else 'real'}"
    with TemporaryDirectory() as scratch:
        path = (recordings or Path(scratch)) / called
        if not path.exists():
            changes = (IDEAL_ROBOT, _JPEG) if ideal else (_JPEG,)
            print(f"{name} {seed}: simulating", file=sys.stderr)
            simulate_recording(path, name, simulation_config(name, *changes), seed, workers=1)
        yield path


def _health(told: Row, cpu_s: float) -> Row:
    """How a run fared; its processor time holds reading, decoding and writing too."""
    frames = told["counts"].get("frames", 0)
    return {
        "frames": frames,
        "estimates": told["estimates"],
        "cpu_ms_per_frame": MS_PER_S * cpu_s / frames if frames else None,
        "keyframes": told["keyframes"],
        "counts": told["counts"],
        "events": told["events"],
        "failure": told["failure"],
    }


def summary(rows: Iterable[Row]) -> Row:
    """Median and worst over seeds, by robot, trial and mode."""
    by_trial: dict[str, dict[str, list[Row]]] = {}
    for row in rows:
        of_trial = by_trial.setdefault(f"{'ideal' if row['ideal'] else 'imperfect'} {row['trial']}", {})
        for mode, seen in row["modes"].items():
            of_trial.setdefault(mode, []).append(seen)
    return {trial: {mode: _summed(seen) for mode, seen in modes.items()} for trial, modes in by_trial.items()}


def _summed(seen: list[Row]) -> Row:
    timed = [one["cpu_ms_per_frame"] for one in seen if one["cpu_ms_per_frame"] is not None]
    solved = [one["keyframes"]["compute_ms_median"] for one in seen if one["keyframes"] is not None]
    return {
        "seeds": len(seen),
        "failed": sum(one["failure"] is not None for one in seen),
        **{
            reference: _spread([one[reference] for one in seen if one[reference] is not None])
            for reference in ("vicon", "truth")
        },
        "cpu_ms_per_frame": float(np.median(timed)) if timed else None,
        "keyframe_ms": float(np.median(solved)) if solved else None,
        "keyframes": [one["keyframes"]["count"] for one in seen if one["keyframes"] is not None],
        "events": dict(Counter(event["kind"] for one in seen for event in one["events"])),
    }


def _spread(figures: list[Row]) -> Row | None:
    """Median and worst of each figure: of yaw by its size, of coverage the least, of ratios the farthest from one."""
    if not figures:
        return None
    told: Row = {}
    for key in FIGURES:
        known = np.array([one[key] for one in figures if one[key] is not None])
        known = np.abs(known) if key == "yaw_drift_deg" else known
        if not len(known):
            continue
        bad = {"coverage": -known, "path_length_ratio": np.abs(known - 1.0)}.get(key, known)
        told[key] = {"median": float(np.median(known)), "worst": float(known[np.argmax(bad)])}
    return told


def _key(row: Row) -> tuple[bool, int, int]:
    return not row["ideal"], TERRAINS.index(row["trial"]), row["seed"]


def _with(rows: list[Row], new: Row) -> list[Row]:
    """The rows with a new one; of a trial that is among them the modes add up."""
    same = [row for row in rows if _key(row) == _key(new)]
    modes = {mode: seen for row in [*same, new] for mode, seen in row["modes"].items()}
    return sorted([*(row for row in rows if _key(row) != _key(new)), {**new, "modes": modes}], key=_key)


def _jobs(given: argparse.Namespace, rows: list[Row]) -> Iterator[tuple[TerrainName, int, tuple[str, ...]]]:
    """Trials that lack a mode, and the modes that they lack."""
    done = {(row["trial"], row["seed"]): row["modes"] for row in rows if row["ideal"] == given.ideal}
    for seed in range(given.first_seed, given.first_seed + given.seeds):
        for name in TERRAINS:
            missing = tuple(mode for mode in given.modes.split(",") if mode not in done.get((name, seed), {}))
            if missing and name in given.trials.split(","):
                yield name, seed, missing


def _line(row: Row) -> str:
    told = [f"{row['trial']} {row['seed']}:"]
    for mode, seen in row["modes"].items():
        true = seen["truth"]
        shown = seen["failure"] if true is None else f"{true['drift_percent']:.2f} / {true['rpe_1m_percent']:.2f} %"
        told.append(f"{mode} {shown}, {len(seen['events'])} events;")
    return " ".join(told)


def main() -> None:
    """Run what is missing, writing after each trial."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--seeds", type=int, default=10, help="how many")
    parser.add_argument("--first-seed", type=int, default=1)
    parser.add_argument("--trials", default=",".join(TERRAINS), help="separated by commas")
    parser.add_argument("--modes", default="vins,stereo", help="separated by commas")
    parser.add_argument("--ideal", action="store_true", help="the robot, its cameras too, as its description says")
    parser.add_argument("--recordings", type=Path, help="where recordings are, and stay; made and deleted without it")
    parser.add_argument("--workers", type=int, default=1, help="processes")
    parser.add_argument("-o", "--output", type=Path, default=Path("out/visual_odometry.json"))
    given = parser.parse_args()
    given.output.parent.mkdir(parents=True, exist_ok=True)
    rows: list[Row] = json.loads(given.output.read_text())["trials"] if given.output.is_file() else []
    with ProcessPoolExecutor(given.workers, get_context("spawn")) as pool:
        jobs = [
            pool.submit(see, name, seed, modes, ideal=given.ideal, recordings=given.recordings)
            for name, seed, modes in _jobs(given, rows)
        ]
        for job in as_completed(jobs):
            row = job.result()
            print(_line(row), file=sys.stderr)
            rows = _with(rows, row)
            text = {"summary": summary(rows), "trials": rows}
            given.output.write_text(json.dumps(text, indent=1) + "\n", encoding="utf-8")
    print(json.dumps(summary(rows), indent=2))


if __name__ == "__main__":
    main()
