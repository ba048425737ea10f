# SPDX-License-Identifier: BSD-3-Clause
import sys
from pathlib import Path

import pytest
from console import Answer, Coclo

from coclo_vio import cli
from coclo_vio.datasets.writer import write_leg_log
from coclo_vio.robot.description import load_robot
from coclo_vio.robot.model import RobotModel
from coclo_vio.simulation.analytic import AnalyticTrialConfig, generate
from coclo_vio.simulation.body_motion import BodyMotionConfig
from coclo_vio.values.trajectory import GroundTruth


@pytest.fixture(scope="session")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three seconds of a Daisy, with ground truth."""
    robot = load_robot("daisy")
    body = BodyMotionConfig(rest_s=0.8, walk_s=2.0, stop_s=0.2, ramp_s=0.4)
    trial = generate(AnalyticTrialConfig(body=body), RobotModel(robot), seed=12)
    folder = tmp_path_factory.mktemp("data") / "walk"
    write_leg_log(folder, robot, trial.measurements, GroundTruth(trial.truth, True, "truth"))
    return folder


@pytest.fixture
def coclo(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> Coclo:
    """Runs the entry of the console script in this process, in a folder of its own."""

    def run(*arguments: object) -> Answer:
        monkeypatch.chdir(tmp_path)
        monkeypatch.setattr(sys, "argv", ["coclo-vio", *map(str, arguments)])
        with pytest.raises(SystemExit) as exit_:
            cli.main()
        captured = capsys.readouterr()
        code = exit_.value.code
        return Answer(code if isinstance(code, int) else 0, captured.out, captured.err)

    return run
