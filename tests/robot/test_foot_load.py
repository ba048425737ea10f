# SPDX-License-Identifier: BSD-3-Clause
"""The load on a foot, from torques of an exact walk whose ground forces are known, and from sensors."""

from collections.abc import Iterator

import numpy as np
import pytest

from coclo_vio.robot.contact import ContactConfig
from coclo_vio.robot.description import load_robot
from coclo_vio.robot.foot_load import FootLoad
from coclo_vio.robot.model import RobotModel
from coclo_vio.simulation.analytic import AnalyticTrial, AnalyticTrialConfig, SensorNoiseConfig, generate
from coclo_vio.simulation.body_motion import BodyMotionConfig
from coclo_vio.simulation.gait import GaitConfig
from coclo_vio.values.arrays import Array
from coclo_vio.values.errors import RobotModelError
from coclo_vio.values.measurements import FootForceSample, JointSample

UP = np.array([0.0, 0.0, 1.0])
DAISY = RobotModel(load_robot("daisy"))
SENSOR = ContactConfig(source="force_sensor", on_force=60, off_force=30)


@pytest.fixture(scope="module")
def brisk_walk() -> AnalyticTrial:
    """Exact sensors, legs swung fast: their inertia shows."""
    config = AnalyticTrialConfig(
        body=BodyMotionConfig(rest_s=0.2, walk_s=1.6, stop_s=0.0, ramp_s=0.4, speed_mps=0.25),
        gait=GaitConfig(cycle_s=1.0),
        sensors=SensorNoiseConfig(noise_scale=0.0),
    )
    return generate(config, DAISY, seed=5)


def _errors(trial: AnalyticTrial, config: ContactConfig) -> Array:
    """Load less true load of every foot at every sample after the first, N, (N - 1, legs)."""
    load = FootLoad(DAISY, config, force_timeout_s=0.1)
    loads = [
        load.loads_at(sample, trial.body.rotation[k, 2], trial.body.angular_velocity[k])
        for k, sample in enumerate(_joints(trial))
    ]
    return (np.array(loads) - trial.load_n)[1:]


def _joints(trial: AnalyticTrial) -> Iterator[JointSample]:
    return (sample for sample in trial.measurements if isinstance(sample, JointSample))


def test_each_compensation_removes_its_part_of_the_leg_dynamics(brisk_walk) -> None:
    """RMS error of the load of swinging feet, which is zero: inertia < gravity < none, and by much."""
    swings = ~brisk_walk.stance[1:]
    rms = {
        name: np.sqrt((_errors(brisk_walk, ContactConfig(compensation=name))[swings] ** 2).mean())
        for name in ("none", "gravity", "inertia")
    }
    assert rms["inertia"] < 1.5
    assert rms["gravity"] > 2.0 * rms["inertia"]
    assert rms["none"] > 2.0 * rms["gravity"]


def test_the_loads_of_standing_feet_add_up_to_the_weight(brisk_walk) -> None:
    load = FootLoad(DAISY, ContactConfig(compensation="gravity"), force_timeout_s=0.1)
    first = next(_joints(brisk_walk))
    loads = load.loads_at(first, brisk_walk.body.rotation[0, 2], None)
    assert loads.sum() == pytest.approx(DAISY.mass_kg * 9.81, rel=1e-6)
    np.testing.assert_allclose(loads, brisk_walk.load_n[0], atol=1e-6)


def test_the_first_sample_has_no_acceleration_and_is_compensated_for_gravity(brisk_walk) -> None:
    sample = list(_joints(brisk_walk))[60]
    loads = [
        FootLoad(DAISY, ContactConfig(compensation=name), 0.1).loads_at(sample, UP, np.zeros(3))
        for name in ("gravity", "inertia")
    ]
    assert (loads[0] == loads[1]).all()


def test_the_paper_s_method_takes_the_length_of_the_force(brisk_walk) -> None:
    sample = list(_joints(brisk_walk))[60]
    vertical, length = (
        FootLoad(DAISY, ContactConfig(compensation="none", method=method), 0.1).loads_at(sample, UP, None)
        for method in ("hysteresis", "paper")
    )
    forces = DAISY.foot_forces(sample.position, sample.velocity, sample.effort)
    np.testing.assert_allclose(length, np.linalg.norm(forces, axis=1))
    np.testing.assert_allclose(vertical, forces[:, 2])


def test_up_is_where_the_load_is_measured_along(brisk_walk) -> None:
    sample = next(_joints(brisk_walk))
    tilt = np.array([0.3, 0.0, np.sqrt(1.0 - 0.09)])
    loads = FootLoad(DAISY, ContactConfig(compensation="none"), 0.1).loads_at(sample, tilt, None)
    np.testing.assert_allclose(loads, DAISY.foot_forces(sample.position, sample.velocity, sample.effort) @ tilt)


def test_a_missing_torque_makes_the_load_of_its_leg_unknown(brisk_walk) -> None:
    sample = next(_joints(brisk_walk))
    effort = sample.effort.copy()
    effort[4] = np.nan
    loads = FootLoad(DAISY, ContactConfig(), 0.1).loads_at(
        JointSample(sample.stamp_ns, sample.position, sample.velocity, effort), UP, None
    )
    assert np.flatnonzero(np.isnan(loads)).tolist() == [1]


def _joints_at(stamp_ns: int) -> JointSample:
    return JointSample(stamp_ns, np.zeros(18), np.zeros(18), np.full(18, np.nan))


def test_sensors_are_held_until_they_are_too_old() -> None:
    load = FootLoad(DAISY, SENSOR, force_timeout_s=0.1)
    assert np.isnan(load.loads_at(_joints_at(0), UP, None)).all()
    force = np.arange(6.0)
    assert load.push(FootForceSample(10_000_000, force))
    assert (load.loads_at(_joints_at(20_000_000), UP, None) == force).all()
    assert (load.loads_at(_joints_at(110_000_000), UP, None) == force).all()
    assert np.isnan(load.loads_at(_joints_at(110_000_001), UP, None)).all()


def test_an_older_or_repeated_sensor_sample_is_refused() -> None:
    load = FootLoad(DAISY, SENSOR, force_timeout_s=1.0)
    assert load.push(FootForceSample(10, np.full(6, 1.0)))
    assert not load.push(FootForceSample(10, np.full(6, 2.0)))
    assert not load.push(FootForceSample(9, np.full(6, 3.0)))
    assert (load.loads_at(_joints_at(20), UP, None) == 1.0).all()


def test_a_sensor_sample_of_another_robot_is_refused_with_the_numbers() -> None:
    with pytest.raises(RobotModelError, match="4 entries, robot 'daisy' has 6 legs"):
        FootLoad(DAISY, SENSOR, force_timeout_s=1.0).push(FootForceSample(0, np.zeros(4)))
