# SPDX-License-Identifier: BSD-3-Clause
"""Remembered poses and cameras that follow the active states by products equal such that take part in every step."""

from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import replace

import numpy as np
import pytest
from state_layouts import state_of

from coclo_vio.filter.config import FilterConfig, InitialConfig, RobustConfig
from coclo_vio.filter.evidence_gate import EvidenceGate, GateOutcome
from coclo_vio.filter.initialisation import initial_filter
from coclo_vio.filter.passive_states import PassiveStates
from coclo_vio.filter.remembered_poses import frame_pair
from coclo_vio.filter.robust_profile import RobustProfile
from coclo_vio.filter.square_root_filter import MAX_ROTATION_SIGMA_RAD, SquareRootFilter
from coclo_vio.filter.stance import Reading
from coclo_vio.filter.state import ROTATION, StateLayout
from coclo_vio.filter.state_blocks import ANCHOR, FRAME, KEYFRAME
from coclo_vio.filter.unscented_transform import lower_factor
from coclo_vio.geometry import se3
from coclo_vio.geometry.compiled import IS_COMPILED
from coclo_vio.robot.model import RobotModel
from coclo_vio.simulation.analytic import AnalyticTrial
from coclo_vio.values.keyframes import PoseEvidence
from coclo_vio.values.measurements import Measurement

DT_S, GYROSCOPE_NOISE = 0.01, 2e-3
FIRST, STEPS = 90, 240
Readings = Callable[[Iterable[Measurement]], list[Reading]]


def with_all_active(layout: StateLayout) -> StateLayout:
    """The same state, but remembered poses and cameras take part in every step."""
    return StateLayout(tuple(replace(block, is_passive=False) for block in layout.blocks))


def remember(core: SquareRootFilter, step: int) -> None:
    """The exchange of keyframes: a frame each tenth step, now and then a keyframe, the anchor once."""
    if step % 10 == 0:
        core.mark_frame(0.004, (1e-3, 1e-3) if step == 50 else (0.0, 0.0))
    if step == 20:
        core.copy_pose(FRAME, ANCHOR)
    if step % 40 == 20:
        core.copy_pose(FRAME, KEYFRAME)


def evidence_on(core: SquareRootFilter) -> PoseEvidence:
    """That the frame is some millimetres from where the filter has it."""
    pair = frame_pair(core, 0, 1)
    information = np.zeros((12, 12))
    information[6:, 6:] = np.diag([1e6] * 3 + [1e5] * 3)
    vector = information @ np.concatenate((np.zeros(6), [1e-3, -2e-3, 1e-3, 4e-3, -5e-3, 3e-3]))
    return PoseEvidence(0, 1, pair.T_world_start, pair.T_world_end, information, vector)


def assert_same(core: SquareRootFilter, oracle: SquareRootFilter) -> None:
    sigmas = np.sqrt(np.diag(oracle.factor @ oracle.factor.T)) + 1e-12
    for name in ("rotation", "vector", "remembered"):
        np.testing.assert_allclose(getattr(core.mean, name), getattr(oracle.mean, name), rtol=0, atol=1e-9)
    apart = (core.factor @ core.factor.T - oracle.factor @ oracle.factor.T) / np.outer(sigmas, sigmas)
    np.testing.assert_allclose(apart, 0.0, rtol=0, atol=1e-9)


@pytest.mark.long
@pytest.mark.parametrize(
    "is_compiled", [False, pytest.param(True, marks=pytest.mark.skipif(not IS_COMPILED, reason="no numba"))]
)
@pytest.mark.parametrize(("estimates_leg_scale", "takes_slip_for_known"), [(False, None), (True, None), (False, True)])
def test_passive_states_equal_such_that_take_part_in_every_step(
    estimates_leg_scale: bool,
    takes_slip_for_known: bool | None,
    is_compiled: bool,
    daisy: RobotModel,
    noisy_walk: AnalyticTrial,
    readings_of: Readings,
) -> None:
    """Over many steps with frames, keyframes, slip that is only considered, and evidence on the poses."""
    readings = readings_of(noisy_walk.measurements)[FIRST : FIRST + STEPS]
    config = RobustConfig(estimates_leg_scale=estimates_leg_scale, takes_slip_for_known=takes_slip_for_known)
    cores, gates = [], []
    profiles = [
        RobustProfile(daisy, config, Counter(), has_frame=True, is_compiled=compiled)
        for compiled in (is_compiled, False)
    ]
    layouts = [profiles[0].layout, with_all_active(profiles[1].layout)]
    assert layouts[0].active == layouts[0].dimension - 22
    assert layouts[1].active == layouts[1].dimension == layouts[0].dimension
    for profile, layout in zip(profiles, layouts, strict=True):
        prior = profile.foot_prior(readings[0])
        profile.start(readings[0])
        cores.append(
            initial_filter(
                layout, InitialConfig(), readings[0], None, moving_force=None, foot_prior=prior, is_wide=False
            )
        )
        gates.append(EvidenceGate(FilterConfig().feedback_gate))
    for step, reading in enumerate(readings[1:], 1):
        for profile, core in zip(profiles, cores, strict=True):
            profile.step(core, reading, DT_S, GYROSCOPE_NOISE, is_gap=step == 100)
            remember(core, step)
        if step % 40 == 35:
            evidence = evidence_on(cores[1])
            for core, gate in zip(cores, gates, strict=True):
                core.inflate_poses(1.0 + 1e-3)
                assert gate.correct(core, evidence).outcome is GateOutcome.ACCEPTED
        if step % 5 == 0:
            assert_same(*cores)
    moved = se3.log(se3.inverse(cores[0].mean.remembered_pose(KEYFRAME)) @ cores[0].mean.remembered_pose(FRAME))
    assert np.linalg.norm(moved[3:]) > 0.01
    assert cores[0].report("camera")[1][3] < 0.99 * InitialConfig().stereo_scale_sigma, "evidence reached the cameras"


def test_the_joint_factor_is_that_of_the_covariance_with_known_states_too() -> None:
    random = np.random.default_rng(2)
    factor = np.tril(random.normal(size=(9, 9)))
    factor[3] = 0.0  # known, though others have content in its column
    passive = PassiveStates.of_factor(factor, 6)
    joint = passive.joint_factor(factor[:6, :6])
    assert np.array_equal(joint, np.tril(joint))
    assert np.flatnonzero(joint.diagonal() == 0.0).tolist() == [3]
    np.testing.assert_allclose(joint @ joint.T, factor @ factor.T, rtol=0, atol=1e-12)
    transition = random.normal(size=(6, 6))
    expected = transition @ passive.cross
    passive.predict(factor[:6, :6], (transition @ factor[:6, :6]).T)
    np.testing.assert_allclose(passive.cross, expected, rtol=0, atol=1e-11)


def test_a_bounded_rotation_scales_its_correlations_with_passive_states(daisy: RobotModel) -> None:
    layout = RobustProfile(daisy, RobustConfig(), Counter(), has_frame=True).layout
    random, cores = np.random.default_rng(3), []
    rows = 0.2 * random.normal(size=(layout.dimension, layout.dimension))
    for each in (layout, with_all_active(layout)):
        core = SquareRootFilter(state_of(each, np.random.default_rng(1)), np.ones(each.dimension), is_wide=False)
        core.factor = lower_factor(rows)
        core._bound_rotation()
        cores.append(core)
    assert np.sqrt(cores[0].variance(ROTATION)).max() == pytest.approx(MAX_ROTATION_SIGMA_RAD)
    P, expected = (core.factor @ core.factor.T for core in cores)
    np.testing.assert_allclose(
        P[: layout.active, : layout.active], expected[: layout.active, : layout.active], atol=1e-12
    )
    for name in layout.poses:
        assert np.sqrt(cores[0].variance(layout.rotation_of(name))).max() <= MAX_ROTATION_SIGMA_RAD * (1.0 + 1e-12)
    full, place = rows.T @ rows, layout.position_of(FRAME)
    shares = full[ROTATION, place] / np.sqrt(full.diagonal()[ROTATION, None])
    np.testing.assert_allclose(P[ROTATION, place] / np.sqrt(P.diagonal()[ROTATION, None]), shares, atol=1e-12)


def test_a_factor_with_passive_states_is_changed_by_assignment(daisy: RobotModel) -> None:
    layout = RobustProfile(daisy, RobustConfig(), Counter(), has_frame=True).layout
    core = SquareRootFilter(state_of(layout, np.random.default_rng(1)), np.ones(layout.dimension), is_wide=False)
    with pytest.raises(ValueError, match="read-only"):
        core.factor[0] *= 2.0
