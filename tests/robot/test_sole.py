# SPDX-License-Identifier: BSD-3-Clause
"""Corners of flat feet, the point at which they touch the ground, and a robot that sways over them."""

from pathlib import Path

import numpy as np
import pytest
from flat_biped import HALF_WIDTH_M, HEEL_M, TOE_M, write_biped

from coclo_vio.geometry import so3
from coclo_vio.robot.description import RobotDescription
from coclo_vio.robot.description_check import check_description
from coclo_vio.robot.model import RobotModel
from coclo_vio.robot.sole_contact import SoleContact
from coclo_vio.robot.standstill import StandstillConfig, StandstillDetector
from coclo_vio.values.errors import ConfigError
from coclo_vio.values.measurements import ImuSample, JointSample

CORNERS = [(x, y, 0.0) for x in (HEEL_M, TOE_M) for y in (-HALF_WIDTH_M, HALF_WIDTH_M)]
STANDING = np.tile([0.0, 0.0, -0.4, 0.8, -0.4, 0.0], 2)


def with_points(description: RobotDescription, points: object, **changes: object) -> RobotDescription:
    legs = [leg.model_dump() | {"contact_points_m": points} | changes for leg in description.legs]
    return RobotDescription.parse(description.model_dump() | {"legs": legs}, "test")


def kinds(description: RobotDescription) -> set[str]:
    return {finding.kind for finding in check_description(description)}


def test_corners_are_those_of_the_box_below_the_foot(tmp_path: Path) -> None:
    for sole in RobotModel(write_biped(tmp_path)).soles:
        assert sole is not None
        assert {tuple(np.round(point, 9) + 0.0) for point in sole} == set(CORNERS)


def test_a_foot_of_unknown_shape_is_flat_without_corners(tmp_path: Path) -> None:
    description = write_biped(tmp_path, has_sole_shape=False, sole_name="plate")
    assert description.has_flat_feet
    assert all(sole is not None and sole.shape == (0, 3) for sole in RobotModel(description).soles)
    assert not SoleContact(RobotModel(description))
    assert "sole_unknown" in kinds(description)


def test_described_corners_are_those_that_count(tmp_path: Path) -> None:
    points = [[0.1, 0.0, 0.0], [-0.1, 0.05, 0.0], [-0.1, -0.05, 0.0]]
    description = with_points(write_biped(tmp_path), points)
    np.testing.assert_allclose(RobotModel(description).soles[0], points)
    assert kinds(description) & {"sole_differs", "sole_unknown"} == {"sole_differs"}
    assert not kinds(with_points(description, CORNERS)) & {"sole_differs", "sole_unknown", "sole_implausible"}
    in_millimetres = [[1e3 * value for value in point] for point in CORNERS]
    assert "sole_implausible" in kinds(with_points(description, in_millimetres))


@pytest.mark.parametrize(
    ("points", "changes", "words"),
    [
        ([[0.1, 0.0, 0.0], [-0.1, 0.0, 0.0]], {}, "2 points, which span no surface"),
        ([[0.1, 0.0, 0.0], [0.0, 0.0, 0.0], [-0.1, 0.0, 0.0]], {}, "span no surface"),
        (CORNERS, {"foot_radius_m": 0.02}, "give one of the two"),
    ],
)
def test_a_sole_that_is_none_is_refused(tmp_path: Path, points: object, changes: dict[str, object], words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        with_points(write_biped(tmp_path), points, **changes)


@pytest.mark.parametrize(("angle_rad", "expected_m"), [(0.3, TOE_M), (-0.3, HEEL_M), (0.0, 0.5 * (TOE_M + HEEL_M))])
def test_the_foot_is_at_its_toe_its_heel_or_its_middle(tmp_path: Path, angle_rad: float, expected_m: float) -> None:
    robot = RobotModel(write_biped(tmp_path))
    feet = robot.feet(STANDING, np.full(12, 0.1))
    up_body = so3.exp(np.array([0.0, angle_rad, 0.0])).T @ [0.0, 0.0, 1.0]  # the soles are level in the body
    moved, _ = SoleContact(robot).moved(feet, up_body)
    for leg in range(2):
        arm = feet.rotation_body_foot[leg].T @ (moved.position_body[leg] - feet.position_body[leg])
        np.testing.assert_allclose(arm, [expected_m, 0.0, 0.0], atol=1e-6)
        expected = feet.velocity_body[leg] + np.cross(
            feet.angular_velocity_body[leg], moved.position_body[leg] - feet.position_body[leg]
        )
        np.testing.assert_allclose(moved.velocity_body[leg], expected, atol=1e-12)
        np.testing.assert_allclose(moved.jacobian[leg, 3:] @ np.full(12, 0.1), expected, atol=1e-12)


def is_swaying_rest(*, has_flat_feet: bool) -> bool:
    """Whether a smooth sway of 0.1 rad in 5 s counts as standstill at its turning point."""
    detector = StandstillDetector(StandstillConfig().limits_of(has_flat_feet=has_flat_feet))
    for stamp_ns in range(0, 1_250_000_000, 10_000_000):
        phase = 2.0 * np.pi * 0.2 * stamp_ns * 1e-9
        detector.push(ImuSample(stamp_ns, np.array([0.03 * np.cos(phase), 0.0, 0.0]), np.array([0.0, 0.0, 9.81])))
        velocity = np.array([0.1 * 2.0 * np.pi * 0.2 * np.cos(phase)])
        detector.push(JointSample(stamp_ns, np.array([0.1 * np.sin(phase)]), velocity, np.zeros(1)))
    return detector.is_stationary


def test_a_slow_sway_over_flat_feet_is_no_standstill() -> None:
    assert is_swaying_rest(has_flat_feet=False)  # as smooth as rest
    assert not is_swaying_rest(has_flat_feet=True)


def test_noisy_encoders_at_rest_are_a_standstill() -> None:
    rng = np.random.default_rng(3)
    detector = StandstillDetector(StandstillConfig().limits_of(has_flat_feet=True))
    count = 0
    for stamp_ns in range(0, 5_000_000_000, 10_000_000):
        detector.push(ImuSample(stamp_ns, np.zeros(3), np.array([0.0, 0.0, 9.81])))
        detector.push(JointSample(stamp_ns, rng.normal(0.0, 1e-3, 12), rng.normal(0.0, 0.02, 12), np.zeros(12)))
        count += detector.is_stationary
    assert count > 440
