# SPDX-License-Identifier: BSD-3-Clause
import numpy as np
import pytest

from coclo_vio.frontend.config import PatchConfig, SightConfig
from coclo_vio.frontend.motion_check import MotionVerdict
from coclo_vio.frontend.patches import PatchAligner
from coclo_vio.frontend.rectification import RectifiedPair
from coclo_vio.frontend.sight import Light, judged
from coclo_vio.frontend.tracks import LiveTracks
from coclo_vio.values.measurements import TrackingQuality

CONFIG = SightConfig()
BRIGHT = Light(110.0, 105.0, "", "")
AGREED = MotionVerdict(np.eye(4), np.ones(0, dtype=bool), 100, 98)


def tracks(total: int, matched: int) -> LiveTracks:
    templates = PatchAligner(PatchConfig()).templates(np.zeros((4, 4), np.float32), np.zeros((total, 2)))
    made = LiveTracks.new(0, np.tile([50.0, 60.0], (total, 1)), templates)
    made.right_px[:matched] = [40.0, 60.0]
    return made


def light_of(left: float, right: float, contrast: float = 0.0) -> Light:
    pattern = contrast * np.where(np.indices((40, 40)).sum(axis=0) % 2, 1.0, -1.0)
    images = [np.clip(level + pattern, 0, 255).astype(np.uint8) for level in (left, right)]
    return Light.of(RectifiedPair(*images), CONFIG)


@pytest.mark.parametrize(
    ("level", "reason"), [(1.0, "left image is dark"), (254.0, "overexposed"), (128.0, "featureless")]
)
def test_an_even_image_says_why_nothing_is_seen(level: float, reason: str) -> None:
    assert reason in light_of(level, 100.0).left_fault
    assert reason.replace("left", "right") in light_of(100.0, level).right_fault


def test_an_image_with_contrast_has_no_fault() -> None:
    light = light_of(20.0, 230.0, contrast=10.0)
    assert (light.left_fault, light.right_fault) == ("", "")
    assert str(light) == "mean brightness 20 and 230 of 255"


def test_enough_points_that_agree_are_healthy() -> None:
    assert judged(tracks(150, 120), 140, 150, AGREED, BRIGHT, CONFIG) == (TrackingQuality.HEALTHY, "")


@pytest.mark.parametrize(
    ("total", "matched", "followed", "before", "state", "words"),
    [
        (150, 20, 140, 150, TrackingQuality.DEGRADED, "only 20 of 150 points were found in both images"),
        (150, 120, 10, 150, TrackingQuality.DEGRADED, "only 10 of 150 points were followed"),
        (10, 3, 0, 0, TrackingQuality.LOST, "only 3 of 10 points"),
        (150, 0, 0, 150, TrackingQuality.LOST, "only 0 of 150 points"),
        (150, 0, 120, 150, TrackingQuality.DEGRADED, "only 0 of 150 points"),
    ],
)
def test_few_points_are_told_with_their_numbers(
    total: int, matched: int, followed: int, before: int, state: TrackingQuality, words: str
) -> None:
    verdict = MotionVerdict(np.eye(4), np.ones(0, dtype=bool), matched, matched)
    found, reason = judged(tracks(total, matched), followed, before, verdict, BRIGHT, CONFIG)
    assert found is state
    assert words in reason
    assert "mean brightness 110 and 105" in reason


def test_a_covered_right_camera_is_the_reason() -> None:
    _, reason = judged(tracks(150, 0), 120, 150, AGREED, light_of(100.0, 0.0, contrast=0.0), CONFIG)
    assert "the right image is dark" in reason


def test_points_that_no_motion_explains_degrade() -> None:
    verdict = MotionVerdict(None, np.ones(0, dtype=bool), 100, 20)
    state, reason = judged(tracks(150, 120), 120, 150, verdict, BRIGHT, CONFIG)
    assert state is TrackingQuality.DEGRADED
    assert "20 of 100" in reason


def test_the_first_frame_has_nothing_to_follow() -> None:
    nothing = MotionVerdict(None, np.ones(0, dtype=bool), 0, 0)
    assert judged(tracks(150, 120), 0, 0, nothing, BRIGHT, CONFIG) == (TrackingQuality.HEALTHY, "")
