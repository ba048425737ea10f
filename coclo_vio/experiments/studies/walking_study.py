# SPDX-License-Identifier: BSD-3-Clause
"""The walks of the three trials over many seeds, physics only: falls, path length, unwanted contacts, shocks.

``python -m coclo_vio.experiments.studies.walking_study --seeds 20 --workers 1 -o out/trials.json`` takes about half a
minute a trial and core. Finished trials are kept: an interrupted study continues.
"""

import json
import time
from pathlib import Path

import numpy as np

from coclo_vio.experiments.studies.study import (
    ResultFile,
    Row,
    add_seeds_and_workers,
    parser,
    report,
    run_jobs,
    seeds_of,
)
from coclo_vio.experiments.studies.touch_down_shocks import deviations, excess_kurtosis, touch_down_peaks, touch_downs
from coclo_vio.robot.description import load_robot
from coclo_vio.simulation.simulated_recording import SIMULATED_ROBOT, simulation_config, walked_m
from coclo_vio.simulation.trial.terrain import TERRAINS, TerrainName
from coclo_vio.simulation.trial.trial import Trial, simulate
from coclo_vio.values.errors import SimulationError
from coclo_vio.values.measurements import CameraImuSample, ImuSample


def walk(name: TerrainName, seed: int) -> Row:
    """The figures of one trial."""
    began = time.perf_counter()
    row: Row = {"trial": name, "seed": seed, "fell": None}
    try:
        trial = simulate(name, load_robot(SIMULATED_ROBOT), simulation_config(name).trial, seed)
    except SimulationError as error:
        return row | {"fell": str(error), "wall_s": time.perf_counter() - began}
    truth = trial.truth
    distance_m = walked_m(truth.trajectory)
    return row | {
        "duration_s": truth.trajectory.duration_s,
        "walked_m": distance_m,
        "path_length_ratio": distance_m / trial.terrain.path_length_m,
        "legs_touching_each_other": truth.self_contacts,
        "legs_touching_the_ground": truth.ground_contacts,
        "deepest_mm": 1e3 * truth.max_penetration_m,
        "accelerometer": {"body": _shocks(trial, ImuSample), "camera": _shocks(trial, CameraImuSample)},
        "wall_s": time.perf_counter() - began,
    }


def _shocks(trial: Trial, kind: type[ImuSample] | type[CameraImuSample]) -> Row:
    stamps, values = deviations(trial, kind)
    peaks = touch_down_peaks(stamps, values, touch_downs(trial))
    return {
        "excess_kurtosis": excess_kurtosis(values),
        "largest_mps2": np.abs(values).max(axis=0).tolist(),
        "touch_downs": len(peaks),
        "touch_down_median_mps2": float(np.median(peaks)),
        "touch_down_p95_mps2": float(np.percentile(peaks, 95)),
    }


def summary(rows: list[Row]) -> Row:
    """The extremes over the seeds of each trial."""
    by_trial: Row = {}
    for name in TERRAINS:
        of_name = [row for row in rows if row["trial"] == name]
        walked = [row for row in of_name if row["fell"] is None]
        by_trial[name] = {"seeds": len(of_name), "fell": len(of_name) - len(walked)}
        if walked:
            by_trial[name] |= _extremes(walked)
    return by_trial


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


def _key(row: Row) -> tuple[int, int]:
    return TERRAINS.index(row["trial"]), row["seed"]


def main() -> None:
    """Simulate what is missing, writing after each trial."""
    arguments = parser(__doc__, Path("out/trials.json"))
    add_seeds_and_workers(arguments, 20)
    options = arguments.parse_args()
    results = ResultFile(options.output, summary, _key)
    done = {(row["trial"], row["seed"]) for row in results.rows}
    jobs = [(name, seed) for seed in seeds_of(options) for name in TERRAINS if (name, seed) not in done]
    for row in run_jobs(walk, jobs, options.workers):
        report(f"{row['trial']} {row['seed']}: {row['fell'] or 'walked'} ({row['wall_s']:.0f} s)")
        results.add(row)
    print(json.dumps(results.summary(), indent=2))


if __name__ == "__main__":
    main()
