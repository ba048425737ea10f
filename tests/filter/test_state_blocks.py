# SPDX-License-Identifier: BSD-3-Clause
"""Declared blocks of the state: what is declared flat is flat, and one declaration adds a state."""

from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from state_layouts import layout_of, state_of

from coclo_vio.filter import measurement_model, process_model
from coclo_vio.filter.config import InitialConfig, RobustConfig
from coclo_vio.filter.initialisation import initial_filter
from coclo_vio.filter.odometry import LegOdometryFilter
from coclo_vio.filter.paper_profile import _predict
from coclo_vio.filter.robust_profile import RobustProfile
from coclo_vio.filter.square_root_filter import SquareRootFilter
from coclo_vio.filter.stance import FootMotion, Reading
from coclo_vio.filter.state import State, StateLayout
from coclo_vio.filter.state_blocks import KNOWN_SIGMA, Curvature, Retraction, StateBlock
from coclo_vio.geometry.compiled import IS_COMPILED
from coclo_vio.robot.model import RobotModel
from coclo_vio.simulation.analytic import AnalyticTrial
from coclo_vio.values.arrays import Array
from coclo_vio.values.errors import FilterError
from coclo_vio.values.measurements import Measurement

LEGS, DT_S = 4, 0.02
STRETCH = StateBlock("leg_stretch", 1, sigma=0.02, walk=0.003, is_reported=True)
Readings = Callable[[Iterable[Measurement]], list[Reading]]
Model = Callable[[State], State]


def random_motion(random: np.random.Generator) -> FootMotion:
    holds = np.array([True, False, True, False])
    places, turns, loads = random.normal(size=(LEGS, 3)), random.normal(size=(LEGS, 3)), random.uniform(size=LEGS)
    normals = random.normal(size=(LEGS, 3))
    return FootMotion(
        holds, places, turns, np.ones(LEGS, dtype=np.bool_), loads, random.normal(size=LEGS), normals, 0.04
    )


def robust_process(random: np.random.Generator) -> Model:
    motion, hips = random_motion(random), random.normal(size=(LEGS, 3))
    return lambda stack: process_model.predict(stack, DT_S, motion, np.full(LEGS, 0.02), hips)


def paper_process(random: np.random.Generator) -> Model:
    velocity = random.normal(size=(LEGS, 3))
    return lambda stack: _predict(stack, DT_S, velocity)


def measurements(random: np.random.Generator) -> Callable[[State], Array]:
    """All measurement models of the robust profile; those of the paper's are among them, or products of them."""
    legs, places, hips = np.arange(LEGS), random.normal(size=(LEGS, 3)), random.normal(size=(LEGS, 3))
    models = [
        partial(measurement_model.gyroscope, reading=random.normal(size=3)),
        measurement_model.specific_force_at_rest,
        measurement_model._rest,
        measurement_model._velocity_of(places, random.normal(size=(LEGS, 3)), random.normal(size=(LEGS, 3)), 0.04),
        measurement_model._position_of(legs, places, hips, random.normal(size=(LEGS, 3))),
    ]
    return lambda stack: np.concatenate([model(stack) for model in models], axis=1)


def second_difference(mean: State, step: Array, model: Callable[[State], State | Array]) -> float:
    """Of a model along an error vector (L,), about its value at the mean."""
    images = model(mean.spread(np.stack((np.zeros(len(step)), step, -step))))
    if isinstance(images, State):
        centre = replace(images, rotation=images.rotation[0], vector=images.vector[0])
        images = centre.errors_of(images)
    return float(np.abs(images[1] + images[2] - 2.0 * images[0]).max())


def curvature_along(mean: State, name: str, model: Callable[[State], State | Array], seed: int) -> float:
    """The second difference along a random error of a block and of all blocks after it."""
    layout = mean.layout
    step = np.zeros(layout.dimension)
    step[layout.at(name).start : layout.active] = 0.3 * np.random.default_rng(seed).normal(
        size=layout.active - layout.at(name).start
    )
    return second_difference(mean, step, model)


@pytest.mark.parametrize("is_paper", [False, True])
@pytest.mark.parametrize("seed", range(3))
def test_a_block_is_flat_where_it_is_declared_flat_and_curved_where_not(is_paper: bool, seed: int) -> None:
    random = np.random.default_rng(seed)
    layout = layout_of(LEGS, has_contacts=is_paper, has_frame=True)
    mean, observe = state_of(layout, random), measurements(random)
    process = paper_process(random) if is_paper else robust_process(random)
    for block in layout.blocks:
        if block.is_passive or (is_paper and block.name == "leg_scale"):  # which no model of the paper uses
            continue
        in_process, in_measurement = (curvature_along(mean, block.name, model, seed) for model in (process, observe))
        assert (in_process > 1e-6) == (block.curvature is not Curvature.FLAT), block.name
        assert (in_measurement > 1e-6) == (block.curvature is Curvature.PROCESS_AND_MEASUREMENT), block.name
        flat = (
            in_process if block.curvature is Curvature.FLAT else 0.0,
            in_measurement if in_measurement < 1e-6 else 0.0,
        )
        assert max(flat) < 1e-12, block.name


def test_no_model_touches_what_is_declared_passive() -> None:
    random = np.random.default_rng(8)
    layout = layout_of(LEGS, has_frame=True)
    mean, process, observe = state_of(layout, random), robust_process(random), measurements(random)
    step = np.zeros((2, layout.dimension))
    step[1, layout.active :] = random.normal(size=layout.dimension - layout.active)
    moved, images = process(mean.spread(step)), observe(mean.spread(step))
    assert layout.active < layout.dimension
    np.testing.assert_array_equal(images[0], images[1])
    np.testing.assert_array_equal(moved.vector[0, : layout.active], moved.vector[1, : layout.active])
    np.testing.assert_array_equal(moved.vector[1] - moved.vector[0], mean.spread(step).vector[1] - mean.vector)


def started(profile: RobustProfile, reading: Reading) -> SquareRootFilter:
    prior = profile.foot_prior(reading)
    profile.start(reading)
    return initial_filter(
        profile.layout, InitialConfig(), reading, None, moving_force=None, foot_prior=prior, is_wide=profile.is_wide
    )


@pytest.mark.parametrize(
    "is_compiled", [False, pytest.param(True, marks=pytest.mark.skipif(not IS_COMPILED, reason="no numba"))]
)
@pytest.mark.parametrize("has_frame", [False, True])
def test_one_declaration_adds_a_state_and_changes_no_other(
    is_compiled: bool, has_frame: bool, daisy: RobotModel, noisy_walk: AnalyticTrial, readings_of: Readings
) -> None:
    readings = readings_of(noisy_walk.measurements)[90:150]
    cores = []
    for extra in ((), (STRETCH,)):
        profile = RobustProfile(
            daisy, RobustConfig(), Counter(), has_frame=has_frame, extra_blocks=extra, is_compiled=is_compiled
        )
        core = started(profile, readings[0])
        for reading in readings[1:]:
            profile.step(core, reading, DT_S, 2e-3, is_gap=False)
        cores.append(core)
    plain, longer = cores
    at = longer.mean.layout.at("leg_stretch")
    others = np.delete(np.arange(longer.mean.layout.dimension), np.arange(at.start, at.stop))
    np.testing.assert_allclose(longer.mean.rotation, plain.mean.rotation, rtol=0, atol=1e-9)
    np.testing.assert_allclose(longer.mean.vector[others], plain.mean.vector, rtol=0, atol=1e-9)
    P, P_longer = (core.factor @ core.factor.T for core in cores)
    np.testing.assert_allclose(P_longer[np.ix_(others, others)], P, rtol=0, atol=1e-9)
    np.testing.assert_allclose(P_longer[at, others], 0.0, atol=1e-15)
    value, sigma = longer.report("leg_stretch")
    assert abs(value.item()) < 1e-12
    assert sigma == pytest.approx(np.sqrt(0.02**2 + 0.003**2 * DT_S * (len(readings) - 1)), rel=1e-12)


@pytest.mark.skipif(not IS_COMPILED, reason="no numba")
def test_a_declared_state_is_corrected_through_its_correlations(
    daisy: RobotModel, noisy_walk: AnalyticTrial, readings_of: Readings
) -> None:
    readings, ends = readings_of(noisy_walk.measurements)[90:130], []
    for is_compiled in (False, True):
        profile = RobustProfile(daisy, RobustConfig(), Counter(), extra_blocks=(STRETCH,), is_compiled=is_compiled)
        core = started(profile, readings[0])
        layout = core.mean.layout
        core.factor[layout.at("leg_stretch"), layout.at("rate")] = 0.01
        for reading in readings[1:]:
            profile.step(core, reading, DT_S, 2e-3, is_gap=False)
        ends.append(core)
    (value, sigma), (other, other_sigma) = (core.report("leg_stretch") for core in ends)
    assert abs(value) > 1e-5
    assert other == pytest.approx(value, abs=1e-12)
    assert other_sigma == pytest.approx(sigma, rel=1e-9)


def test_reports_are_those_declared(daisy: RobotModel, noisy_walk: AnalyticTrial) -> None:
    odometry = LegOdometryFilter(daisy, extra_blocks=(STRETCH,))
    assert odometry.reports() == {}
    for measurement in noisy_walk.measurements[:330]:
        odometry.push(measurement)
    reports = odometry.reports()
    assert set(reports) == {
        "leg_scale",
        "leg_compliance",
        "slip_turn",
        "slip",
        "load_slip",
        "gyroscope_scale",
        "leg_stretch",
    }
    assert reports["leg_stretch"][1] > 0.02
    assert reports["leg_scale"][1] < 2.0 * KNOWN_SIGMA


def test_what_follows_from_the_declaration() -> None:
    wind = StateBlock("wind", 3, sigma=(1.0, 2.0, 3.0), moving_sigma=4.0, walk=0.5, memory_s=2.0)
    layout = layout_of(2, has_frame=True, extra=(wind,))
    at = layout.at("wind")
    assert at == slice(layout.feet.stop, layout.feet.stop + 3)
    assert layout.active == at.stop
    np.testing.assert_array_equal(layout.sigmas(is_moving=False)[at], (1.0, 2.0, 3.0))
    np.testing.assert_array_equal(layout.sigmas(is_moving=True)[at], 4.0)
    assert set(range(at.start, at.stop)) <= set(layout.walking)
    np.testing.assert_allclose(layout.kept(2.0)[at], np.exp(-1.0))
    assert layout.kept(2.0)[layout.feet].min() == 1.0


def test_declarations_that_contradict_each_other_are_refused() -> None:
    blocks = layout_of(2).blocks
    with pytest.raises(FilterError, match="two blocks of one name"):
        StateLayout((*blocks, StateBlock("slip", 1)))
    with pytest.raises(FilterError, match="not together"):
        StateLayout((*blocks, StateBlock("gap", 1), StateBlock("rope", 3, Retraction.WORLD)))
    with pytest.raises(FilterError, match="no block 'lidar'"):
        layout_of(2).at("lidar")
