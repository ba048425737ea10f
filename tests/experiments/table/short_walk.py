# SPDX-License-Identifier: BSD-3-Clause
"""A recording that is quick to make, in the place of a simulated trial; and made-up results."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from coclo_vio.datasets.recording_contents import RecordingContents
from coclo_vio.datasets.writer import write_euroc_folder
from coclo_vio.evaluation.evaluation_record import EvaluationRecord, GapsRecord
from coclo_vio.experiments.table.job_store import JobStore
from coclo_vio.experiments.table.plan import TablePlan
from coclo_vio.experiments.table.recordings import Recordings
from coclo_vio.experiments.table.table_record import EventTime, Fingerprint, JobRecord, JobTrajectory
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
    """A planned table."""

    plan: TablePlan
    recordings: Recordings
    store: JobStore


def plan_of(**changes: Any) -> TablePlan:
    """One seed of the flat trial through plain leg odometry, without images; with changes."""
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


def evaluation(**figures: float | None) -> EvaluationRecord:
    """An evaluation, 1 where nothing else is given."""
    values: dict[str, Any] = dict.fromkeys(EvaluationRecord.model_fields, 1.0)
    values |= {
        "schema_version": 1,
        "paper_drift_at": "end",
        "velocity_source": "estimate",
        "alignment": "yaw_position",
        "clock_is_estimated": True,
        "notes": (),
        "gaps": GapsRecord(ground_truth_holes=0, estimate_holes=0, poses_outside=0, poses_in_holes=0),
    }
    return EvaluationRecord(**values | figures)


def job_record(
    trial: str,
    seed: int,
    variant: str,
    trajectories: Mapping[str, Mapping[str, float | None] | str],
    fingerprint: Fingerprint | None = None,
) -> JobRecord:
    """A finished job: figures of each trajectory against Vicon, half of them against the truth; or why it failed."""
    estimators = {name: _trajectory(figures) for name, figures in trajectories.items()}
    return JobRecord(
        fingerprint=fingerprint
        or Fingerprint(
            version="", configuration="", simulation="", ideal=False, trial=trial, seed=seed, variant=variant
        ),
        trial=trial,
        seed=seed,
        variant=variant,
        cpu_s=1.0,
        failure=next((each.failure for each in estimators.values() if each.failure), None),
        estimators=estimators,
    )


def _trajectory(figures: Mapping[str, float | None] | str) -> JobTrajectory:
    given = {} if isinstance(figures, str) else dict(figures)
    vicon = {key: given.get(key, 1.0) for key in FIGURES}
    truth = {key: None if value is None else value / 2 for key, value in vicon.items()}
    return JobTrajectory(
        vicon=evaluation(**vicon),
        truth=evaluation(**truth),
        realtime_factor=3.0,
        estimates=1,
        counts={},
        keyframes=None,
        events=(EventTime(kind="vision_lost", time_s=1.0),),
        failure=figures if isinstance(figures, str) else None,
    )
