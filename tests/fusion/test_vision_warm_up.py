# SPDX-License-Identifier: BSD-3-Clause
"""The frames of the warm-up reach all that a recording's frames reach: keyframes, solves, a window that is full."""

import pytest

import coclo_vio as cv
from coclo_vio.backend.window.smoother import SlidingWindowSmoother
from coclo_vio.fusion.frame_processor import VisionStages
from coclo_vio.fusion.vision_chain import VisionChain
from coclo_vio.fusion.vision_warm_up import warm_up
from coclo_vio.fusion.visual_odometry import stereo_stages
from coclo_vio.runs.run_config import resolve


@pytest.mark.parametrize("has_frames", [True, False])
def test_a_window_is_filled_and_nothing_is_lost(has_frames: bool) -> None:
    stereo, config = cv.open(cv.sample_path()).calibration.stereo, resolve("daisy")
    assert stereo is not None
    frontend, rig = stereo_stages(stereo, config.frontend, has_frames=has_frames)
    stages = VisionStages(VisionChain(frontend, None), SlidingWindowSmoother(rig, config.smoother))
    warm_up(stages, rig, stereo.left.width_px, stereo.left.height_px, has_frames=has_frames)
    counts = stages.counts
    assert counts["smoother_keyframes"] > config.smoother.keyframes, "the oldest has left the window"
    assert counts.get("smoother_vision_lost", 0) == counts.get("smoother_frames_without_vision", 0) == 0
