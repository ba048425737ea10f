# SPDX-License-Identifier: BSD-3-Clause
"""Leg compliance: estimated by comparing legs with each other, in metres whatever the unit of the loads.

An analytic walk whose joint angles are those of compliant legs: a foot under load F is higher under the hip by
``compliance F / on_force`` than by the kinematics of rigid legs.
"""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
import pytest
from measurement_blocks import blocks_of
from state_layouts import layout_of

from coclo_vio.filter import process_model
from coclo_vio.filter.config import FilterConfig, RobustConfig
from coclo_vio.filter.odometry import LegOdometryFilter
from coclo_vio.filter.stance import Footholds, FootMotion, Reading
from coclo_vio.filter.state import LEG_COMPLIANCE, POSITION, State
from coclo_vio.filter.state_blocks import KNOWN_SIGMA
from coclo_vio.geometry import so3
from coclo_vio.robot.contact import ContactState
from coclo_vio.robot.model import RobotModel
from coclo_vio.simulation.analytic import AnalyticTrial, AnalyticTrialConfig, SensorNoiseConfig, generate
from coclo_vio.simulation.body_motion import BodyMotionConfig
from coclo_vio.values.measurements import FootForceSample, JointSample, Measurement
from coclo_vio.values.units import NS_PER_S

COMPLIANCE_M = 0.0016
RIGID = FilterConfig(robust=RobustConfig(estimates_leg_compliance=False))


@pytest.fixture(scope="module")
def walk(daisy: RobotModel) -> AnalyticTrial:
    body = BodyMotionConfig(rest_s=1.0, walk_s=6.0, stop_s=0.0)
    sensors = SensorNoiseConfig(force_noise_n=0.2, accelerometer_bias_mps2=0.0)
    return generate(AnalyticTrialConfig(body=body, sensors=sensors), daisy, seed=1)


def with_foot_sensors(daisy: RobotModel, per_newton: float = 1.0) -> RobotModel:
    """The robot with sensors in its feet that read so many counts a newton."""
    contact = daisy.description.contact
    forces = {"on_force": contact.on_force * per_newton, "off_force": contact.off_force * per_newton}
    contact = contact.model_copy(update={"source": "force_sensor", **forces})
    return RobotModel(daisy.description.model_copy(update={"contact": contact}))


def compliant(
    robot: RobotModel, trial: AnalyticTrial, compliance_m: float, per_newton: float = 1.0
) -> list[Measurement]:
    """The trial's measurements with legs that are compressed by ``compliance_m`` under 20 N."""
    angles = trial.joint_position.copy()
    for row, (position, load_n) in enumerate(zip(trial.joint_position, trial.load_n, strict=True)):
        down = -compliance_m * load_n[:, None] / 20.0 * trial.body.rotation[row, 2]
        expected_m = robot.feet(position, np.zeros_like(position)).position_body + down
        for _ in range(3):
            feet = robot.feet(angles[row], np.zeros_like(position))
            jacobian = feet.jacobian[:, 3:].reshape(18, 18)
            angles[row] += np.linalg.solve(jacobian, (expected_m - feet.position_body).ravel())
    bent = angles - trial.joint_position
    bending = np.gradient(bent, trial.truth.stamps_ns / NS_PER_S, axis=0)
    row_of = {int(stamp_ns): row for row, stamp_ns in enumerate(trial.truth.stamps_ns)}
    return [_read(sample, bent, bending, row_of, per_newton) for sample in trial.measurements]


def _read(
    sample: Measurement, bent: np.ndarray, bending: np.ndarray, row_of: dict[int, int], per_newton: float
) -> Measurement:
    row = row_of[sample.stamp_ns]
    if isinstance(sample, JointSample):
        return replace(sample, position=sample.position + bent[row], velocity=sample.velocity + bending[row])
    if isinstance(sample, FootForceSample):
        return replace(sample, force=sample.force * per_newton)
    return sample


def run(robot: RobotModel, measurements: Iterable[Measurement], config: FilterConfig) -> tuple[State, float]:
    """The last state, and one sigma of the leg compliance in m."""
    odometry = LegOdometryFilter(robot, config)
    for measurement in measurements:
        odometry.push(measurement)
    core = odometry._core
    assert core is not None
    return core.mean, float(np.sqrt(core.variance(LEG_COMPLIANCE)[0]))


def height_error_m(state: State, walk: AnalyticTrial) -> float:
    return float(state.vector[POSITION][2] - walk.truth.positions[-1, 2] + walk.truth.positions[0, 2])


def test_the_compliance_is_estimated_and_the_height_does_not_drift(daisy: RobotModel, walk: AnalyticTrial) -> None:
    robot = with_foot_sensors(daisy)
    measurements = compliant(robot, walk, COMPLIANCE_M)
    found, sigma_m = run(robot, measurements, FilterConfig())
    assert found.vector[LEG_COMPLIANCE][0] == pytest.approx(COMPLIANCE_M, abs=2.0e-4)
    assert sigma_m < 1.2e-4
    assert abs(height_error_m(found, walk)) < 1e-3
    rigid, sigma_m = run(robot, measurements, RIGID)
    assert abs(rigid.vector[LEG_COMPLIANCE][0]) < KNOWN_SIGMA
    assert sigma_m < 2.0 * KNOWN_SIGMA
    assert height_error_m(rigid, walk) < -4e-3, "five millimetres in 0.9 m of walk"


def test_loads_in_counts_lead_to_the_same_metres(daisy: RobotModel, walk: AnalyticTrial) -> None:
    in_newtons, in_counts = (
        run(with_foot_sensors(daisy, counts), compliant(daisy, walk, COMPLIANCE_M, counts), FilterConfig())[0]
        for counts in (1.0, 7.0)
    )
    np.testing.assert_allclose(in_counts.vector, in_newtons.vector, rtol=0, atol=1e-9)


def test_rigid_legs_are_estimated_as_rigid(daisy: RobotModel, walk: AnalyticTrial) -> None:
    found, _ = run(with_foot_sensors(daisy), walk.measurements, FilterConfig())
    assert abs(found.vector[LEG_COMPLIANCE][0]) < 1e-4
    assert abs(height_error_m(found, walk)) < 1e-3


def test_standing_alone_does_not_determine_the_compliance(daisy: RobotModel) -> None:
    """The load never changes: compliant legs cannot be distinguished from rigid ones, from the first foothold on."""
    body = BodyMotionConfig(rest_s=1.5, walk_s=0.0, stop_s=0.0)
    sensors = SensorNoiseConfig(noise_scale=0.0)
    trial = generate(AnalyticTrialConfig(body=body, sensors=sensors), daisy, seed=1)
    found, sigma_m = run(with_foot_sensors(daisy), trial.measurements, FilterConfig())
    assert found.vector[LEG_COMPLIANCE][0] == pytest.approx(0.0, abs=1e-6)
    assert sigma_m == pytest.approx(RobustConfig().leg_compliance_sigma_m, rel=1e-3)


def loaded_motion(daisy: RobotModel, walk: AnalyticTrial, *loads: np.ndarray) -> FootMotion:
    """The motion of standing feet at the last of so many readings 10 ms apart, with these loads in N."""
    readings = [standing(daisy, walk, row, load) for row, load in enumerate(loads)]
    footholds = Footholds(readings[0], standing_load=20.0)
    for reading in readings[1:]:
        motion = footholds.advance(reading, speed_mps=0.0, is_gap=False)
    return motion


def standing(daisy: RobotModel, walk: AnalyticTrial, row: int, load: np.ndarray) -> Reading:
    """All feet in stance, with the joints of this row of the walk."""
    feet = daisy.feet(walk.joint_position[row], walk.joint_velocity[row])
    contact = ContactState(np.ones(6), np.ones(6, dtype=np.bool_), load)
    return Reading(10_000_000 * row, feet, contact, np.zeros(3), (), None, False)


def test_load_ratio_is_the_load_over_that_of_a_standing_foot(daisy: RobotModel, walk: AnalyticTrial) -> None:
    motion = loaded_motion(daisy, walk, np.full(6, 20.0), np.array([20.0, 30.0, 0.0, -5.0, 10.0, 1e9]))
    np.testing.assert_allclose(motion.load_ratio, [1.0, 1.5, 0.0, 0.0, 0.5, 20.0])
    np.testing.assert_allclose(motion.load_ratio_rate, (motion.load_ratio - 1.0) / 0.01)


def test_an_unknown_load_stays_the_last_known_and_does_not_change(daisy: RobotModel, walk: AnalyticTrial) -> None:
    """A load that becomes unknown or known is no step of the load, which would move the leg by decimetres a second."""
    known, unknown = np.full(6, 30.0), np.where(np.arange(6) == 2, np.nan, 30.0)
    gone = loaded_motion(daisy, walk, known, unknown)
    back = loaded_motion(daisy, walk, known, unknown, np.full(6, 36.0))
    never = loaded_motion(daisy, walk, unknown, unknown)
    np.testing.assert_allclose(gone.load_ratio, 1.5)
    np.testing.assert_array_equal(gone.load_ratio_rate, 0.0)
    assert back.load_ratio[2] == pytest.approx(1.8)
    assert back.load_ratio_rate[2] == 0.0
    assert back.load_ratio_rate[1] == pytest.approx(30.0)
    assert never.load_ratio[2] == 0.0


def spread_in_compliance(state: State, compliances_m: np.ndarray) -> State:
    """A stack of this state with these values of the leg compliance."""
    vector = np.tile(state.vector, (len(compliances_m), 1))
    vector[:, LEG_COMPLIANCE] = compliances_m[:, None]
    return replace(state, rotation=np.tile(state.rotation, (len(compliances_m), 1, 1)), vector=vector)


def test_compliance_lowers_a_loaded_foot_in_the_kinematics_but_not_an_unloaded_one(
    daisy: RobotModel, walk: AnalyticTrial
) -> None:
    """The derivative of each position row is minus load ratio times up, exactly; of each velocity row zero."""
    layout = layout_of(6)
    vector = np.random.default_rng(1).normal(size=layout.dimension)
    state = State(layout, so3.exp(np.array([0.2, -0.1, 1.0])), vector)
    loads = np.array([0.0, 20.0, 30.0, 40.0, 0.0, 10.0])
    motion = loaded_motion(daisy, walk, np.full(6, 20.0), loads)
    blocks = blocks_of(daisy, standing(daisy, walk, 1, loads), motion, state)
    compliances_m = np.array([0.0, 1e-3, 0.5])
    _, velocity, position = (block.model(spread_in_compliance(state, compliances_m)) for block in blocks)
    slope = np.diff(position, axis=0) / np.diff(compliances_m)[:, None]
    expected = -(loads / 20.0)[:, None] * state.rotation[2]
    np.testing.assert_allclose(slope.reshape(2, 6, 3), np.stack((expected, expected)), atol=1e-10)
    np.testing.assert_array_equal(velocity, velocity[:1].repeat(3, axis=0))


def test_the_velocity_of_compression_is_compensated(daisy: RobotModel, walk: AnalyticTrial) -> None:
    """A leg whose load ratio grows by 10 a second at 2 mm each is compressed at 2 cm/s while the body stands."""
    layout = layout_of(6)
    vector = np.zeros(layout.dimension)
    vector[LEG_COMPLIANCE] = 2e-3
    state = State(layout, np.eye(3), vector)
    motion = loaded_motion(daisy, walk, np.full(6, 20.0), np.array([20.0, 22.0, 20.0, 20.0, 18.0, 20.0]))
    blocks = blocks_of(daisy, standing(daisy, walk, 1, np.full(6, 20.0)), motion, state)
    velocity = blocks[1].model(spread_in_compliance(state, np.array([2e-3]))).reshape(6, 3)
    np.testing.assert_allclose(velocity[:, 2], [0.0, 0.02, 0.0, 0.0, -0.02, 0.0], atol=1e-12)
    np.testing.assert_array_equal(velocity[:, :2], 0.0)


def test_a_carried_foot_is_higher_by_the_compression_of_its_leg(daisy: RobotModel, walk: AnalyticTrial) -> None:
    layout = layout_of(6)
    state = State(layout, so3.exp(np.array([0.2, -0.1, 1.0])), np.zeros(layout.dimension))
    motion = loaded_motion(daisy, walk, np.full(6, 20.0), np.array([0.0, 20.0, 30.0, 40.0, 0.0, 10.0]))
    swings = motion._replace(holds=np.zeros(6, dtype=np.bool_))
    stack = spread_in_compliance(state, np.array([0.0, 1e-3]))
    feet = process_model.predict(stack, 0.01, swings, daisy.foot_radii_m, daisy.hip_position_body).feet
    raised = feet[1] - feet[0]
    np.testing.assert_allclose(raised[:, 2], 1e-3 * motion.load_ratio, atol=1e-15)
    np.testing.assert_allclose(raised[:, :2], 0.0, atol=1e-15)
    held = process_model.predict(stack, 0.01, motion, daisy.foot_radii_m, daisy.hip_position_body).feet
    np.testing.assert_array_equal(held[0], held[1])
