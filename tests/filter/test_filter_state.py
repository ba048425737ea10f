# SPDX-License-Identifier: BSD-3-Clause
"""The state's manifold: errors and their inverse, the way to ordinary errors, and the noise of the process in them."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from state_layouts import layout_of, state_of

from coclo_vio.filter import process_model
from coclo_vio.filter.config import RobustConfig
from coclo_vio.filter.process_model import Interval
from coclo_vio.filter.stance import FootMotion
from coclo_vio.filter.state import LEG_SCALE, POSITION, RATE, ROTATION, VELOCITY, State, StateLayout
from coclo_vio.filter.state_blocks import ANCHOR, FRAME, KEYFRAME
from coclo_vio.filter.unscented_transform import SigmaSpread
from coclo_vio.geometry import se3, so3

LEGS = 3
STEP = 1e-6


def random_state(random: np.random.Generator, layout: StateLayout) -> State:
    mean = state_of(layout, random)
    mean.vector[POSITION] *= 30.0
    return mean


def one_of(stack: State, row: int = 0) -> State:
    return replace(stack, rotation=stack.rotation[row], vector=stack.vector[row])


def stack_of(state: State) -> State:
    return replace(state, rotation=state.rotation[None], vector=state.vector[None])


@given(
    seed=st.integers(0, 2**32 - 1),
    yaw=st.sampled_from([0.0, 1e-9, 1e-3, 1.0, 3.1, -3.1]),
    has_contacts=st.booleans(),
)
def test_errors_of_undoes_spread(seed: int, yaw: float, has_contacts: bool) -> None:
    random = np.random.default_rng(seed)
    layout = layout_of(LEGS, has_contacts=has_contacts)
    mean = random_state(random, layout)
    errors = random.normal(size=(5, layout.dimension))
    errors[:, ROTATION] *= 0.2
    errors[0] = 0.0
    errors[1, ROTATION] = (0.0, 0.0, yaw)
    np.testing.assert_allclose(mean.errors_of(mean.spread(errors)), errors, rtol=0, atol=1e-9)


def test_an_error_turns_and_shifts_everything_in_the_world() -> None:
    """The rotation error moves velocity, position and feet rigidly, and leaves rate and biases in the body alone."""
    random = np.random.default_rng(1)
    layout = layout_of(LEGS)
    mean = random_state(random, layout)
    errors = np.zeros((1, layout.dimension))
    errors[0, ROTATION] = (0.1, -0.2, 2.0)
    turned = one_of(mean.spread(errors))
    turn = so3.exp(errors[0, ROTATION])
    np.testing.assert_allclose(turned.rotation, turn @ mean.rotation, atol=1e-14)
    np.testing.assert_allclose(turned.vector[POSITION], turn @ mean.vector[POSITION], atol=1e-12)
    np.testing.assert_allclose(turned.vector[VELOCITY], turn @ mean.vector[VELOCITY], atol=1e-13)
    np.testing.assert_allclose(turned.feet, mean.feet @ turn.T, atol=1e-13)
    assert np.array_equal(turned.vector[RATE.start : VELOCITY.start], mean.vector[RATE.start : VELOCITY.start])


@given(seed=st.integers(0, 2**32 - 1))
def test_corrected_is_spread_and_moves_the_keyframe_likewise(seed: int) -> None:
    random = np.random.default_rng(seed)
    layout = layout_of(LEGS, has_contacts=True, has_frame=True)
    mean = random_state(random, layout)
    step = 0.3 * random.normal(size=layout.dimension)
    corrected = mean.corrected(step)
    here = slice(0, layout.active)
    np.testing.assert_allclose(mean.errors_of(stack_of(corrected))[0, here], step[here], atol=1e-9)
    assert layout.poses == (KEYFRAME, FRAME, ANCHOR)
    for name in layout.poses:
        turn, at = corrected.remembered_rotation(name) @ mean.remembered_rotation(name).T, layout.position_of(name)
        np.testing.assert_allclose(so3.log(turn), step[layout.rotation_of(name)], atol=1e-9)
        shift = turn.T @ corrected.vector[at] - mean.vector[at]
        np.testing.assert_allclose(shift, step[at], atol=1e-9)
    for at in layout.rotations:
        assert np.all(corrected.vector[at] == 0.0)


@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=25)
def test_mean_and_deviations_return_the_moments_of_the_spread(seed: int) -> None:
    random = np.random.default_rng(seed)
    layout = layout_of(LEGS)
    mean = random_state(random, layout)
    length = layout.dimension
    factor = 0.02 * (np.tril(random.normal(size=(length, length))) + 3.0 * np.eye(length))
    points = SigmaSpread(length, length, float(length))
    centre, deviations = mean.spread(points.points(factor)).mean_and_deviations(points)
    np.testing.assert_allclose(centre.rotation, mean.rotation, atol=1e-12)
    np.testing.assert_allclose(centre.vector, mean.vector, atol=1e-10)
    rows = points.rows(deviations)
    np.testing.assert_allclose(rows.T @ rows, factor @ factor.T, atol=1e-10)


def test_mean_of_lopsided_points_leaves_no_mean_error() -> None:
    """Points that a model has moved aside: the errors about the mean average to zero, to third order in the spread."""
    random = np.random.default_rng(9)
    layout = layout_of(LEGS)
    mean = random_state(random, layout)
    mean.vector[layout.world] /= 30.0
    length = layout.dimension
    points = SigmaSpread(length, 4, 4.0)
    left = []
    for size in (0.04, 0.02):
        moved = mean.spread(points.points(size * np.eye(length)))
        scale = moved.vector[:, LEG_SCALE] - mean.vector[LEG_SCALE]
        turn = so3.exp(scale**2 * np.array([3.0, -1.0, 2.0]))
        bent = replace(moved, rotation=moved.rotation @ turn)
        centre, deviations = bent.mean_and_deviations(points)
        turned = so3.log(mean.rotation.T @ centre.rotation)
        np.testing.assert_allclose(turned, size**2 * np.array([3.0, -1.0, 2.0]), atol=30.0 * size**4)
        left.append(np.abs(points.mean(deviations)[ROTATION]).max())
    assert left[0] < 0.04**3
    assert left[1] < left[0] / 7.0


def plain_error(mean: State, other: State) -> np.ndarray:
    """[rotation, position] of ``T = T_mean exp(.)`` and the velocity's difference in the world, (9,)."""
    poses = [se3.transform(state.rotation, state.vector[POSITION]) for state in (mean, other)]
    return np.concatenate((se3.log(se3.inverse(poses[0]) @ poses[1]), other.vector[VELOCITY] - mean.vector[VELOCITY]))


@pytest.mark.parametrize("seed", range(5))
def test_plain_jacobian_against_finite_differences(seed: int) -> None:
    layout = layout_of(LEGS, has_contacts=True)
    mean = random_state(np.random.default_rng(seed), layout)
    steps = STEP * np.eye(layout.dimension)
    plus, minus = mean.spread(steps), mean.spread(-steps)
    columns = [
        (plain_error(mean, one_of(plus, row)) - plain_error(mean, one_of(minus, row))) / (2.0 * STEP)
        for row in range(layout.dimension)
    ]
    np.testing.assert_allclose(mean.plain_jacobian(), np.array(columns).T, rtol=0, atol=3e-7)


def test_noise_rows_against_finite_differences() -> None:
    """Each row of the noise, taken as a physical disturbance of the body and the feet, is the error it causes.

    A row turns the body by its rotation part and carries the feet: those that hold roll about their contact, the
    others go with the body.
    """
    random, config = np.random.default_rng(4), RobustConfig(estimates_leg_scale=True)
    layout = layout_of(LEGS, config=config)
    mean = random_state(random, layout)
    radii_m = np.array([0.02, 0.03, 0.04])
    motion = FootMotion(
        np.array([True, False, False]),
        random.normal(size=(LEGS, 3)),
        np.zeros((LEGS, 3)),
        np.array([True, True, False]),
        np.zeros(LEGS),
        np.zeros(LEGS),
        np.array([[0.6, 0.0, 0.8], [0.0, 0.0, 1.0], [0.0, 0.0, 1.0]]),
        0.0,
    )
    mean.vector[layout.feet] = (mean.vector[POSITION] + motion.position_body @ mean.rotation.T).ravel()
    foot_noise = np.tril(random.normal(size=(LEGS, 3, 3)))
    interval = Interval(0.01, 0.0, config.acceleration_density, np.full(LEGS, config.foothold_creep))
    rows = process_model.noise_rows(
        mean,
        interval,
        motion,
        radii_m=radii_m,
        foot_noise=foot_noise,
        angular_acceleration=config.angular_acceleration_density,
    )
    density = config.angular_acceleration_density * np.sqrt(0.01**3 / 4.0)
    for axis in range(3):
        turn = STEP * density * mean.rotation[:, axis]  # the body turns about its own axis, in world axes
        moved = stack_of(mean)
        vector = moved.vector.copy()
        feet = mean.feet.copy()
        feet[0] += np.cross(turn, radii_m[0] * motion.normals[0])
        feet[1:] = mean.vector[POSITION] + (feet[1:] - mean.vector[POSITION]) @ so3.exp(turn).T
        vector[0, layout.feet] = feet.ravel()
        vector[0, RATE] += STEP * rows[axis, RATE]
        moved = replace(moved, rotation=(so3.exp(turn) @ mean.rotation)[None], vector=vector)
        np.testing.assert_allclose(mean.errors_of(moved)[0] / STEP, rows[axis], rtol=0, atol=1e-6)
    added = rows[3:].T @ rows[3:]
    feet_noise = added[layout.feet, layout.feet]
    position_noise = added[POSITION, POSITION]
    held, known, lost = (feet_noise[3 * leg : 3 * leg + 3, 3 * leg : 3 * leg + 3] for leg in range(LEGS))
    np.testing.assert_allclose(held, config.foothold_creep**2 * 0.01 * np.eye(3), atol=1e-15)
    own = mean.rotation @ foot_noise[1]
    np.testing.assert_allclose(known, position_noise + own @ own.T, atol=1e-12)
    np.testing.assert_allclose(lost, position_noise + 0.1**2 * np.eye(3), atol=1e-12)


def test_noise_of_the_body_is_that_of_accelerations_that_ramp_the_rate() -> None:
    """Rate and velocity run straight between samples: turn and travel are half a step of what they changed by."""
    layout = layout_of(1)
    mean = State(layout, np.eye(3), np.zeros(layout.dimension), np.tile(np.eye(3), (len(layout.poses), 1, 1)))
    held = np.array([True])
    motion = FootMotion(held, np.zeros((1, 3)), np.zeros((1, 3)), held, np.zeros(1), np.zeros(1), np.zeros((1, 3)), 0.0)
    config, dt_s = RobustConfig(), 0.02
    rows = process_model.noise_rows(
        mean,
        Interval(dt_s, 0.0, config.acceleration_density, np.full(1, config.foothold_creep)),
        motion,
        radii_m=np.zeros(1),
        foot_noise=np.zeros((1, 3, 3)),
        angular_acceleration=config.angular_acceleration_density,
    )
    Q = rows.T @ rows
    for first, second, density in (
        (POSITION, VELOCITY, config.acceleration_density),
        (ROTATION, RATE, config.angular_acceleration_density),
    ):
        np.testing.assert_allclose(Q[first, first], density**2 * dt_s**3 / 4.0 * np.eye(3), atol=1e-15)
        np.testing.assert_allclose(Q[first, second], density**2 * dt_s**2 / 2.0 * np.eye(3), atol=1e-15)
        np.testing.assert_allclose(Q[second, second], density**2 * dt_s * np.eye(3), atol=1e-15)
