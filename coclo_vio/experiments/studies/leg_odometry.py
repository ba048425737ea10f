# SPDX-License-Identifier: BSD-3-Clause
"""Leg odometry on the simulated trials over many seeds, against noisy Vicon and against true contacts.

``python -m coclo_vio.experiments.studies.leg_odometry --first-seed 11 --workers 2 -o out/leg_odometry.json`` (about
a minute and
a half a trial and core). Finished trials are kept: a run that was stopped goes on where it was. ``--ideal`` takes a
robot that is as its description says.
"""

import argparse
import json
import os
import sys
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before NumPy: one core a process
os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np

from coclo_vio.evaluation.evaluate import evaluate
from coclo_vio.evaluation.records import EvaluationRecord
from coclo_vio.robot.description import load_robot
from coclo_vio.robot.model import RobotModel
from coclo_vio.runs import pipeline
from coclo_vio.runs.equipment import Equipment
from coclo_vio.runs.estimators import make_estimator
from coclo_vio.runs.run_config import resolve
from coclo_vio.simulation.simulated_recording import IDEAL_ROBOT, SIMULATED_ROBOT, simulation_config, walked_m
from coclo_vio.simulation.trial.terrain import TERRAINS, TerrainName
from coclo_vio.simulation.trial.trial import Trial, simulate
from coclo_vio.values.estimates import StateEstimate
from coclo_vio.values.trajectory import Trajectory

Row = dict[str, Any]
FIGURES = (
    "drift_percent",
    "rpe_1m_percent",
    "ate_m",
    "yaw_drift_deg",
    "path_length_ratio",
    "anees_pose",
    "contact_right",
)
_NEAR_CHANGE_NS = 30_000_000  # impact and lift-off: who is right so close to a change is not asked


def compare(name: TerrainName, seed: int, modes: tuple[str, ...], *, ideal: bool) -> Row:
    """One trial, every mode."""
    changes = (IDEAL_ROBOT,) if ideal else ()
    trial = simulate(name, load_robot(SIMULATED_ROBOT), simulation_config(name, *changes).trial, seed)
    truth = trial.truth
    walk = {
        "path_length_ratio": walked_m(truth.trajectory) / trial.terrain.path_length_m,
        "legs_touching_each_other": truth.self_contacts,
        "legs_touching_the_ground": truth.ground_contacts,
        "deepest_mm": 1e3 * truth.deepest_m,
    }
    figures = {mode: _figures(trial, mode) for mode in modes}
    return {"trial": name, "seed": seed, "ideal": ideal, "walk": walk, "modes": figures}


def _figures(trial: Trial, mode: str) -> Row:
    config = resolve(SIMULATED_ROBOT).on_recording(trial.imu)
    estimates: list[StateEstimate] = []
    robot = config.robot or load_robot(SIMULATED_ROBOT)
    summary = pipeline.run(
        make_estimator(mode, Equipment(robot=RobotModel(robot)), config), trial.measurements, estimates.append
    )
    trajectory = Trajectory(
        np.array([each.stamp_ns for each in estimates]),
        np.array([each.nav.T_world_body for each in estimates]),
        np.array([each.nav.velocity_world for each in estimates]),
        np.array([each.covariance[:6, :6] for each in estimates]),
    )
    evaluation = evaluate(trajectory, trial.vicon, config.evaluation, realtime_factor=summary.realtime_factor)
    told = EvaluationRecord.of(evaluation).to_json()
    return {**told, "contact_right": _contact_right(trial, estimates), "failure": summary.failure}


def _contact_right(trial: Trial, estimates: list[StateEstimate]) -> float:
    """Share of legs and samples whose contact was decided right, away from touch-downs and lift-offs."""
    truth, stamps_ns = trial.truth.contact, trial.truth.contact_ns
    decided = [each for each in estimates if each.feet is not None]
    at_ns = np.array([each.stamp_ns for each in decided])
    stance = np.array([each.feet.is_stance for each in decided if each.feet is not None])
    right = stance == truth[np.clip(np.searchsorted(stamps_ns, at_ns), 0, len(stamps_ns) - 1)]
    asked = np.ones_like(right)
    for leg in range(truth.shape[1]):
        changes = stamps_ns[1:][truth[1:, leg] != truth[:-1, leg]]
        after = np.searchsorted(changes, at_ns)
        for near in (np.clip(after - 1, 0, None), np.clip(after, None, len(changes) - 1)):
            asked[:, leg] &= np.abs(at_ns - changes[near]) > _NEAR_CHANGE_NS
    return float(right[asked].mean())


def summary(rows: list[Row]) -> dict[str, Row]:
    """Mean over seeds of every figure, by robot, trial and mode; the largest drift and RPE beside it."""
    told: dict[str, Row] = {}
    for kind, ideal in (("imperfect", False), ("ideal", True)):
        for name in TERRAINS:
            of_name = [row for row in rows if row["trial"] == name and row["ideal"] == ideal]
            modes = dict.fromkeys(mode for row in of_name for mode in row["modes"])
            if of_name:
                told[f"{kind} {name}"] = {
                    mode: _means([row["modes"][mode] for row in of_name if mode in row["modes"]]) for mode in modes
                }
    return told


def _means(figures: list[Row]) -> Row:
    def known(key: str) -> list[float]:
        return [one[key] for one in figures if one[key] is not None]

    means = {key: float(np.mean(known(key))) if known(key) else None for key in FIGURES}
    worst = {f"worst_{key}": max(known(key), default=None) for key in ("drift_percent", "rpe_1m_percent")}
    failed = sum(one["failure"] is not None for one in figures)
    return {"seeds": len(figures), "failed": failed, "least_coverage": min(known("coverage")), **means, **worst}


def _key(row: Row) -> tuple[bool, int, int]:
    return row["ideal"], TERRAINS.index(row["trial"]), row["seed"]


def main() -> None:
    """Run what is missing, writing after each trial."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--seeds", type=int, default=10, help="how many")
    parser.add_argument("--first-seed", type=int, default=1)
    parser.add_argument("--modes", default="coclo,coclo_paper,inekf,naive_rolling", help="separated by commas")
    parser.add_argument("--ideal", action="store_true", help="the robot as its description says")
    parser.add_argument("--workers", type=int, default=1, help="processes")
    parser.add_argument("-o", "--output", type=Path, default=Path("out/leg_odometry.json"))
    given = parser.parse_args()
    given.output.parent.mkdir(parents=True, exist_ok=True)
    rows: list[Row] = json.loads(given.output.read_text())["trials"] if given.output.is_file() else []
    modes = tuple(given.modes.split(","))
    done = {
        (row["trial"], row["seed"]) for row in rows if row["ideal"] == given.ideal and set(modes) <= {*row["modes"]}
    }
    with ProcessPoolExecutor(given.workers, get_context("spawn")) as pool:
        seeds = range(given.first_seed, given.first_seed + given.seeds)
        wanted = [(name, seed) for seed in seeds for name in TERRAINS if (name, seed) not in done]
        jobs = [pool.submit(compare, name, seed, modes, ideal=given.ideal) for name, seed in wanted]
        for job in as_completed(jobs):
            row = job.result()
            rows = [one for one in rows if _key(one) != _key(row)] + [row]
            rows.sort(key=_key)
            text = {"summary": summary(rows), "trials": rows}
            given.output.write_text(json.dumps(text, indent=1) + "\n", encoding="utf-8")
            first = row["modes"][modes[0]]
            print(f"{row['trial']} {row['seed']}: drift {first['drift_percent']:.2f} %", file=sys.stderr)
    print(json.dumps(summary(rows), indent=2))


if __name__ == "__main__":
    main()
