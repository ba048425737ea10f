# SPDX-License-Identifier: BSD-3-Clause
"""Simulated walks with a stand and a turn, as leg logs."""

from collections.abc import Callable
from functools import cache
from pathlib import Path

import pytest

from coclo_vio.datasets.writer import ALL_JOINT_READINGS, RecordedJoints, write_leg_log
from coclo_vio.robot.description import EXTRA_SCHEME, RobotDescription, load_robot, urdf_path
from coclo_vio.robot.model import RobotModel
from coclo_vio.simulation.analytic import AnalyticTrialConfig, generate
from coclo_vio.simulation.body_motion import BodyMotionConfig
from coclo_vio.values.errors import RobotModelError
from coclo_vio.values.measurements import FootForceSample, Measurement


@cache
def walk_of(name: str, curvature_per_m: float = 1.0, rotation: tuple[float, float, float] | None = None):
    """Measurements of a robot that stands for a second and walks a turn of four; its IMU turned if asked."""
    robot = load_robot(name)
    if rotation is not None:
        imu = robot.imu.model_copy(update={"rotation_body_imu_rpy_rad": rotation})
        robot = robot.model_copy(update={"imu": imu})
    speed = 0.05 if name in {"solo12", "bolt"} else 0.15
    body = BodyMotionConfig(rest_s=0.9, walk_s=3.0, stop_s=0.2, speed_mps=speed, curvature_per_m=curvature_per_m)
    measurements: tuple[Measurement, ...] = generate(
        AnalyticTrialConfig(body=body), RobotModel(robot), seed=3
    ).measurements
    if robot.contact.source == "torque":
        measurements = tuple(sample for sample in measurements if not isinstance(sample, FootForceSample))
    return robot, measurements


def needs_urdf(robot: RobotDescription) -> Path:
    """The URDF of a robot; skips where it is in the extra that is not installed."""
    try:
        return urdf_path(robot)
    except RobotModelError:
        assert robot.urdf.startswith(EXTRA_SCHEME)
        pytest.skip("pip install coclo-vio[robots] for this robot's URDF")


@pytest.fixture
def write_walk(tmp_path: Path) -> Callable[..., tuple[Path, Path, RobotDescription]]:
    """Writes the walk of a packaged robot as a leg log: URDF, log, and the robot as described by hand."""

    def write(
        name: str,
        joints: RecordedJoints = ALL_JOINT_READINGS,
        edit: Callable[[str], str] | None = None,
        **changes: object,
    ) -> tuple[Path, Path, RobotDescription]:
        urdf = needs_urdf(load_robot(name))
        robot, measurements = walk_of(name, **changes)
        log = write_leg_log(tmp_path / "walk", robot, measurements, joints=joints)
        if edit is not None:
            log.write_text(edit(log.read_text("ascii")), "ascii")
        return urdf, log, robot

    return write


@pytest.fixture
def walk() -> Callable[..., tuple[RobotDescription, tuple[Measurement, ...]]]:
    """The walk of a packaged robot, see ``walk_of``."""
    return walk_of
