# SPDX-License-Identifier: BSD-3-Clause
"""Simulate a walk whose truth is known in closed form, and estimate it: ``python examples/simulate_walk.py [ROBOT]``.

No physics engine is needed; trials with contact physics and images are made by ``coclo-vio simulate``.
"""

import sys

import numpy as np

import coclo_vio as cv
from coclo_vio.geometry import se3
from coclo_vio.robot.model import RobotModel
from coclo_vio.simulation.analytic import AnalyticTrialConfig, generate
from coclo_vio.simulation.body_motion import BodyMotionConfig

WALK = BodyMotionConfig(rest_s=1.0, walk_s=4.0, stop_s=0.5, speed_mps=0.2, curvature_per_m=0.5)


def main(robot: str = "daisy", seed: str = "7") -> None:
    trial = generate(AnalyticTrialConfig(body=WALK), RobotModel(cv.load_robot(robot)), int(seed))
    odometry = cv.make_estimator("coclo", robot=robot)
    states = [
        output.state
        for measurement in trial.measurements
        for output in odometry.push(measurement)
        if isinstance(output, cv.Estimate)
    ]
    first, last = states[0], states[-1]
    row = {int(stamp_ns): number for number, stamp_ns in enumerate(trial.truth.stamps_ns)}
    T_true = se3.inverse(trial.truth.T_world_body[row[first.stamp_ns]]) @ trial.truth.T_world_body[row[last.stamp_ns]]
    T_estimated = se3.inverse(first.nav.T_world_body) @ last.nav.T_world_body
    off_m = float(np.linalg.norm(T_estimated[:3, 3] - T_true[:3, 3]))
    print(f"{robot}: {1e3 * off_m:.1f} mm off after {trial.truth.path_length_m():.2f} m")
    assert off_m < 0.05 * trial.truth.path_length_m()


if __name__ == "__main__":
    main(*sys.argv[1:])
