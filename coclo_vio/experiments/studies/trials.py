# SPDX-License-Identifier: BSD-3-Clause
"""Walks the three trials over many seeds, physics only: who gets to the end, how far, what touched what, what shook.

``python -m coclo_vio.experiments.studies.trials --seeds 20 --workers 1 -o out/trials.json`` (about half a minute a
trial and core).
"""

import argparse
import json
import os
import sys
import time
from collections.abc import Iterable
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before NumPy: one core a process
os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np

from coclo_vio.experiments.studies.shocks import deviations, excess_kurtosis, touch_down_peaks, touch_downs
from coclo_vio.robot.description import load_robot
from coclo_vio.simulation.simulated_recording import SIMULATED_ROBOT, simulation_config, walked_m
from coclo_vio.simulation.trial.terrain import TERRAINS, TerrainName
from coclo_vio.simulation.trial.trial import Trial, simulate
from coclo_vio.values.errors import SimulationError
from coclo_vio.values.measurements import CameraImuSample, ImuSample

Row = dict[str, Any]


def walk(name: TerrainName, seed: int) -> Row:
    """One trial in figures."""
    began = time.perf_counter()
    row: Row = {"trial": name, "seed": seed, "fell": None}
    try:
        trial = simulate(name, load_robot(SIMULATED_ROBOT), simulation_config(name).trial, seed)
    except SimulationError as error:
        return row | {"fell": str(error), "wall_s": time.perf_counter() - began}
    truth = trial.truth
    came_m = walked_m(truth.trajectory)
    return row | {
        "duration_s": truth.trajectory.duration_s,
        "walked_m": came_m,
        "path_length_ratio": came_m / trial.terrain.path_length_m,
        "legs_touching_each_other": truth.self_contacts,
        "legs_touching_the_ground": truth.ground_contacts,
        "deepest_mm": 1e3 * truth.deepest_m,
        "accelerometer": {"body": _shaking(trial, ImuSample), "camera": _shaking(trial, CameraImuSample)},
        "wall_s": time.perf_counter() - began,
    }


def _shaking(trial: Trial, kind: type[ImuSample] | type[CameraImuSample]) -> Row:
    stamps, values = deviations(trial, kind)
    peaks = touch_down_peaks(stamps, values, touch_downs(trial))
    return {
        "excess_kurtosis": excess_kurtosis(values),
        "largest_mps2": np.abs(values).max(axis=0).tolist(),
        "touch_downs": len(peaks),
        "touch_down_median_mps2": float(np.median(peaks)),
        "touch_down_p95_mps2": float(np.percentile(peaks, 95)),
    }


def summary(rows: Iterable[Row]) -> dict[str, Row]:
    """The worst of each trial's seeds."""
    told: dict[str, Row] = {}
    for name in TERRAINS:
        of_name = [row for row in rows if row["trial"] == name]
        walked = [row for row in of_name if row["fell"] is None]
        told[name] = {"seeds": len(of_name), "fell": len(of_name) - len(walked)}
        if walked:
            told[name] |= _extremes(walked)
    return told


def _extremes(walked: list[Row]) -> Row:
    ratios = [row["path_length_ratio"] for row in walked]
    kurtosis = {
        imu: [max(row["accelerometer"][imu]["excess_kurtosis"]) for row in walked] for imu in ("body", "camera")
    }
    peaks = {imu: [row["accelerometer"][imu]["touch_down_median_mps2"] for row in walked] for imu in kurtosis}
    return {
        "path_length_ratio": [min(ratios), max(ratios)],
        "duration_s": [min(row["duration_s"] for row in walked), max(row["duration_s"] for row in walked)],
        "legs_touching_each_other": sum(row["legs_touching_each_other"] for row in walked),
        "legs_touching_the_ground": sum(row["legs_touching_the_ground"] for row in walked),
        "most_touching_the_ground": max(row["legs_touching_the_ground"] for row in walked),
        "deepest_mm": max(row["deepest_mm"] for row in walked),
        "least_excess_kurtosis_of_the_heaviest_tail": {imu: min(values) for imu, values in kurtosis.items()},
        "touch_down_median_mps2": {imu: float(np.median(values)) for imu, values in peaks.items()},
        "wall_s_median": float(np.median([row["wall_s"] for row in walked])),
    }


def main() -> None:
    """Walk, and write what came of it after each trial."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--seeds", type=int, default=20, help="how many")
    parser.add_argument("--first-seed", type=int, default=1)
    parser.add_argument("--workers", type=int, default=1, help="processes")
    parser.add_argument("-o", "--output", type=Path, default=Path("out/trials.json"))
    given = parser.parse_args()
    given.output.parent.mkdir(parents=True, exist_ok=True)
    rows: list[Row] = []
    with ProcessPoolExecutor(given.workers, get_context("spawn")) as pool:
        seeds = range(given.first_seed, given.first_seed + given.seeds)
        jobs = [pool.submit(walk, name, seed) for seed in seeds for name in TERRAINS]
        for job in as_completed(jobs):
            rows.append(job.result())
            row = rows[-1]
            print(f"{row['trial']} {row['seed']}: {row['fell'] or 'walked'} ({row['wall_s']:.0f} s)", file=sys.stderr)
            rows.sort(key=lambda row: (TERRAINS.index(row["trial"]), row["seed"]))
            told = {"summary": summary(rows), "trials": rows}
            given.output.write_text(json.dumps(told, indent=2) + "\n", encoding="utf-8")
    print(json.dumps(summary(rows), indent=2))


if __name__ == "__main__":
    main()
