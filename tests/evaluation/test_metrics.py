# SPDX-License-Identifier: BSD-3-Clause
"""Metrics with answers known by hand."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from coclo_vio.evaluation import metrics
from coclo_vio.geometry import se3, so3
from coclo_vio.values.trajectory import Trajectory


def shifted(trajectory: Trajectory, by: tuple[float, float, float]) -> Trajectory:
    return trajectory.moved(se3.transform(np.eye(3), np.array(by)))


def circle(radius_m: float, count: int = 2001, turns: float = 1.0) -> Trajectory:
    """Counter-clockwise, facing along the tangent, in 20 s."""
    angle = np.linspace(0.0, 2.0 * np.pi * turns, count)
    position = radius_m * np.stack((np.sin(angle), 1.0 - np.cos(angle), 0.0 * angle), axis=1)
    stamps_ns = np.rint(np.linspace(0.0, 20.0, count) * 1e9).astype(np.int64)
    return Trajectory(stamps_ns, se3.transform(Rotation.from_euler("z", angle[:, None]).as_matrix(), position))


def test_ate_is_the_root_of_the_mean_square(line):
    assert metrics.ate_m(shifted(line(5.0), (0.3, 0.4, 1.2)), line(5.0)) == pytest.approx(1.3)
    assert metrics.ate_planar_m(shifted(line(5.0), (0.3, 0.4, 1.2)), line(5.0)) == pytest.approx(0.5)


def test_uniform_motion_keeps_its_length(line):
    for metres in (0.0, 1.0, 10.0):
        travelled = metrics.travelled_m(line(metres), 0.1)
        np.testing.assert_allclose(travelled, np.linspace(0.0, metres, len(travelled)), atol=1e-9)
    assert metrics.travelled_m(line(3.0, 0.05), 0.1)[-1] == pytest.approx(3.0)


def test_length_hardly_grows_with_noise(line):
    noise = np.random.default_rng(1).normal(0.0, 0.001, (1001, 3))
    noisy = replace(line(5.0), T_world_body=se3.transform(line(5.0).rotations, line(5.0).positions + noise))
    assert metrics.travelled_m(noisy, 0.1)[-1] == pytest.approx(5.0, abs=0.01)
    still = replace(line(0.0), T_world_body=se3.transform(line(0.0).rotations, noise))
    assert noisy.path_length_m() > 5.01
    assert metrics.travelled_m(still, 0.1)[-1] < 0.2 * still.path_length_m()


def test_segments_end_at_the_nearest_pose():
    travelled = np.array([0.0, 0.3, 0.6, 0.95, 1.25, 1.66])
    assert metrics.segments(travelled, 1.0).tolist() == [[0, 3], [1, 4], [2, 5]]
    assert metrics.segments(np.zeros(5), 1.0).shape == (0, 2)


def test_rpe_of_a_scale_error_is_the_scale_error(line):
    travelled = metrics.travelled_m(line(10.0), 0.1)
    assert metrics.rpe_percent(line(10.0, scale=1.01), line(10.0), travelled, 1.0) == pytest.approx(1.0, abs=1e-6)
    assert metrics.rpe_percent(line(0.5), line(0.5), metrics.travelled_m(line(0.5), 0.1), 1.0) is None


def test_drift_over_segments_of_a_scale_error_is_the_scale_error(line):
    assert metrics.segment_drift_percent(line(10.0, scale=1.01), line(10.0), 2.0) == pytest.approx(1.0, abs=1e-6)
    assert metrics.segment_drift_percent(line(0.5), line(0.5), 1.0) is None


def test_drift_over_segments_is_a_mean_over_all_of_them():
    """Of four steps of a metre the third comes out 0.1 m too long: two of the three segments of 2 m hold it."""
    reference = _along([0.0, 1.0, 2.0, 3.0, 4.0])
    estimate = _along([0.0, 1.0, 2.0, 3.1, 4.1])
    assert metrics.segment_drift_percent(estimate, reference, 2.0) == pytest.approx(100.0 * (0.1 + 0.1) / 3 / 2.0)
    assert metrics.segment_drift_percent(estimate, reference, 4.0) == pytest.approx(100.0 * 0.1 / 4.0)


def test_drift_over_segments_is_free_of_the_heading_before_them():
    """A turn of 90 degrees that is missed ruins the segments that hold it, and no other."""
    straight = _along([0.0, 1.0, 2.0, 3.0, 4.0])
    bent = np.array(straight.T_world_body)
    bent[2:, :3, :3] = so3.about_z(0.5 * np.pi)
    bent[2:, :3, 3] = [[2.0, 0.0, 0.0], [2.0, 1.0, 0.0], [2.0, 2.0, 0.0]]
    estimate = replace(straight, T_world_body=bent)
    # segments 0-2 and 2-4 are exact; 1-3 ends at (1, 1) instead of (2, 0)
    assert metrics.segment_drift_percent(estimate, straight, 2.0) == pytest.approx(100.0 * np.sqrt(2.0) / 3 / 2.0)


def _along(metres: list[float]) -> Trajectory:
    positions = np.array([[each, 0.0, 0.0] for each in metres])
    stamps_ns = np.arange(len(metres), dtype=np.int64) * 100_000_000
    return Trajectory(stamps_ns, se3.transform(np.tile(np.eye(3), (len(metres), 1, 1)), positions))


def test_rpe_takes_a_heading_error_at_the_start_of_a_segment_as_an_error(line):
    turned = replace(line(10.0), T_world_body=line(10.0).T_world_body @ se3.transform(so3.about_z(0.02), np.zeros(3)))
    travelled = metrics.travelled_m(line(10.0), 0.1)
    assert metrics.rpe_percent(turned, line(10.0), travelled, 1.0) == pytest.approx(200.0 * np.sin(0.01), abs=1e-6)


def test_drift_is_the_last_error_over_the_path(line):
    estimate = line(10.0, scale=0.97)
    assert metrics.drift_percent(estimate, line(10.0), 10.0) == pytest.approx(3.0)
    assert metrics.drift_percent(line(0.0), line(0.0), 0.0) is None


def test_paper_drift_of_a_loop_is_taken_after_the_first_metre():
    reference = circle(1.0)
    travelled = metrics.travelled_m(reference, 0.1)
    instant = metrics.paper_drift_instant(reference, travelled, 0.2)
    index = metrics.index_at(instant, travelled)
    assert instant == "first_metre"
    assert travelled[index] == pytest.approx(1.0, abs=0.005)
    chord = 2.0 * np.sin(0.5)
    drift = metrics.paper_drift_percent(shifted(reference, (0.0, 0.0, 0.01)), reference, index)
    assert drift == pytest.approx(1.0 / chord, rel=0.01)
    assert metrics.paper_drift_percent(reference, reference, len(reference) - 1) is None


def test_paper_drift_of_a_line_is_taken_at_its_end(line):
    travelled = metrics.travelled_m(line(5.0), 0.1)
    assert metrics.paper_drift_instant(line(5.0), travelled, 0.2) == "end"
    assert metrics.index_at("end", travelled) == 1000
    assert metrics.index_at("first_metre", metrics.travelled_m(line(0.9), 0.1)) is None
    assert metrics.paper_drift_percent(line(5.0, scale=1.02), line(5.0), 1000) == pytest.approx(2.0)
    assert metrics.paper_drift_percent(line(5.0), line(5.0), None) is None


@pytest.mark.parametrize("drift_deg", [7.0, -7.0])
def test_yaw_drift_has_the_sign_of_the_turn_and_survives_full_turns(drift_deg):
    reference = circle(1.0, turns=2.5)
    ramp = np.radians(drift_deg) * np.clip((reference.times_s - 2.0) / 18.0, 0.0, 1.0)
    turn = Rotation.from_euler("z", (ramp + 3.0)[:, None]).as_matrix()
    estimate = replace(reference, T_world_body=se3.transform(turn @ reference.rotations, np.array(reference.positions)))
    assert metrics.yaw_drift_deg(estimate, reference, 1.0) == pytest.approx(drift_deg, abs=1e-6)


def test_velocity_from_positions_is_exact_for_constant_acceleration():
    seconds = np.arange(0.0, 3.0, 0.01)
    position = np.stack((0.5 * seconds**2, -seconds, 0.0 * seconds), axis=1)
    trajectory = Trajectory(
        np.rint(seconds * 1e9).astype(np.int64), se3.transform(np.tile(np.eye(3), (len(seconds), 1, 1)), position)
    )
    velocity, is_trusted = metrics.velocities(trajectory, 0.25, 0.25)
    assert is_trusted.sum() == pytest.approx(len(seconds) - 26, abs=2)
    expected = np.stack((seconds, -np.ones_like(seconds), 0.0 * seconds), axis=1)
    np.testing.assert_allclose(velocity[is_trusted], expected[is_trusted], atol=1e-9)
    holed = trajectory.select((seconds < 1.0) | (seconds > 1.6))
    _, is_trusted = metrics.velocities(holed, 0.25, 0.25)
    assert not is_trusted[(holed.times_s > 0.9) & (holed.times_s < 1.7)].any()
    assert is_trusted[(holed.times_s > 0.2) & (holed.times_s < 0.8)].all()


def test_velocity_of_too_few_poses_is_trusted_nowhere(line):
    assert not metrics.velocities(line(1.0).select(np.arange(4)), 0.25, 0.25)[1].any()
    assert not metrics.velocities(line(1.0).select(np.arange(10)), 0.25, 0.25)[1].any()
    nothing = np.zeros(3, dtype=np.bool_)
    assert metrics.velocity_rmse_mps(np.ones((3, 3)), np.zeros((3, 3)), nothing) is None
    assert metrics.velocity_rmse_mps(np.ones((3, 3)), np.zeros((3, 3)), ~nothing) == pytest.approx(np.sqrt(3.0))


def test_ratio_of_paths_is_not_defined_at_rest():
    assert metrics.path_length_ratio(0.99, 1.0) == 0.99
    assert metrics.path_length_ratio(0.0, 0.0) is None


def test_start_tilt_is_the_angle_between_verticals(line):
    tilted = replace(
        line(1.0),
        T_world_body=line(1.0).T_world_body @ se3.transform(so3.exp(np.array([0.03, 0.04, 0.0])), np.zeros(3)),
    )
    turned = tilted.moved(se3.transform(so3.about_z(2.0), np.zeros(3)))
    assert metrics.start_tilt_deg(turned, line(1.0), 1.0) == pytest.approx(np.degrees(0.05))
