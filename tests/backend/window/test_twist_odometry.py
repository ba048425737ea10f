# SPDX-License-Identifier: BSD-3-Clause
"""A measured body twist as odometry: motions known by hand, and a covariance that grows with time."""

import numpy as np
import pytest

from coclo_vio.backend.window.config import TwistConfig
from coclo_vio.backend.window.twist_odometry import TwistOdometry
from coclo_vio.geometry import se3, so3
from coclo_vio.values.measurements import BodyTwistSample

CONFIG = TwistConfig(rate_noise_density=0.03, velocity_noise_density=0.05)
STEP_NS = 10_000_000


def driven(end_s: float, rate: float, speed: float, start_ns: int = 0) -> TwistOdometry:
    """Along a circle to the left, samples at 100 Hz up to ``end_s``."""
    odometry = TwistOdometry(CONFIG)
    odometry.push(twist(start_ns, rate, speed))
    odometry.restart(start_ns)
    for number in range(1, round(end_s * 100) + 1):
        odometry.push(twist(start_ns + number * STEP_NS, rate, speed))
    return odometry


def twist(stamp_ns: int, rate: float, speed: float) -> BodyTwistSample:
    return BodyTwistSample(stamp_ns, np.array([0.0, 0.0, rate]), np.array([speed, 0.0, 0.0]))


def test_a_quarter_of_a_circle_ends_beside_its_centre() -> None:
    """1 m/s, a quarter turn in 1 s: radius 2 / pi, at (r, r), facing left."""
    delta = driven(1.0, np.pi / 2, 1.0).delta_until(1_000_000_000)
    assert delta is not None
    radius = 2.0 / np.pi
    np.testing.assert_allclose(delta.T_start_end[:3, 3], [radius, radius, 0.0], atol=1e-12)
    np.testing.assert_allclose(delta.T_start_end[:3, :3], so3.about_z(np.pi / 2), atol=1e-12)
    assert (delta.start_ns, delta.end_ns) == (0, 1_000_000_000)


def test_a_speed_that_rises_evenly_is_integrated_exactly() -> None:
    odometry = TwistOdometry(CONFIG)
    for number in range(101):
        odometry.push(twist(number * STEP_NS, 0.0, 0.02 * number))
        if number == 0:
            odometry.restart(0)
    delta = odometry.delta_until(1_000_000_000)
    assert delta is not None
    assert delta.T_start_end[0, 3] == pytest.approx(1.0)  # half of 2 m/s^2 over a second


def test_straight_on_its_variance_grows_with_time_and_sideways_with_its_cube() -> None:
    """Heading is a random walk; what it adds sideways is v^2 q t^3 / 3."""
    for time_s in (1.0, 4.0):
        delta = driven(time_s, 0.0, 2.0).delta_until(round(time_s * 1e9))
        assert delta is not None
        variance = np.diag(delta.covariance)
        np.testing.assert_allclose(variance[:3], 0.03**2 * time_s, rtol=1e-6)
        assert variance[3] == pytest.approx(0.05**2 * time_s, rel=1e-6)
        assert variance[4] == pytest.approx(0.05**2 * time_s + 2.0**2 * 0.03**2 * time_s**3 / 3.0, rel=0.02)
        assert np.linalg.eigvalsh(delta.covariance).min() > 0.0


def test_after_the_last_sample_the_twist_is_constant() -> None:
    delta = driven(1.0, 0.0, 1.0).delta_until(1_005_000_000)
    assert delta is not None
    assert delta.T_start_end[0, 3] == pytest.approx(1.005)


def test_a_delta_on_the_way_changes_nothing() -> None:
    queried = driven(0.5, 0.7, 1.0)
    queried.delta_until(500_000_000)
    for number in range(51, 101):
        queried.push(twist(number * STEP_NS, 0.7, 1.0))
        queried.delta_until(number * STEP_NS)
    whole, piecewise = driven(1.0, 0.7, 1.0).delta_until(1_000_000_000), queried.delta_until(1_000_000_000)
    assert whole is not None
    assert piecewise is not None
    np.testing.assert_allclose(piecewise.T_start_end, whole.T_start_end, atol=1e-12)
    np.testing.assert_allclose(piecewise.covariance, whole.covariance, rtol=1e-9)


def test_pieces_after_a_restart_make_the_whole() -> None:
    odometry = driven(0.4, 0.7, 1.0)
    first = odometry.delta_until(400_000_000)
    odometry.restart(400_000_000)
    for number in range(41, 101):
        odometry.push(twist(number * STEP_NS, 0.7, 1.0))
    second, whole = odometry.delta_until(1_000_000_000), driven(1.0, 0.7, 1.0).delta_until(1_000_000_000)
    assert first is not None
    assert second is not None
    assert whole is not None
    assert second.start_ns == 400_000_000
    np.testing.assert_allclose(first.T_start_end @ second.T_start_end, whole.T_start_end, atol=1e-12)
    back = se3.adjoint(se3.inverse(second.T_start_end))
    chained = back @ first.covariance @ back.T + second.covariance
    np.testing.assert_allclose(chained, whole.covariance, rtol=1e-3, atol=1e-9)


def test_samples_that_are_not_newer_are_left_out() -> None:
    odometry = driven(1.0, 0.0, 1.0)
    odometry.push(twist(1_000_000_000, 0.0, 50.0))
    odometry.push(twist(900_000_000, 0.0, 50.0))
    delta = odometry.delta_until(1_000_000_000)
    assert delta is not None
    assert delta.T_start_end[0, 3] == pytest.approx(1.0)


def test_without_a_start_a_twist_or_any_time_there_is_no_delta() -> None:
    assert TwistOdometry().delta_until(1) is None
    started = TwistOdometry()
    started.restart(0)
    assert started.delta_until(1) is None
    assert driven(1.0, 0.0, 1.0, start_ns=5).delta_until(5) is None
    unstarted = TwistOdometry()
    unstarted.push(twist(0, 0.0, 1.0))
    assert unstarted.delta_until(10) is None
