# SPDX-License-Identifier: BSD-3-Clause
"""reset and reanchor: where the estimate goes on, how certain it is, what is kept."""

from collections.abc import Sequence

import numpy as np
import pytest

import coclo_vio as cv
from coclo_vio.geometry import se3, so3
from coclo_vio.online.output_frame import OutputFrame
from coclo_vio.values.estimates import NavState, StateEstimate
from coclo_vio.values.outputs import Estimate, WindowSnapshot

GIVEN = se3.transform(so3.about_z(1.2), np.array([4.0, -3.0, 0.5]))
SIGMAS = np.array([0.02, 0.02, 0.05, 0.3, 0.3, 0.1])
S = 1_000_000_000


def walked(sample: cv.Recording, walk: Sequence[cv.Measurement], until_s: float) -> tuple[cv.GuardedEstimator, int]:
    odometry = cv.make_estimator("coclo", robot=sample.robot, calibration=sample.calibration)
    for index, measurement in enumerate(walk):
        if measurement.stamp_ns - walk[0].stamp_ns > until_s * S:
            return odometry, index
        odometry.push(measurement)
    raise AssertionError


def goes_on(
    odometry: cv.GuardedEstimator, walk: Sequence[cv.Measurement]
) -> tuple[list[cv.StateEstimate], list[cv.Event]]:
    outputs = [output for measurement in walk for output in odometry.push(measurement)] + [*odometry.finish()]
    states = [output.state for output in outputs if isinstance(output, cv.Estimate)]
    return states, [output for output in outputs if isinstance(output, cv.Event)]


def test_reset_to_a_given_pose(sample: cv.Recording, walk: Sequence[cv.Measurement]) -> None:
    odometry, index = walked(sample, walk, 4.0)
    odometry.reset(GIVEN, np.diag(SIGMAS**2))
    states, events = goes_on(odometry, walk[index:])
    first = states[0]
    np.testing.assert_allclose(first.nav.T_world_body[:3, 3], GIVEN[:3, 3], atol=1e-9)
    assert so3.yaw(first.nav.T_world_body[:3, :3]) == pytest.approx(1.2, abs=1e-9)
    sigmas = np.sqrt(np.diag(first.covariance)[:6])
    np.testing.assert_allclose(sigmas[3:], SIGMAS[3:], rtol=0.1)
    assert sigmas[2] == pytest.approx(SIGMAS[2], rel=0.2), "heading"
    (event,) = [event for event in events if event.kind == "reset"]
    assert "gyroscope_bias" in event.detail
    assert odometry.counts["reset"] == 1


def test_reset_keeps_the_biases(sample: cv.Recording, walk: Sequence[cv.Measurement]) -> None:
    """What rest has shown of the gyroscope's bias is known after a reset on the move, and how well."""
    odometry, index = walked(sample, walk, 6.0)
    before = odometry._estimator
    assert isinstance(before, cv.StreamingEstimator)
    kept = before.learnt["gyroscope_bias"]  # type: ignore[attr-defined]
    odometry.reset()
    states, _ = goes_on(odometry, walk[index:])
    assert odometry.counts["started_moving"] == 1
    np.testing.assert_allclose(states[0].nav.gyroscope_bias, kept[0], atol=3.0 * kept[1].max())
    after = odometry._estimator.learnt["gyroscope_bias"][1]  # type: ignore[attr-defined]
    assert (after < 1.5 * kept[1]).all()


def test_reset_without_a_pose_goes_on_at_the_last_one(sample: cv.Recording, walk: Sequence[cv.Measurement]) -> None:
    odometry, index = walked(sample, walk, 6.0)
    before = odometry._frame.last_pose
    assert before is not None
    odometry.reset()
    states, _ = goes_on(odometry, walk[index:])
    np.testing.assert_allclose(states[0].nav.T_world_body[:3, 3], before[0][:3, 3], atol=1e-9)
    assert states[0].covariance[3:6, 3:6].trace() >= 0.99 * before[1][3:, 3:].trace()


@pytest.mark.long
def test_reanchoring_moves_the_world_and_nothing_else(sample: cv.Recording, walk: Sequence[cv.Measurement]) -> None:
    plain, index = walked(sample, walk, 5.0)
    moved, _ = walked(sample, walk, 5.0)
    last = moved._frame.last_pose
    assert last is not None
    moved.reanchor(GIVEN, np.diag(SIGMAS**2))
    expected, _ = goes_on(plain, walk[index:])
    states, events = goes_on(moved, walk[index:])
    assert [event.kind for event in events] == ["reanchored"]
    for one, other in zip(states[:200], expected[:200], strict=True):
        relative = se3.inverse(last[0]) @ other.nav.T_world_body
        tilted = last[0].copy()
        turn = so3.about_z(float(so3.yaw(GIVEN[:3, :3]) - so3.yaw(last[0][:3, :3])))
        tilted[:3, :3], tilted[:3, 3] = turn @ last[0][:3, :3], GIVEN[:3, 3]
        np.testing.assert_allclose(one.nav.T_world_body, tilted @ relative, atol=1e-9)
        np.testing.assert_allclose(one.nav.velocity_world, turn @ other.nav.velocity_world, atol=1e-9)
        assert np.linalg.eigvalsh(one.covariance)[0] > -1e-15
    np.testing.assert_allclose(np.sqrt(np.diag(states[0].covariance)[3:6]), SIGMAS[3:], rtol=0.05)


def test_the_window_is_shown_in_the_world_that_was_chosen() -> None:
    nav = NavState(np.eye(4), *(np.zeros(3) for _ in range(4)))
    state = StateEstimate(1, nav, np.eye(9))
    snapshot = WindowSnapshot(1, np.eye(4)[None], np.array([[1.0, 0.0, 0.5]]))
    frame = OutputFrame(is_levelled=True)
    frame.moved(Estimate("coclo", state))
    assert frame.moved(snapshot) is snapshot
    frame.anchor_now((GIVEN, np.zeros((6, 6))))
    estimate, window = frame.moved(Estimate("coclo", state)), frame.moved(snapshot)
    assert isinstance(estimate, Estimate)
    assert isinstance(window, WindowSnapshot)
    T_world_body = estimate.state.nav.T_world_body
    np.testing.assert_allclose(T_world_body[:3, 3], GIVEN[:3, 3], atol=1e-9)
    np.testing.assert_allclose(window.T_world_keyframes, T_world_body[None], atol=1e-9)
    np.testing.assert_allclose(
        window.landmarks_world[0], T_world_body[:3, :3] @ [1.0, 0.0, 0.5] + T_world_body[:3, 3], atol=1e-9
    )


@pytest.mark.long
def test_an_anchor_without_uncertainty_makes_positions_certain_again(
    sample: cv.Recording, walk: Sequence[cv.Measurement]
) -> None:
    plain, index = walked(sample, walk, 6.0)
    moved, _ = walked(sample, walk, 6.0)
    moved.reanchor(GIVEN)
    expected, _ = goes_on(plain, walk[index:])
    states, _ = goes_on(moved, walk[index:])
    first, last = (np.sqrt(states[at].covariance[3:6, 3:6].trace()) for at in (0, -1))
    assert first < 0.25 * np.sqrt(expected[0].covariance[3:6, 3:6].trace())
    assert first < last < np.sqrt(expected[-1].covariance[3:6, 3:6].trace())


def test_reset_before_any_measurement_chooses_the_start(sample: cv.Recording, walk: Sequence[cv.Measurement]) -> None:
    odometry = cv.make_estimator("coclo", robot=sample.robot, calibration=sample.calibration)
    odometry.reset(GIVEN)
    states, _ = goes_on(odometry, walk[:300])
    np.testing.assert_allclose(states[0].nav.T_world_body[:3, 3], GIVEN[:3, 3], atol=1e-9)


@pytest.mark.parametrize(
    ("pose", "covariance", "message"),
    [
        (np.eye(3), None, "pose must be T_world_body"),
        (np.diag([1.0, 1.0, -1.0, 1.0]), None, "orthonormal"),
        (np.full((4, 4), np.nan), None, "finite"),
        (np.eye(4), np.eye(3), "covariance must be"),
        (np.eye(4), -np.eye(6), "covariance must be"),
    ],
)
def test_what_is_no_pose_is_refused(
    pose: np.ndarray, covariance: np.ndarray | None, message: str, sample: cv.Recording
) -> None:
    odometry = cv.make_estimator("coclo", robot=sample.robot)
    with pytest.raises(cv.ConfigError, match=message):
        odometry.reset(pose, covariance)
    with pytest.raises(cv.ConfigError, match=message):
        odometry.reanchor(pose, covariance)
