# SPDX-License-Identifier: BSD-3-Clause
"""The conventions of CONVENTIONS.md that no other test holds, and that every one of them is held."""

import re
from importlib import metadata
from pathlib import Path

import numpy as np
import pytest
from state_layouts import layout_of, state_of

from coclo_vio.filter.config import FilterConfig
from coclo_vio.filter.measurement_model import specific_force_at_rest
from coclo_vio.filter.odometry import LegOdometryFilter
from coclo_vio.filter.remembered_poses import frame_pair, frame_pose
from coclo_vio.filter.square_root_filter import SquareRootFilter
from coclo_vio.filter.state import POSITION, RATE, ROTATION, VELOCITY, State
from coclo_vio.filter.state_blocks import KEYFRAME
from coclo_vio.geometry import se3, so3
from coclo_vio.robot.description import load_robot, robot_names
from coclo_vio.robot.model import RobotModel
from coclo_vio.simulation.analytic import STANDING_RAD, AnalyticTrial, AnalyticTrialConfig, SensorNoiseConfig, generate
from coclo_vio.simulation.body_motion import BodyMotionConfig
from coclo_vio.values.arrays import Array
from coclo_vio.values.estimates import StateEstimate
from coclo_vio.values.keyframes import relative_motion
from coclo_vio.values.measurements import ImuSample

_ROOT = Path(__file__).resolve().parents[1]
_LINK = re.compile(r"`(tests/[\w/]+\.py)::(test_\w+)`")
_LEFT = {"FL", "RL", "HL", "LF", "LH", "left", "leg1", "leg3", "leg5"}
_FRONT = {"FL", "FR", "LF", "RF", "leg1", "leg2"}
_MIDDLE = {"leg3", "leg4"}
_LAYOUT = layout_of(2)
_SMALL = 1e-6


def _state(seed: int) -> State:
    return state_of(_LAYOUT, np.random.default_rng(seed))


def _pose(state: State) -> Array:
    return se3.transform(state.rotation, state.vector[POSITION])


def _keyframe_pose(state: State) -> Array:
    return state.remembered_pose(KEYFRAME)


@pytest.fixture(scope="module")
def daisy() -> RobotModel:
    return RobotModel(load_robot("daisy"))


@pytest.fixture(scope="module")
def turning_walk(daisy: RobotModel) -> AnalyticTrial:
    """Perfect sensors; rest, then forward in a left turn."""
    body = BodyMotionConfig(rest_s=1.0, walk_s=3.0, stop_s=0.5, speed_mps=0.15, curvature_per_m=1.0)
    return generate(AnalyticTrialConfig(body=body, sensors=SensorNoiseConfig(noise_scale=0.0)), daisy, seed=5)


@pytest.fixture(scope="module")
def estimates(daisy: RobotModel, turning_walk: AnalyticTrial) -> list[StateEstimate]:
    odometry = LegOdometryFilter(daisy, FilterConfig())
    return [e for e in map(odometry.push, turning_walk.measurements) if e is not None]


def test_every_convention_names_a_test() -> None:
    rows = [
        line
        for line in (_ROOT / "CONVENTIONS.md").read_text(encoding="utf-8").splitlines()
        if line.startswith("| ") and not line.startswith("| convention")
    ]
    assert len(rows) >= 20
    assert [row for row in rows if not _LINK.search(row)] == []


@pytest.mark.parametrize("name", robot_names())
def test_body_frame_is_x_forward_y_left_z_up(name: str) -> None:
    description = load_robot(name)
    if description.urdf.startswith("example-robot-data:"):
        try:
            metadata.distribution("example-robot-data")
        except metadata.PackageNotFoundError:
            pytest.skip("pip install coclo-vio[robots] for this robot's URDF")
    model = RobotModel(description)
    feet = model.feet(np.concatenate(STANDING_RAD[name]), np.zeros(len(model.joint_names))).position_body
    for leg, (x, y, z) in zip(model.leg_names, feet, strict=True):
        assert (y > 0) == (leg in _LEFT)
        assert z < 0
        if len(feet) > 2:
            assert (x > 0) == (leg in _FRONT) or leg in _MIDDLE


def test_gravity_points_down_and_an_accelerometer_at_rest_reads_up(turning_walk: AnalyticTrial) -> None:
    at_rest = next(m for m in turning_walk.measurements if isinstance(m, ImuSample))
    np.testing.assert_allclose(at_rest.specific_force, [0.0, 0.0, 9.81], atol=1e-9)
    level = State(_LAYOUT, np.eye(3)[None], np.zeros((1, _LAYOUT.dimension)))
    np.testing.assert_array_equal(specific_force_at_rest(level), [[0.0, 0.0, 9.81]])


def test_the_world_is_where_the_filter_starts(estimates: list[StateEstimate]) -> None:
    start = estimates[0].nav.T_world_body
    np.testing.assert_array_equal(start[:3, 3], np.zeros(3))
    assert so3.yaw(start[:3, :3]) == 0.0
    np.testing.assert_allclose(start[2, :3], [0.0, 0.0, 1.0], atol=1e-9)


def test_velocity_is_in_the_world_and_angular_velocity_in_the_body(
    estimates: list[StateEstimate], turning_walk: AnalyticTrial
) -> None:
    truth = turning_walk.truth
    at = int(np.searchsorted(truth.stamps_ns, 3_200_000_000))
    estimate = next(e for e in estimates if e.stamp_ns == truth.stamps_ns[at])
    T_estimate_truth = estimates[0].nav.T_world_body @ se3.inverse(truth.T_world_body[0])
    assert truth.velocity_world is not None
    velocity = T_estimate_truth[:3, :3] @ truth.velocity_world[at]
    assert abs(so3.yaw(estimate.nav.T_world_body[:3, :3])) > 0.2, "the body has turned, so the axes differ"
    np.testing.assert_allclose(estimate.nav.velocity_world, velocity, atol=0.01)
    step = truth.rotations[at - 1].T @ truth.rotations[at + 1]
    rate = so3.log(step) / ((truth.stamps_ns[at + 1] - truth.stamps_ns[at - 1]) / 1e9)
    np.testing.assert_allclose(estimate.nav.angular_velocity_body, rate, atol=0.02)


def test_covariance_of_an_estimate_is_of_right_local_rotation_first_errors() -> None:
    """T = T_mean exp([rotation, position]); velocity differs in the world."""
    mean = _state(11)
    jacobian = mean.plain_jacobian()
    for column in range(_LAYOUT.dimension):
        error = np.zeros(_LAYOUT.dimension)
        error[column] = _SMALL
        moved = mean.corrected(error)
        local = se3.log(se3.inverse(_pose(mean)) @ _pose(moved))
        plain = np.concatenate((local, moved.vector[VELOCITY] - mean.vector[VELOCITY]))
        np.testing.assert_allclose(jacobian[:, column], plain / _SMALL, atol=1e-5)


def test_errors_inside_the_filter_turn_the_world() -> None:
    """Right-invariant: R = exp(e) R_mean, and position, velocity and feet turn with it, their own errors too."""
    mean = _state(12)
    error = np.random.default_rng(13).normal(scale=0.3, size=_LAYOUT.dimension)
    moved = mean.corrected(error)
    turn = so3.exp(error[ROTATION])
    np.testing.assert_allclose(moved.rotation, turn @ mean.rotation, atol=1e-14)
    for part in (VELOCITY, POSITION):
        np.testing.assert_allclose(moved.vector[part], turn @ (mean.vector[part] + error[part]), atol=1e-14)
    np.testing.assert_allclose(moved.vector[RATE], mean.vector[RATE] + error[RATE], atol=1e-14)
    feet = (mean.feet + error[_LAYOUT.feet].reshape(-1, 3)) @ turn.T
    np.testing.assert_allclose(moved.feet, feet, atol=1e-14)


def test_a_turned_world_changes_nothing_that_legs_or_imu_see() -> None:
    mean = _state(14)
    error = np.zeros(_LAYOUT.dimension)
    error[ROTATION] = [0.0, 0.0, 1.3]
    turned = mean.corrected(error)
    body_velocity = turned.rotation.T @ turned.vector[VELOCITY]
    relative_feet = (turned.feet - turned.vector[POSITION]) @ turned.rotation
    np.testing.assert_allclose(body_velocity, mean.rotation.T @ mean.vector[VELOCITY], atol=1e-14)
    np.testing.assert_allclose(relative_feet, (mean.feet - mean.vector[POSITION]) @ mean.rotation, atol=1e-14)
    np.testing.assert_allclose(turned.rotation[2], mean.rotation[2], atol=1e-14)
    assert np.linalg.norm(turned.feet - mean.feet) > 0.1


def test_covariance_of_a_delta_is_of_its_right_local_error() -> None:
    """T_start_end = T_mean exp([rotation, translation]), from the keyframe to the frame."""
    layout = layout_of(2, has_frame=True)
    rng = np.random.default_rng(15)
    vector = rng.normal(size=layout.dimension)
    vector[layout.at("camera")] = 0.0
    mean = State(layout, np.eye(3), vector, so3.exp(rng.normal(size=(3, 3))))
    core = SquareRootFilter(mean, np.ones(layout.dimension), is_wide=False)
    for seed in range(5):
        error = _SMALL * np.random.default_rng(seed).normal(size=layout.dimension)
        error[layout.at("camera")] = 0.0
        factor = np.zeros((layout.dimension, layout.dimension))
        factor[:, 0] = error  # a covariance of this one error
        core.factor = factor
        delta = relative_motion(frame_pair(core, 3, 8), floor_m=0.0)
        np.testing.assert_allclose(delta.T_start_end, se3.inverse(_keyframe_pose(mean)) @ frame_pose(mean), atol=1e-13)
        moved = mean.corrected(error)
        other = se3.inverse(_keyframe_pose(moved)) @ frame_pose(moved)
        local = se3.log(se3.inverse(delta.T_start_end) @ other) / _SMALL
        np.testing.assert_allclose(delta.covariance / _SMALL**2, np.outer(local, local), atol=1e-3)
