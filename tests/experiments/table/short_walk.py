# SPDX-License-Identifier: BSD-3-Clause
"""A recording that costs nothing to make, in the place of a simulated trial; and results that nobody had to compute."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from coclo_vio.datasets.recording_contents import RecordingContents
from coclo_vio.datasets.writer import write_euroc_folder
from coclo_vio.experiments.table.plan import TablePlan
from coclo_vio.experiments.table.recordings import Recordings
from coclo_vio.experiments.table.job_store import JobStore
from coclo_vio.experiments.table.trial_results import FIGURES
from coclo_vio.robot.description import load_robot
from coclo_vio.robot.model import RobotModel
from coclo_vio.runs.run_config import resolve
from coclo_vio.simulation.analytic import AnalyticTrialConfig, generate
from coclo_vio.simulation.body_motion import BodyMotionConfig
from coclo_vio.simulation.simulated_recording import truth_folder
from coclo_vio.values.config import write_yaml
from coclo_vio.values.trajectory import GroundTruth, write_tum


@dataclass(frozen=True)
class MadePlan:
    """A table to be made."""

    plan: TablePlan
    recordings: Recordings
    store: JobStore


def plan_of(**changes: Any) -> TablePlan:
    """One seed of the flat trial through the legs, without images; with changes."""
    values: dict[str, Any] = {
        "config": resolve("daisy", settings=["evaluation.clock.offset_s=0"]),
        "seeds": 1,
        "first_seed": 1,
        "trials": ("flat",),
        "modes": ("naive",),
        "policy_seeds": 0,
        "images": False,
    }
    return TablePlan(**(values | changes))


def write_walk(path: Path, plan: TablePlan) -> None:
    """An analytic walk at ``path``, as if the plan's flat trial had been simulated."""
    robot = load_robot("daisy")
    body = BodyMotionConfig(rest_s=0.8, walk_s=2.0, stop_s=0.2, ramp_s=0.4)
    trial = generate(AnalyticTrialConfig(body=body), RobotModel(robot), seed=12)
    truth = GroundTruth(trial.truth, True, "truth")
    write_euroc_folder(path, RecordingContents(robot, trial.measurements, truth, imu=robot.imu))
    truth_folder(path).mkdir()
    write_tum(trial.truth, truth_folder(path) / "groundtruth.tum")
    write_yaml(plan.simulation_of("flat"), truth_folder(path) / "config.yaml")


def block(**figures: float | None) -> dict[str, float | None]:
    """What an evaluation says, 1 where nothing else is said."""
    return dict.fromkeys(FIGURES, 1.0) | figures


def row(
    trial: str, seed: int, variant: str, estimators: Mapping[str, Mapping[str, float | None] | str]
) -> dict[str, Any]:
    """The row of a job: figures of each estimator against Vicon, half of them against the truth; or why it failed."""
    told = {name: _told(one) for name, one in estimators.items()}
    failure = next((one["failure"] for one in told.values() if one["failure"]), None)
    return {"trial": trial, "seed": seed, "variant": variant, "cpu_s": 1.0, "failure": failure, "estimators": told}


def _told(one: Mapping[str, float | None] | str) -> dict[str, Any]:
    failure = one if isinstance(one, str) else None
    vicon = block() if isinstance(one, str) else block(**one)
    truth = {key: None if value is None else value / 2 for key, value in vicon.items()}
    empty = {"estimates": 1, "counts": {}, "keyframes": None, "events": [{"kind": "blind", "time_s": 1.0}]}
    return {"vicon": vicon, "truth": truth, "realtime_factor": 3.0, "failure": failure, **empty}
