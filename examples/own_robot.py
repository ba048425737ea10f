# SPDX-License-Identifier: BSD-3-Clause
"""A robot of your own from a URDF and ten lines of YAML: ``python examples/own_robot.py [URDF]`` (else the Go1's)."""

import sys
import tempfile
from pathlib import Path

import numpy as np

import coclo_vio as cv
from coclo_vio.robot.model import RobotModel

DESCRIPTION = """
name: my_dog
urdf: {urdf}
legs:
  - {{name: FR, joints: [FR_hip_joint, FR_thigh_joint, FR_calf_joint], foot_frame: FR_foot, foot_radius_m: 0.02}}
  - {{name: FL, joints: [FL_hip_joint, FL_thigh_joint, FL_calf_joint], foot_frame: FL_foot, foot_radius_m: 0.02}}
  - {{name: RR, joints: [RR_hip_joint, RR_thigh_joint, RR_calf_joint], foot_frame: RR_foot, foot_radius_m: 0.02}}
  - {{name: RL, joints: [RL_hip_joint, RL_thigh_joint, RL_calf_joint], foot_frame: RL_foot, foot_radius_m: 0.02}}
contact: {{source: torque, on_force: 20, off_force: 12}}
imu: {{position_body_m: [0.0, 0.0, 0.0]}}
"""


def main(urdf: str | None = None) -> None:
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "my_dog.yaml"
        file.write_text(DESCRIPTION.format(urdf=urdf or cv.load_robot("go1").urdf), encoding="utf-8")
        robot = RobotModel(cv.load_robot(file))
    feet = robot.feet(np.tile([0.0, 0.8, -1.6], 4), np.zeros(12)).position_body
    print(f"{robot.description.name}: {robot.mass_kg:.1f} kg, {len(robot.joint_names)} joints")
    for leg, foot in zip(robot.leg_names, feet, strict=True):
        print(f"{leg}: foot at {np.round(foot, 3)} m in the body frame; left legs have y > 0, feet z < 0")


if __name__ == "__main__":
    main(*sys.argv[1:])
