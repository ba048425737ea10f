# SPDX-License-Identifier: BSD-3-Clause
"""A rotation about the vertical or a shift of the world is not observable, and changes nothing in the filter.

A rotation changes the directions of the sigma points, so that "the same" means to the fourth order of the spread.
"""

from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import replace

import numpy as np
import pytest

from coclo_vio.filter.config import InitialConfig, PaperConfig, RobustConfig
from coclo_vio.filter.initialisation import initial_filter
from coclo_vio.filter.odometry import LegOdometryFilter
from coclo_vio.filter.paper_profile import PaperProfile
from coclo_vio.filter.robust_profile import RobustProfile
from coclo_vio.filter.square_root_filter import MAX_ROTATION_SIGMA_RAD, SquareRootFilter
from coclo_vio.filter.stance import Reading
from coclo_vio.filter.state import POSITION, ROTATION, VELOCITY, State
from coclo_vio.filter.unscented_transform import lower_factor
from coclo_vio.geometry import so3
from coclo_vio.robot.model import RobotModel
from coclo_vio.simulation.analytic import AnalyticTrial, AnalyticTrialConfig, generate
from coclo_vio.simulation.body_motion import BodyMotionConfig
from coclo_vio.values.measurements import Measurement

DT_S, GYROSCOPE_NOISE = 0.01, 2e-3
FIRST, STEPS = 110, 200
MOVING = InitialConfig(moving_tilt_rad=0.02, moving_velocity_mps=0.1)
Make = Callable[[], RobustProfile | PaperProfile]


@pytest.fixture(params=["robust", "paper"])
def make(request: pytest.FixtureRequest, daisy: RobotModel) -> Make:
    if request.param == "robust":
        return lambda: RobustProfile(daisy, RobustConfig(), Counter(), initial=MOVING)
    return lambda: PaperProfile(daisy, PaperConfig(), Counter(), initial=MOVING)


@pytest.fixture(scope="module")
def readings(readings_of: Callable[[Iterable[Measurement]], list[Reading]], noisy_walk: AnalyticTrial) -> list[Reading]:
    return readings_of(noisy_walk.measurements)[FIRST : FIRST + STEPS]


def started(profile: RobustProfile | PaperProfile, reading: Reading) -> SquareRootFilter:
    profile.start(reading)
    return initial_filter(
        profile.layout,
        MOVING,
        reading,
        None,
        moving_force=reading.specific_force,
        foot_prior=profile.foot_prior(reading),
        is_wide=profile.is_wide,
    )


def walk(
    make: Make, readings: list[Reading], change: Callable[[SquareRootFilter], None]
) -> list[tuple[State, np.ndarray]]:
    """Mean and covariance after each reading, from a start that ``change`` modifies."""
    profile = make()
    core = started(profile, readings[0])
    change(core)
    path = []
    for reading in readings[1:]:
        profile.step(core, reading, DT_S, GYROSCOPE_NOISE, is_gap=False)
        path.append((core.mean, core.factor @ core.factor.T))
    return path


def moved(yaw: float, shift: np.ndarray) -> Callable[[SquareRootFilter], None]:
    """Turn and shift the world of a filter: its mean, and its errors to first order."""

    def change(core: SquareRootFilter) -> None:
        mean, layout = core.mean, core.mean.layout
        turn = so3.about_z(yaw)
        vector = mean.vector.copy()
        vector[layout.world] = (vector[layout.world].reshape(-1, 3) @ turn.T).ravel()
        rotation_at = {layout.position_of(name).start: layout.rotation_of(name) for name in layout.poses}
        places = [POSITION, *(layout.position_of(name) for name in layout.poses)]
        places += [slice(first, first + 3) for first in range(layout.feet.start, layout.feet.stop, 3)]
        map_errors = np.eye(layout.dimension)
        for name in layout.poses:
            vector[layout.position_of(name)] = turn @ vector[layout.position_of(name)]
        for place in [VELOCITY, *layout.rotations, *places]:
            map_errors[place, place] = turn
        for place in places:
            vector[place] += shift
            map_errors[place, rotation_at.get(place.start, ROTATION)] = so3.hat(shift) @ turn
        core.mean = State(layout, turn @ mean.rotation, vector, turn @ mean.remembered)
        core.factor = lower_factor((map_errors @ core.factor).T)

    return change


def unchanged(core: SquareRootFilter) -> None:
    """Leave the start as it is."""


def difference_m(turn: np.ndarray, shift: np.ndarray, one: State, other: State) -> float:
    return float(np.abs(turn @ one.vector[POSITION] + shift - other.vector[POSITION]).max())


def test_a_turned_world_gives_the_turned_trajectory(make: Make, readings: list[Reading]) -> None:
    yaw = 2.2
    turn = so3.about_z(yaw)
    plain, turned = walk(make, readings, unchanged), walk(make, readings, moved(yaw, np.zeros(3)))
    assert np.linalg.norm(plain[-1][0].vector[POSITION]) > 0.1
    for (one, P), (other, P_turned) in zip(plain, turned, strict=True):
        np.testing.assert_allclose(turn @ one.rotation, other.rotation, rtol=0, atol=1e-7)
        assert difference_m(turn, np.zeros(3), one, other) < 1e-7
        np.testing.assert_allclose(one.feet @ turn.T, other.feet, rtol=0, atol=1e-7)
        np.testing.assert_allclose(
            turn @ P[POSITION, POSITION] @ turn.T, P_turned[POSITION, POSITION], rtol=0, atol=1e-7
        )


def test_a_shifted_world_gives_the_shifted_trajectory(make: Make, readings: list[Reading]) -> None:
    """Exact but for the rounding of larger numbers and the second order of the tilt error in the lever of the shift."""
    near, far = (np.array([1.0, -2.0, 0.5]) * metres for metres in (0.1, 10.0))
    plain = walk(make, readings, unchanged)
    for shift in (near, far):
        shifted = walk(make, readings, moved(-1.0, shift))
        for (one, _), (other, _) in zip(plain, shifted, strict=True):
            assert difference_m(so3.about_z(-1.0), shift, one, other) < 5e-4 * np.linalg.norm(shift)


@pytest.mark.parametrize("added", [0.05, 0.4])
def test_yaw_is_never_observed_however_uncertain_it_is(
    added: float, daisy: RobotModel, readings: list[Reading]
) -> None:
    """A large uncertainty of yaw at the start is there at the end and changes nothing else.

    The variance keeps the same share however large it is: an observation would reduce a larger one more. What is left
    is of third order: the mean's shift in ``mean_and_deviations`` turns the tilt a little against the yaw. Not so in
    the paper's profile, which measures the velocity in the world with the mean's own heading.
    """

    def make() -> RobustProfile:
        return RobustProfile(daisy, RobustConfig(), Counter(), initial=MOVING)

    def add_yaw_variance(core: SquareRootFilter) -> None:
        core.factor[2, 2] = np.hypot(core.factor[2, 2], added)

    plain, wide = walk(make, readings, unchanged), walk(make, readings, add_yaw_variance)
    for (one, P), (other, P_wide) in zip(plain, wide, strict=True):
        third_order = 4e-6 * added**2
        np.testing.assert_allclose(one.rotation, other.rotation, rtol=0, atol=third_order)
        np.testing.assert_allclose(one.vector, other.vector, rtol=0, atol=third_order)
        gained = P_wide - P
        assert gained[2, 2] == pytest.approx(added**2, rel=2e-8)
        gained[2, 2] = 0.0
        np.testing.assert_allclose(gained, 0.0, atol=third_order)


def test_yaw_becomes_more_uncertain_with_time(make: Make, readings: list[Reading]) -> None:
    variance = np.array([P[2, 2] for _, P in walk(make, readings, unchanged)])[::50]
    assert np.all(np.diff(variance) > 0.0)


@pytest.mark.long
def test_unbounded_yaw_uncertainty_does_not_break_the_filter(daisy: RobotModel) -> None:
    """After hours yaw may be anywhere: its sigma stops at a bound, and velocity stays as good as ever."""
    drifting = daisy.description.imu.model_copy(update={"gyroscope_bias_walk": 0.5})
    robot = RobotModel(daisy.description.model_copy(update={"imu": drifting}))
    body = BodyMotionConfig(rest_s=1.0, walk_s=6.0, stop_s=0.0)
    trial = generate(AnalyticTrialConfig(body=body), robot, seed=5)
    odometry = LegOdometryFilter(robot)
    shift_ns = 0
    for _ in range(4):
        for sample in trial.measurements:
            estimate = odometry.push(replace(sample, stamp_ns=sample.stamp_ns + shift_ns))
        shift_ns += trial.measurements[-1].stamp_ns + 10_000_000_000
    assert estimate is not None
    assert np.sqrt(estimate.covariance[2, 2]) <= 1.01 * MAX_ROTATION_SIGMA_RAD
    speed = np.linalg.norm(estimate.nav.velocity_world)
    assert speed == pytest.approx(np.linalg.norm(trial.truth.velocity_world[-1]), abs=0.05)
