# SPDX-License-Identifier: BSD-3-Clause
"""The compiled steps of the robust profile equal those in NumPy, which are the readable form."""

import os
import subprocess
import sys
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import replace

import numpy as np
import pytest
from state_layouts import layout_of, state_of

from coclo_vio.filter import stance, stance_kernel
from coclo_vio.filter.config import InitialConfig, RobustConfig
from coclo_vio.filter.ground_plane import GroundPlane
from coclo_vio.filter.initialisation import initial_filter
from coclo_vio.filter.load_transfer import LoadTransfer
from coclo_vio.filter.passive_states import PassiveStates
from coclo_vio.filter.robust_profile import RobustProfile
from coclo_vio.filter.square_root_filter import MAX_ROTATION_SIGMA_RAD, SquareRootFilter
from coclo_vio.filter.stance import Reading
from coclo_vio.filter.state_blocks import ANCHOR, FRAME, KEYFRAME
from coclo_vio.filter.state_kernels import bounded_factor, corrected, plain_covariance
from coclo_vio.geometry import so3, so3_kernels
from coclo_vio.geometry.compiled import IS_COMPILED
from coclo_vio.robot.leg_sensing import InertialStep
from coclo_vio.robot.model import RobotModel
from coclo_vio.simulation.analytic import AnalyticTrial
from coclo_vio.values.measurements import Measurement

pytestmark = pytest.mark.skipif(not IS_COMPILED, reason="numba is not there, or switched off")

FIRST, STEPS = 90, 90  # the robot stands, then walks
DT_S, GYROSCOPE_NOISE = 0.01, 2e-3
Readings = Callable[[Iterable[Measurement]], list[Reading]]


def slipping(reading: Reading, share: float = 1.0) -> Reading:
    """Stance feet, or the first of them, move as no foot in stance does."""
    velocity = np.array(reading.feet.velocity_body)
    standing = np.flatnonzero(reading.is_stance)
    velocity[standing[: max(1, round(share * len(standing)))]] += (4.0, -4.0, 0.0)
    return replace(reading, feet=replace(reading.feet, velocity_body=velocity))


def unknown(reading: Reading, leg: int) -> Reading:
    """A leg without joint readings."""
    feet = reading.feet
    arrays = {name: np.array(getattr(feet, name)) for name in feet.__slots__}
    for array in arrays.values():
        array[leg] = np.nan
    return replace(reading, feet=replace(feet, **arrays))


def on_slopes(ground: GroundPlane, *_: object) -> None:
    """Each foot on a slope of its own, where the ground is followed."""
    slopes = np.linspace(-0.4, 0.5, len(ground.normals))
    normals = np.column_stack((slopes, slopes[::-1], np.ones(len(slopes))))
    ground.normals = normals / np.linalg.norm(normals, axis=1)[:, None]


def lying(reading: Reading) -> Reading:
    """No foot in contact."""
    contact = replace(reading.contact, is_stance=np.zeros(len(reading.contact.is_stance), dtype=np.bool_))
    return replace(reading, contact=contact, is_stationary=False)


def disturbed(readings: list[Reading]) -> list[Reading]:
    """Readings in which everything happens that a step distinguishes."""
    changed = list(readings)
    for row in (3, 50):
        changed[row] = unknown(changed[row], 2)
    changed[10] = replace(changed[10], angular_velocity=None)
    changed[15:18] = [lying(reading) for reading in changed[15:18]]
    changed[25] = lying(replace(changed[25], angular_velocity=None))
    changed[40] = slipping(changed[40], 0.0)
    changed[55:70] = [slipping(reading) for reading in changed[55:70]]  # all legs, until the recovery
    return changed


def copy_of(core: SquareRootFilter) -> SquareRootFilter:
    copy = SquareRootFilter(core.mean, np.ones(len(core.factor)), is_wide=core.is_wide)
    copy.active_factor = core.active_factor.copy()
    copy.passive = PassiveStates(core.passive.cross.copy(), core.passive.own.copy())
    return copy


def assert_equal(core: SquareRootFilter, expected: SquareRootFilter) -> None:
    for name in ("rotation", "vector", "remembered"):
        np.testing.assert_allclose(getattr(core.mean, name), getattr(expected.mean, name), rtol=0, atol=1e-12)
    covariance, expected_covariance = core.factor @ core.factor.T, expected.factor @ expected.factor.T
    sigma = np.sqrt(np.diag(expected_covariance)) + 1e-12
    apart = (covariance - expected_covariance) / np.outer(sigma, sigma)
    np.testing.assert_allclose(apart, 0.0, rtol=0, atol=1e-9)
    assert np.array_equal(core.factor, np.tril(core.factor))


@pytest.mark.parametrize(
    ("is_wide", "has_frame", "takes_slip_for_known", "weighs_feet"),
    [
        (False, False, None, None),
        (True, False, None, None),
        (False, True, None, None),
        (True, True, None, None),
        (False, True, True, None),
        (False, False, None, True),
    ],
)
def test_every_step_equals_that_in_numpy(
    is_wide: bool,
    has_frame: bool,
    takes_slip_for_known: bool | None,
    weighs_feet: bool | None,
    daisy: RobotModel,
    noisy_walk: AnalyticTrial,
    readings_of: Readings,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(GroundPlane, "push", on_slopes)
    monkeypatch.setattr(LoadTransfer, "push", lambda *_: 0.05)
    readings = disturbed(readings_of(noisy_walk.measurements)[FIRST : FIRST + STEPS])
    config = RobustConfig(estimates_leg_scale=True, takes_slip_for_known=takes_slip_for_known, weighs_feet=weighs_feet)
    counts = Counter[str](), Counter[str]()
    direct = RobustProfile(daisy, config, counts[0], has_frame=has_frame, is_compiled=False)
    ours = RobustProfile(daisy, config, counts[1], has_frame=has_frame, is_compiled=True)
    prior = direct.foot_prior(readings[0])
    np.testing.assert_allclose(ours.foot_prior(readings[0]).noise_m, prior.noise_m, rtol=1e-14)
    core = initial_filter(
        direct.layout, InitialConfig(), readings[0], None, moving_force=None, foot_prior=prior, is_wide=is_wide
    )
    for profile in (direct, ours):
        profile.start(readings[0])
    for row, reading in enumerate(readings[1:], 1):
        copy, is_gap = copy_of(core), row == 30
        direct.creep_level = ours.creep_level = 0.4 if row > 45 else 1.0
        used = direct.step(core, reading, DT_S, GYROSCOPE_NOISE, is_gap=is_gap)
        assert np.array_equal(used, ours.step(copy, reading, DT_S, GYROSCOPE_NOISE, is_gap=is_gap))
        assert_equal(copy, core)
        if has_frame and row % 20 == 0:
            core.mark_frame(0.004)
            core.copy_pose(FRAME, ANCHOR)
            core.copy_pose(FRAME, KEYFRAME)
        if row == 35:
            copy, step = copy_of(core), InertialStep(0, np.array([0.1, -0.2, 0.3]), np.array([0.5, 0.2, 9.7]))
            for profile, each in ((direct, core), (ours, copy)):
                profile.coast(each, step, DT_S, GYROSCOPE_NOISE)
            assert_equal(copy, core)
    assert counts[0] == counts[1]
    if not weighs_feet:  # a foot that departs weighs less and stays within the gate
        assert counts[0]["leg_rejected"] > 0
        assert counts[0]["recovery"] > 0
    assert counts[0]["no_contact"] > 0


@pytest.mark.parametrize("has_frame", [False, True])
def test_correction_bound_and_covariance_equal_those_of_the_state(has_frame: bool) -> None:
    random = np.random.default_rng(3)
    for _ in range(20):
        mean = state_of(layout_of(4, has_frame=has_frame), random)
        layout, step = mean.layout, random.normal(size=len(mean.vector))
        rotation, vector, remembered = corrected(
            mean.rotation, mean.vector, mean.remembered, step, layout.world.stop, layout.active
        )
        expected = mean.corrected(step)
        np.testing.assert_allclose(rotation, expected.rotation, rtol=0, atol=1e-13)
        np.testing.assert_allclose(vector, expected.vector, rtol=0, atol=1e-12)
        np.testing.assert_allclose(remembered, expected.remembered, rtol=0, atol=1e-13)
        core = SquareRootFilter(mean, np.ones(len(step)), is_wide=False)
        core.factor = np.tril(0.3 * random.normal(size=core.factor.shape))
        rows = mean.plain_jacobian() @ core.factor
        np.testing.assert_allclose(
            plain_covariance(mean.rotation, mean.vector, core.factor), rows @ rows.T, rtol=0, atol=1e-12
        )
        factor, scales = bounded_factor(np.asfortranarray(core.active_factor.T), MAX_ROTATION_SIGMA_RAD)
        before = core.active_factor.copy()
        core._bound_rotation()
        np.testing.assert_allclose(factor, core.active_factor, rtol=0, atol=1e-14)
        np.testing.assert_allclose(scales[:, None] * before[:3], factor[:3], rtol=0, atol=1e-14)


def test_turns_of_feet_equal_those_in_numpy() -> None:
    random = np.random.default_rng(5)
    before, turn = so3.exp(random.normal(size=(6, 3))), so3.exp(0.1 * random.normal(size=(6, 3)))
    holds = np.array([True, False, True, True, False, True])
    turns = stance_kernel.turns_of(holds, turn @ before, before)
    np.testing.assert_allclose(turns, stance.turns_of(holds, turn @ before, before), rtol=0, atol=1e-15)
    assert not turns[~holds].any()


def test_changes_of_loads_equal_those_in_numpy() -> None:
    """Loads that appear, vanish, are negative, and too large to be true."""
    random = np.random.default_rng(6)
    followed = [(np.full(5, 0.2), np.zeros(5, dtype=np.bool_)) for _ in range(2)]
    for _ in range(200):
        load = random.normal(20.0, 200.0, 5)
        load[random.random(5) < 0.3] = np.nan
        changes = [
            form(load, 15.0, 20.0, *state)
            for form, state in zip((stance_kernel.load_change, stance.load_change), followed, strict=True)
        ]
        np.testing.assert_array_equal(changes[0], changes[1])
        for ours, theirs in zip(*followed, strict=True):
            np.testing.assert_array_equal(ours, theirs)
        assert (np.abs(changes[0]) <= 20.0).all()


def test_rotation_kernels_equal_those_of_stacks() -> None:
    random = np.random.default_rng(4)
    R, vector = np.empty((3, 3)), np.empty(3)
    for scale in (0.0, 1e-300, 1e-12, 1e-3, 1.0):
        rotvec = scale * random.uniform(-1.0, 1.0, 3)
        so3_kernels.set_exp(R, *rotvec)
        np.testing.assert_allclose(R, so3.exp(rotvec), rtol=0, atol=1e-15)
        so3_kernels.set_log(vector, R)
        np.testing.assert_allclose(vector, so3.log_below_pi(R), rtol=1e-14, atol=1e-300)


@pytest.mark.long
def test_without_numba_the_models_in_numpy_are_taken() -> None:
    program = (
        "from collections import Counter; from coclo_vio.filter.config import RobustConfig;"
        "from coclo_vio.filter.robust_profile import RobustProfile; from coclo_vio.robot.model import RobotModel;"
        "from coclo_vio.robot.description import load_robot; import sys;"
        "profile = RobustProfile(RobotModel(load_robot('daisy')), RobustConfig(), Counter());"
        "print(type(profile._models).__name__, 'numba' in sys.modules)"
    )
    for switch, expected in (("0", "DirectModels False"), ("1", "CompiledModels True")):
        environment = os.environ | {"COCLO_VIO_NUMBA": switch}
        done = subprocess.run(
            [sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=True
        )
        assert done.stdout.strip() == expected
