# SPDX-License-Identifier: BSD-3-Clause
"""The scale of pixel noise: it follows the residuals of windows, wrong matches hardly enter, limits hold."""

import numpy as np
import pytest

from coclo_vio.backend.window.config import PixelNoiseConfig
from coclo_vio.backend.window.pixel_noise import PixelNoise
from coclo_vio.values.arrays import Array

WINDOWS, POINTS, OBSERVATIONS = 40, 100, 6


def residuals(sigma_px: float, seed: int, wrong: float = 0.0) -> Array:
    """Residuals of points that were estimated from them: three of a point's rows go into the point."""
    random = np.random.default_rng(seed)
    rows = random.normal(scale=sigma_px, size=(POINTS, OBSERVATIONS * 3))
    basis = np.linalg.qr(random.normal(size=(OBSERVATIONS * 3, 3)))[0]
    left = (rows - rows @ basis @ basis.T).reshape(-1, 3)
    left[random.random(len(left)) < wrong] += 20.0
    return np.asarray(left)


def learnt(sigma_px: float, config: PixelNoiseConfig, wrong: float = 0.0) -> PixelNoise:
    noise = PixelNoise(config)
    for seed in range(WINDOWS):
        noise.learn(residuals(sigma_px, seed, wrong), POINTS)
    return noise


@pytest.mark.parametrize("sigma_px", [0.5, 1.5, 4.0])
def test_the_scale_follows_the_noise_of_the_recording(sigma_px: float) -> None:
    config = PixelNoiseConfig(least_scale=0.1, prior_windows=0.01)
    noise = learnt(sigma_px, config)
    assert noise.track_px == pytest.approx(sigma_px, rel=0.12)  # applied in steps of a tenth
    assert noise.disparity_px / config.disparity_px == pytest.approx(noise.scale)
    assert noise.huber == pytest.approx(config.huber)


def test_wrong_matches_hardly_enter() -> None:
    config = PixelNoiseConfig(least_scale=0.1, prior_windows=0.01)
    assert learnt(0.5, config, wrong=0.1).track_px == pytest.approx(0.5, rel=0.25)


def test_the_configured_sigmas_count_as_so_many_windows() -> None:
    noise = PixelNoise(PixelNoiseConfig(least_scale=0.1, prior_windows=1.0))
    noise.learn(residuals(0.25, 0), POINTS)
    assert noise.scale == pytest.approx(0.5, rel=0.1)  # the geometric mean of 1 and 0.25


def test_limits_of_wrong_matches_follow_the_residuals_where_the_sigmas_do_not() -> None:
    config = PixelNoiseConfig(least_scale=0.5, least_shown=0.2, prior_windows=0.01)
    noise = learnt(0.02, config)
    assert noise.track_px == 0.5
    assert noise.outlier * noise.track_px == pytest.approx(0.2 * config.outlier, rel=0.12)
    assert noise.huber * noise.track_px == pytest.approx(0.2 * config.huber, rel=0.12)


def test_nothing_is_learnt_where_that_is_switched_off_or_little_is_redundant() -> None:
    assert learnt(5.0, PixelNoiseConfig(is_learnt=False)).scale == 1.0
    noise = PixelNoise(PixelNoiseConfig())
    noise.learn(residuals(5.0, 0)[:30], 20)
    assert noise.scale == 1.0


@pytest.mark.parametrize(("tracks", "sigma_px"), [(150, 0.5), (80, 0.5), (20, 1.0), (5, 2.0), (0, 4.0)])
def test_few_tracks_weigh_less_than_their_residuals_show(tracks: int, sigma_px: float) -> None:
    config = PixelNoiseConfig(least_scale=0.5, least_shown=0.2, prior_windows=0.01, ample_tracks=80)
    noise = learnt(0.02, config)
    limit_px = noise.outlier * noise.track_px
    noise.count(tracks)
    assert noise.track_px == pytest.approx(sigma_px)
    assert noise.outlier * noise.track_px == pytest.approx(limit_px)  # limits follow the residuals alone


def test_many_tracks_weigh_again_what_they_did() -> None:
    noise = learnt(0.02, PixelNoiseConfig(prior_windows=0.01))
    before = noise.scale
    noise.count(10)
    noise.count(150)
    assert noise.scale == before


def test_few_tracks_whose_residuals_are_large_get_no_further_factor() -> None:
    noise = learnt(2.0, PixelNoiseConfig(prior_windows=0.01))
    before = noise.scale
    noise.count(20)
    assert noise.scale == before
