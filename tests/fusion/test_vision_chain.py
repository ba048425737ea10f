# SPDX-License-Identifier: BSD-3-Clause
"""Frames to tracks: expected motion of the camera, order of stamps, pictures, frames that nothing can process."""

import numpy as np
import pytest
from stand_ins import MS, T_BODY_CAMERA, NotingFrontend, frame, pose_at, tracks

from coclo_vio.fusion.vision_chain import TrackedFrame, VisionChain


def test_the_front_end_gets_the_expected_motion_of_the_left_camera() -> None:
    frontend = NotingFrontend()
    chain = VisionChain(frontend)
    chain.track(frame(0), None, pose_at(0))
    chain.track(frame(50 * MS), pose_at(0), None)
    assert frontend.expected == [None, None]
    for number in range(2, 5):
        chain.track(frame(50 * MS * number), pose_at(50 * MS * (number - 1)), pose_at(50 * MS * number))
    for number, expected in enumerate(frontend.expected[2:], start=2):
        assert expected is not None
        before, now = (pose_at(50 * MS * n) @ T_BODY_CAMERA for n in (number - 1, number))
        np.testing.assert_allclose(before @ expected, now, atol=1e-12)


def test_only_a_later_stamp_is_next() -> None:
    chain = VisionChain(NotingFrontend())
    assert chain.is_next(50 * MS)
    chain.track(frame(50 * MS), None, None)
    assert [chain.is_next(stamp_ns) for stamp_ns in (40 * MS, 50 * MS, 50 * MS + 1)] == [False, False, True]
    assert chain.counts == {"frames": 1, "frame_stamp_refused": 2, "frontend_detected": 3}


@pytest.mark.parametrize(
    ("every", "drawn"), [(1, [0, 50, 100, 150, 200, 250, 300]), (3, [0, 150, 300]), (10, [0]), (None, [])]
)
def test_pictures_are_of_every_nth_frame(every: int | None, drawn: list[int]) -> None:
    chain = VisionChain(NotingFrontend(), every)
    tracked = [chain.track(frame(50 * MS * number), None, None) for number in range(7)]
    pictures = [picture for one in tracked if one is not None for picture in one.pictures]
    assert [picture.stamp_ns // MS for picture in pictures] == drawn
    assert [int(picture.image[0, 0, 0]) for picture in pictures] == [1 + stamp_ms // 50 for stamp_ms in drawn]


def test_a_picture_is_frozen() -> None:
    tracked = VisionChain(NotingFrontend(), 1).track(frame(0), None, None)
    assert tracked is not None
    with pytest.raises(ValueError, match="read-only"):
        tracked.pictures[0].image[0] = 7


def test_tracks_have_no_picture_and_need_no_front_end() -> None:
    recorded = tracks(50 * MS)
    chain = VisionChain(None, 1)
    tracked = chain.track(recorded, pose_at(0), pose_at(50 * MS))
    assert isinstance(tracked, TrackedFrame)
    assert (tracked.tracks, tracked.pictures) == (recorded, ())
    assert not chain.is_next(50 * MS)


def test_a_frame_without_front_end_is_counted_and_does_not_count_as_tracked() -> None:
    chain = VisionChain(None)
    assert chain.track(frame(50 * MS), None, None) is None
    assert chain.is_next(20 * MS)
    assert chain.counts == {"frame_without_frontend": 1}
