# SPDX-License-Identifier: BSD-3-Clause
"""Vision in a process of its own, by default: what becomes of that process, and of joints where it has no time."""

import os
from pathlib import Path

import numpy as np
import pytest
from live_processes import children_of
from played_source import messages_of, run_played

from coclo_vio.runs.run_folder import read_estimates
from coclo_vio.values.units import NS_PER_S


@pytest.mark.long
def test_joints_do_not_wait_for_a_process_that_has_not_loaded_yet_and_it_ends_with_the_run(
    short_recording: Path, tmp_path: Path
) -> None:
    before = children_of(os.getpid())
    messages = messages_of(short_recording)
    some = [m for m in messages if m.arrived_ns < messages[0].arrived_ns + 3 * NS_PER_S]
    record, counted = run_played(some, tmp_path / "both", "combined", settings=["bridge.vision=auto"])
    assert children_of(os.getpid()) == before
    assert "vision: beside" in (tmp_path / "both" / "config.yaml").read_text(encoding="utf-8")
    counts = record.estimators["combined_coclo"].counts
    images = counted.topics["/camera/infra1/image_rect_raw/compressed"].received
    names = ("frames", "frame_before_vision", "frame_before_start", "frame_left_out")
    assert counts["frame_before_vision"] > 0
    assert sum(counts.get(name, 0) for name in names) == images, "every frame is accounted for"
    run_played([m for m in some if "infra" not in m.topic], tmp_path / "legs")
    by_legs = read_estimates(tmp_path / "legs", "coclo").trajectory
    assert record.estimators["combined_coclo"].estimates >= len(by_legs) > 200
    both = read_estimates(tmp_path / "both", "combined_coclo").trajectory
    np.testing.assert_array_equal(both.stamps_ns, by_legs.stamps_ns)
