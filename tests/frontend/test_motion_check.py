# SPDX-License-Identifier: BSD-3-Clause
from dataclasses import replace

import numpy as np
import pytest
from textured_room import rig

from coclo_vio.frontend.config import MotionCheckConfig, PatchConfig
from coclo_vio.frontend.motion_check import MotionCheck, MotionEstimate
from coclo_vio.frontend.patches import PatchAligner
from coclo_vio.frontend.prediction import PointPredictor
from coclo_vio.frontend.rectification import Rectifier
from coclo_vio.frontend.tracks import ActiveTracks
from coclo_vio.geometry import se3

RIG = Rectifier(rig()).rig
MOTION = se3.exp(np.array([0.01, -0.02, 0.015, 0.03, -0.01, 0.08]))  # T_previous_current
CHECK = MotionCheck(RIG, MotionCheckConfig())
NO_TEMPLATES = PatchAligner(PatchConfig()).templates(np.zeros((4, 4), np.float32), np.zeros((0, 2)), np.ones(6))


def checked(before: ActiveTracks, now: np.ndarray, *, is_aligned: bool = False) -> MotionEstimate:
    """The motion of tracks to their left pixels now."""
    predictor = PointPredictor(RIG, before)
    return CHECK.check(predictor.points, predictor.is_known, now, is_aligned=is_aligned)


def scene(count: int = 120, seed: int = 5, noise_px: float = 0.1) -> tuple[ActiveTracks, np.ndarray]:
    """Tracks before the motion, and their left pixels after it, (N, 2)."""
    rng = np.random.default_rng(seed)
    points = np.column_stack((rng.uniform(-1, 1, count), rng.uniform(-0.6, 0.6, count), rng.uniform(1.0, 4.0, count)))
    left_px, disparity = RIG.pixels(points)
    right_px = left_px - np.column_stack((disparity + noise_px * rng.standard_normal(count), np.zeros(count)))
    moved, _ = RIG.pixels(se3.apply(se3.inverse(MOTION), points))
    ids = np.arange(count, dtype=np.int64)
    nothing = np.zeros((count, 2))
    tracks = ActiveTracks(ids, left_px, right_px, ids + 1, nothing, NO_TEMPLATES, np.zeros((count, 2, 2)), nothing)
    return tracks, moved + noise_px * rng.standard_normal((count, 2))


def test_outliers_are_found_and_the_motion_is_that_of_the_inliers() -> None:
    before, now = scene()
    wrong = np.arange(120) % 3 == 0
    now[wrong] += np.random.default_rng(1).choice([-1.0, 1.0], (40, 2)) * [8.0, 12.0]
    motion = checked(before, now)
    np.testing.assert_array_equal(motion.is_inlier, ~wrong)
    assert (motion.checked, motion.inliers) == (120, 80)
    assert motion.T_previous_current is not None
    assert np.linalg.norm(se3.log(se3.inverse(MOTION) @ motion.T_previous_current)) < 5e-3


def test_after_alignment_the_threshold_is_smaller() -> None:
    before, now = scene(noise_px=0.05)
    wrong = np.arange(120) % 5 == 0
    now[wrong, 0] += 1.5
    assert checked(before, now).is_inlier.mean() > 0.95
    np.testing.assert_array_equal(checked(before, now, is_aligned=True).is_inlier, ~wrong)


def test_if_most_tracks_contradict_each_other_none_is_rejected() -> None:
    before, now = scene()
    now += np.random.default_rng(2).uniform(-60.0, 60.0, now.shape) * (np.arange(120) % 4 != 0)[:, None]
    motion = checked(before, now)
    assert motion.T_previous_current is None
    assert motion.is_inlier.all()
    assert motion.checked == 120
    assert motion.inliers < 48


def test_points_of_unknown_depth_are_not_checked() -> None:
    before, now = scene()
    right_px = before.right_px.copy()
    right_px[::2] = np.nan
    now[::2] += 30.0
    left_only = replace(before, right_px=right_px)
    motion = checked(left_only, now)
    assert motion.is_inlier.all()
    assert motion.checked == 60


@pytest.mark.parametrize("count", [0, 3, 7])
def test_too_few_points_are_not_checked(count: int) -> None:
    before, now = scene()
    few = ActiveTracks(
        *(value[:count] for value in (before.ids, before.left_px, before.right_px, before.ages)),
        before.slants[:count],
        NO_TEMPLATES,
        before.warps[:count],
        before.bends[:count],
    )
    motion = checked(few, now[:count])
    assert motion.T_previous_current is None
    assert motion.is_inlier.shape == (count,)
    assert motion.checked == 0


def test_the_same_tracks_give_the_same_motion() -> None:
    before, now = scene(noise_px=0.5)
    first, second = (
        checked(before, now),
        checked(before, now),
    )
    assert first.T_previous_current is not None
    np.testing.assert_array_equal(first.T_previous_current, second.T_previous_current)


def test_coincident_points_have_no_motion() -> None:
    before, now = scene()
    index = np.zeros(120, dtype=np.int64)
    coincident = replace(before, left_px=before.left_px[index], right_px=before.right_px[index])
    assert checked(coincident, now).is_inlier.all()
