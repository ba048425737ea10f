# SPDX-License-Identifier: BSD-3-Clause
"""The recording that the package ships: ten seconds of an exact, noisy walk of a six-legged Daisy.

``python -m coclo_vio.sample FOLDER`` makes it anew; a test holds the shipped files to that.
"""

import sys
from importlib import resources
from pathlib import Path

from coclo_vio.datasets.writer import write_leg_log
from coclo_vio.robot.description import load_robot
from coclo_vio.robot.model import RobotModel
from coclo_vio.simulation.analytic import AnalyticTrialConfig, generate
from coclo_vio.simulation.body_motion import BodyMotionConfig
from coclo_vio.trajectory import GroundTruth

SEED = 1
TRIAL = AnalyticTrialConfig(body=BodyMotionConfig(rest_s=1.5, walk_s=8.0, stop_s=0.5))


def sample_path() -> Path:
    """The folder of the shipped recording."""
    return Path(str(resources.files("coclo_vio") / "sample_data" / "daisy_walk"))


def make_sample(folder: Path) -> Path:
    """Write the recording: ``leg_log.csv`` and ``groundtruth.tum``; returns the path of the log."""
    robot = load_robot("daisy")
    trial = generate(TRIAL, RobotModel(robot), SEED)
    truth = GroundTruth(trial.truth, has_stamps=True, source="analytic trial")
    return write_leg_log(folder, robot, trial.measurements, truth)


if __name__ == "__main__":
    make_sample(Path(sys.argv[1]))
