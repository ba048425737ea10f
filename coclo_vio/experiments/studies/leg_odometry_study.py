# SPDX-License-Identifier: BSD-3-Clause
"""Leg odometry on the simulated trials over many seeds, against noisy Vicon and against true contacts.

``python -m coclo_vio.experiments.studies.leg_odometry_study --first-seed 11 --workers 2 -o out/leg_odometry.json``
takes about a minute and a half a trial and core. Finished trials are kept: an interrupted study continues. ``--ideal``
simulates a robot that equals its description.
"""

import json
from pathlib import Path

import numpy as np

from coclo_vio.evaluation.evaluate import evaluate
from coclo_vio.evaluation.evaluation_record import EvaluationRecord
from coclo_vio.experiments.studies.study import (
    ResultFile,
    Row,
    add_seeds_and_workers,
    parser,
    report,
    run_jobs,
    seeds_of,
)
from coclo_vio.robot.description import load_robot
from coclo_vio.robot.model import RobotModel
from coclo_vio.runs import pipeline
from coclo_vio.runs.equipment import Equipment
from coclo_vio.runs.modes.registry import mode_of
from coclo_vio.runs.run_config import resolve
from coclo_vio.simulation.simulated_recording import IDEAL_ROBOT, SIMULATED_ROBOT, simulation_config, walked_m
from coclo_vio.simulation.trial.terrain import TERRAINS, TerrainName
from coclo_vio.simulation.trial.trial import Trial, simulate
from coclo_vio.values.estimates import StateEstimate
from coclo_vio.values.outputs import Estimate, Output
from coclo_vio.values.trajectory import Trajectory

FIGURES = (
    "drift_percent",
    "rpe_1m_percent",
    "ate_m",
    "yaw_drift_deg",
    "path_length_ratio",
    "anees_pose",
    "contact_right",
)
_NEAR_CHANGE_NS = 30_000_000  # samples this close to a touch-down or lift-off do not count


def compare(name: TerrainName, seed: int, modes: tuple[str, ...], ideal: bool) -> Row:
    """One trial, every mode."""
    changes = (IDEAL_ROBOT,) if ideal else ()
    trial = simulate(name, load_robot(SIMULATED_ROBOT), simulation_config(name, *changes).trial, seed)
    truth = trial.truth
    walk = {
        "path_length_ratio": walked_m(truth.trajectory) / trial.terrain.path_length_m,
        "legs_touching_each_other": truth.self_contacts,
        "legs_touching_the_ground": truth.ground_contacts,
        "deepest_mm": 1e3 * truth.max_penetration_m,
    }
    figures = {mode: _figures(trial, mode) for mode in modes}
    return {"trial": name, "seed": seed, "ideal": ideal, "walk": walk, "modes": figures}


def _figures(trial: Trial, mode: str) -> Row:
    config = resolve(SIMULATED_ROBOT).on_recording(trial.imu)
    estimates: list[StateEstimate] = []
    robot = config.robot or load_robot(SIMULATED_ROBOT)

    def take(output: Output) -> None:
        if isinstance(output, Estimate):
            estimates.append(output.state)

    estimator = mode_of(mode).make(Equipment(robot=RobotModel(robot)), config)
    summary = pipeline.run(estimator, trial.measurements, take)
    trajectory = Trajectory(
        np.array([each.stamp_ns for each in estimates]),
        np.array([each.nav.T_world_body for each in estimates]),
        np.array([each.nav.velocity_world for each in estimates]),
        np.array([each.covariance[:6, :6] for each in estimates]),
    )
    evaluation = evaluate(trajectory, trial.vicon, config.evaluation, realtime_factor=summary.realtime_factor)
    figures = EvaluationRecord.of(evaluation).to_json()
    return {**figures, "contact_right": _contact_right(trial, estimates), "failure": summary.failure}


def _contact_right(trial: Trial, estimates: list[StateEstimate]) -> float:
    """Share of legs and samples with a correct contact decision, away from touch-downs and lift-offs."""
    truth, stamps_ns = trial.truth.contact, trial.truth.contact_ns
    decided = [each for each in estimates if each.feet is not None]
    at_ns = np.array([each.stamp_ns for each in decided])
    stance = np.array([each.feet.is_stance for each in decided if each.feet is not None])
    is_right = stance == truth[np.clip(np.searchsorted(stamps_ns, at_ns), 0, len(stamps_ns) - 1)]
    counts = np.ones_like(is_right)
    for leg in range(truth.shape[1]):
        changes = stamps_ns[1:][truth[1:, leg] != truth[:-1, leg]]
        after = np.searchsorted(changes, at_ns)
        for near in (np.clip(after - 1, 0, None), np.clip(after, None, len(changes) - 1)):
            counts[:, leg] &= np.abs(at_ns - changes[near]) > _NEAR_CHANGE_NS
    return float(is_right[counts].mean())


def summary(rows: list[Row]) -> Row:
    """Mean over seeds of every figure, and the largest drift and RPE, by robot, trial and mode."""
    by_trial: Row = {}
    for kind, ideal in (("imperfect", False), ("ideal", True)):
        for name in TERRAINS:
            of_name = [row for row in rows if row["trial"] == name and row["ideal"] == ideal]
            modes = dict.fromkeys(mode for row in of_name for mode in row["modes"])
            if of_name:
                by_trial[f"{kind} {name}"] = {
                    mode: _means([row["modes"][mode] for row in of_name if mode in row["modes"]]) for mode in modes
                }
    return by_trial


def _means(figures: list[Row]) -> Row:
    def known(key: str) -> list[float]:
        return [each[key] for each in figures if each[key] is not None]

    means = {key: float(np.mean(known(key))) if known(key) else None for key in FIGURES}
    worst = {f"worst_{key}": max(known(key), default=None) for key in ("drift_percent", "rpe_1m_percent")}
    failed = sum(each["failure"] is not None for each in figures)
    return {"seeds": len(figures), "failed": failed, "least_coverage": min(known("coverage")), **means, **worst}


def _key(row: Row) -> tuple[bool, int, int]:
    return row["ideal"], TERRAINS.index(row["trial"]), row["seed"]


def main() -> None:
    """Run what is missing, writing after each trial."""
    arguments = parser(__doc__, Path("out/leg_odometry.json"))
    add_seeds_and_workers(arguments, 10)
    arguments.add_argument("--modes", default="coclo,coclo_paper,inekf,naive_rolling", help="separated by commas")
    arguments.add_argument("--ideal", action="store_true", help="a robot that equals its description")
    options = arguments.parse_args()
    results = ResultFile(options.output, summary, _key)
    modes = tuple(options.modes.split(","))
    done = {
        (row["trial"], row["seed"])
        for row in results.rows
        if row["ideal"] == options.ideal and set(modes) <= {*row["modes"]}
    }
    jobs = [
        (name, seed, modes, options.ideal)
        for seed in seeds_of(options)
        for name in TERRAINS
        if (name, seed) not in done
    ]
    for row in run_jobs(compare, jobs, options.workers):
        results.add(row)
        first = row["modes"][modes[0]]
        report(f"{row['trial']} {row['seed']}: drift {first['drift_percent']:.2f} %")
    print(json.dumps(results.summary(), indent=2))


if __name__ == "__main__":
    main()
