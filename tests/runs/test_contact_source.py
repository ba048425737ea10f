# SPDX-License-Identifier: BSD-3-Clause
"""A recording without torques and foot forces: contact is by the motion of the feet, and that is said."""

from pathlib import Path

import pytest

from coclo_vio.datasets.dataset import open_dataset
from coclo_vio.datasets.writer import RecordedJoints, write_leg_log
from coclo_vio.robot.description import RobotDescription, load_robot
from coclo_vio.robot.model import RobotModel
from coclo_vio.runs.contact_source import with_contact_source
from coclo_vio.runs.preflight import preflight
from coclo_vio.runs.run_config import RunConfig, resolve
from coclo_vio.runs.running import run_modes
from coclo_vio.simulation.analytic import AnalyticTrialConfig, generate
from coclo_vio.simulation.body_motion import BodyMotionConfig
from coclo_vio.values.measurements import FootForceSample


@pytest.fixture
def daisy() -> RobotDescription:
    return load_robot("daisy")


def written(folder: Path, robot: RobotDescription, *, with_effort: bool) -> RunConfig:
    body = BodyMotionConfig(rest_s=1.0, walk_s=1.0, stop_s=0.0, ramp_s=0.3)
    trial = generate(AnalyticTrialConfig(body=body), RobotModel(robot), seed=2)
    samples = [each for each in trial.measurements if not isinstance(each, FootForceSample)]
    write_leg_log(folder, robot, samples, joints=RecordedJoints(with_effort=with_effort))
    return resolve("daisy")


def test_without_any_load_the_run_goes_by_motion_and_says_so(tmp_path: Path, daisy: RobotDescription) -> None:
    config = written(tmp_path / "log", daisy, with_effort=False)
    dataset = open_dataset(tmp_path / "log", config.robot, config.dataset)
    chosen = with_contact_source(config, dataset).robot
    assert chosen is not None
    assert chosen.contact.source == "kinematic"
    (finding,) = [each for each in preflight(dataset, config).findings if each.kind == "contact_kinematic"]
    assert not finding.is_error
    record = run_modes(tmp_path / "log", ["coclo"], config, tmp_path / "run")
    assert record.estimators["coclo"].failure is None
    assert record.estimators["coclo"].counts.get("no_contact", 0) < 20
    assert "source: kinematic" in (tmp_path / "run" / "config.yaml").read_text(encoding="utf-8")


def test_with_torques_the_source_stays(tmp_path: Path, daisy: RobotDescription) -> None:
    config = written(tmp_path, daisy, with_effort=True)
    assert with_contact_source(config, open_dataset(tmp_path, config.robot, config.dataset)) is config


def test_a_method_that_needs_no_load_is_left(tmp_path: Path, daisy: RobotDescription) -> None:
    written(tmp_path, daisy, with_effort=False)
    config = resolve("daisy", settings=["robot.contact.method=kinematic"])
    assert with_contact_source(config, open_dataset(tmp_path, config.robot, config.dataset)) is config
