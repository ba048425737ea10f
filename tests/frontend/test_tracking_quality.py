# SPDX-License-Identifier: BSD-3-Clause
import numpy as np
import pytest

from coclo_vio.frontend.config import PatchConfig, QualityConfig
from coclo_vio.frontend.motion_check import MotionEstimate
from coclo_vio.frontend.patches import PatchAligner
from coclo_vio.frontend.rectification import RectifiedPair
from coclo_vio.frontend.tracking_quality import Brightness, assess
from coclo_vio.frontend.tracks import ActiveTracks
from coclo_vio.values.measurements import TrackingQuality

CONFIG = QualityConfig()
BRIGHT = Brightness(110.0, 105.0, "", "")
AGREED = MotionEstimate(np.eye(4), np.ones(0, dtype=bool), 100, 98)


def tracks(total: int, matched: int) -> ActiveTracks:
    templates = PatchAligner(PatchConfig()).templates(np.zeros((4, 4), np.float32), np.zeros((total, 2)), np.ones(6))
    made = ActiveTracks.new(0, np.tile([50.0, 60.0], (total, 1)), templates)
    made.right_px[:matched] = [40.0, 60.0]
    return made


def light_of(left: float, right: float, contrast: float = 0.0) -> Brightness:
    pattern = contrast * np.where(np.indices((40, 40)).sum(axis=0) % 2, 1.0, -1.0)
    images = [np.clip(level + pattern, 0, 255).astype(np.uint8) for level in (left, right)]
    return Brightness.of(RectifiedPair(*images), CONFIG)


@pytest.mark.parametrize(
    ("level", "reason"), [(1.0, "left image is dark"), (254.0, "overexposed"), (128.0, "featureless")]
)
def test_an_image_without_features_has_a_fault(level: float, reason: str) -> None:
    assert reason in light_of(level, 100.0).left_fault
    assert reason.replace("left", "right") in light_of(100.0, level).right_fault


def test_an_image_with_contrast_has_no_fault() -> None:
    brightness = light_of(20.0, 230.0, contrast=10.0)
    assert (brightness.left_fault, brightness.right_fault) == ("", "")
    assert str(brightness) == "mean brightness 20 and 230 of 255"


def test_enough_points_that_agree_are_healthy() -> None:
    assert assess(tracks(150, 120), 140, 150, AGREED, BRIGHT, CONFIG) == (TrackingQuality.HEALTHY, "")


@pytest.mark.parametrize(
    ("total", "matched", "tracked", "previous", "quality", "text"),
    [
        (150, 20, 140, 150, TrackingQuality.DEGRADED, "only 20 of 150 points were matched in both images"),
        (150, 120, 10, 150, TrackingQuality.DEGRADED, "only 10 of 150 points were tracked"),
        (10, 3, 0, 0, TrackingQuality.LOST, "only 3 of 10 points"),
        (150, 0, 0, 150, TrackingQuality.LOST, "only 0 of 150 points"),
        (150, 0, 120, 150, TrackingQuality.DEGRADED, "only 0 of 150 points"),
    ],
)
def test_too_few_points_are_reported_with_their_numbers(
    total: int, matched: int, tracked: int, previous: int, quality: TrackingQuality, text: str
) -> None:
    motion = MotionEstimate(np.eye(4), np.ones(0, dtype=bool), matched, matched)
    found, reason = assess(tracks(total, matched), tracked, previous, motion, BRIGHT, CONFIG)
    assert found is quality
    assert text in reason
    assert "mean brightness 110 and 105" in reason


def test_a_covered_right_camera_is_the_reason() -> None:
    _, reason = assess(tracks(150, 0), 120, 150, AGREED, light_of(100.0, 0.0, contrast=0.0), CONFIG)
    assert "the right image is dark" in reason


def test_tracks_that_no_motion_explains_are_degraded() -> None:
    motion = MotionEstimate(None, np.ones(0, dtype=bool), 100, 20)
    quality, reason = assess(tracks(150, 120), 120, 150, motion, BRIGHT, CONFIG)
    assert quality is TrackingQuality.DEGRADED
    assert "20 inliers of 100" in reason


def test_the_first_frame_has_no_tracks_to_continue() -> None:
    nothing = MotionEstimate(None, np.ones(0, dtype=bool), 0, 0)
    assert assess(tracks(150, 120), 0, 0, nothing, BRIGHT, CONFIG) == (TrackingQuality.HEALTHY, "")
