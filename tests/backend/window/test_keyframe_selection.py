# SPDX-License-Identifier: BSD-3-Clause
import numpy as np
import pytest

from coclo_vio.backend.window.config import KeyframeConfig
from coclo_vio.backend.window.keyframe_selection import (
    displacements_px,
    has_lost_overlap,
    is_keyframe,
    tracks_are_still,
)
from coclo_vio.values.measurements import StereoTracks

CONFIG = KeyframeConfig(parallax_px=10.0, least_kept_share=0.6, most_new_share=0.5, longest_s=1.0)
FOCAL_PX = 460.0
GRID = np.column_stack((np.arange(20) * 30.0, np.arange(20) % 5 * 90.0))


def tracks(ids: range, shift_px: float = 0.0, stamp_ns: int = 100_000_000) -> StereoTracks:
    left_px = GRID[[each % 20 for each in ids]] + [shift_px, 0.0]
    return StereoTracks(stamp_ns, np.array(ids), left_px, left_px - [10.0, 0.0])


BEFORE = tracks(range(20), stamp_ns=0)


def test_a_frame_that_hardly_moved_is_no_keyframe() -> None:
    assert not is_keyframe(CONFIG, BEFORE, tracks(range(20), 5.0), FOCAL_PX)


@pytest.mark.parametrize(("shift_px", "focal_px", "expected"), [(11, 460, True), (11, 920, False), (21, 920, True)])
def test_enough_parallax_makes_a_keyframe_for_any_lens(shift_px: float, focal_px: float, expected: bool) -> None:
    assert is_keyframe(CONFIG, BEFORE, tracks(range(20), shift_px), focal_px) == expected


@pytest.mark.parametrize(("kept", "expected"), [(12, False), (11, True)])
def test_too_few_of_the_old_tracks_make_a_keyframe(kept: int, expected: bool) -> None:
    assert is_keyframe(CONFIG, BEFORE, tracks(range(kept)), FOCAL_PX) == expected


@pytest.mark.parametrize(("new", "expected"), [(20, False), (21, True)])
def test_too_many_new_tracks_make_a_keyframe(new: int, expected: bool) -> None:
    now = StereoTracks(1, np.arange(20 + new), np.tile(GRID, (3, 1))[: 20 + new], np.tile(GRID, (3, 1))[: 20 + new])
    assert is_keyframe(CONFIG, BEFORE, now, FOCAL_PX) == expected
    assert has_lost_overlap(CONFIG, BEFORE, now) == expected


@pytest.mark.parametrize(("matched", "expected"), [(12, False), (4, True)])
def test_new_tracks_without_a_match_make_no_keyframe_unless_few_have_one(matched: int, expected: bool) -> None:
    def frame(stamp_ns: int, first_unmatched: int) -> StereoTracks:
        left_px = np.tile(GRID, (3, 1))[:50]
        right_px = left_px - [10.0, 0.0]
        right_px[matched:] = np.nan
        ids = np.concatenate((np.arange(matched), first_unmatched + np.arange(50 - matched)))
        return StereoTracks(stamp_ns, ids, left_px, right_px)

    assert has_lost_overlap(CONFIG, frame(0, 1000), frame(1, 2000)) == expected


def test_matched_tracks_that_are_lost_make_a_keyframe_however_many_others_stay() -> None:
    left_px = np.tile(GRID, (3, 1))[:60]
    right_px = left_px - [10.0, 0.0]
    right_px[20:] = np.nan
    before = StereoTracks(0, np.arange(60), left_px, right_px)
    now = StereoTracks(1, np.concatenate((np.arange(11), np.arange(20, 60))), left_px[:51], right_px[:51])
    assert has_lost_overlap(CONFIG, before, now)


@pytest.mark.parametrize(("stamp_ns", "expected"), [(999_999_999, False), (1_000_000_000, True)])
def test_after_the_longest_time_there_is_a_keyframe_in_any_case(stamp_ns: int, expected: bool) -> None:
    assert is_keyframe(CONFIG, BEFORE, tracks(range(20), stamp_ns=stamp_ns), FOCAL_PX) == expected


def test_tracks_are_compared_by_identity_whatever_their_order() -> None:
    order = np.random.default_rng(1).permutation(20)
    moved = GRID + np.column_stack((np.arange(20.0), np.zeros(20)))
    now = StereoTracks(1, np.arange(20)[order], moved[order], moved[order])
    np.testing.assert_allclose(np.sort(displacements_px(BEFORE, now)), np.arange(20.0))


def test_standstill_is_decided_by_the_median_so_that_a_moving_object_does_not_matter() -> None:
    moving = GRID + np.where(np.arange(20)[:, None] < 8, [40.0, 0.0], [0.3, 0.0])
    now = StereoTracks(1, np.arange(20), moving, moving)
    assert tracks_are_still(BEFORE, now, 1.0)
    assert not tracks_are_still(BEFORE, now, 0.2)


def test_with_too_few_common_tracks_there_is_no_standstill() -> None:
    assert tracks_are_still(BEFORE, tracks(range(15, 25)), 1.0)
    assert not tracks_are_still(BEFORE, tracks(range(16, 36)), 1.0)


def test_frames_without_tracks_can_be_compared() -> None:
    nothing = tracks(range(0))
    assert not tracks_are_still(BEFORE, nothing, 1.0)
    assert is_keyframe(CONFIG, BEFORE, nothing, FOCAL_PX)
    assert not is_keyframe(CONFIG, nothing, nothing, FOCAL_PX)
