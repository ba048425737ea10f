# SPDX-License-Identifier: BSD-3-Clause
"""The front end in a room whose every depth and every motion is known."""

import cv2
import numpy as np
import pytest
from textured_room import BASELINE_M, FOCAL_PX, HEIGHT, PERIOD_NS, WIDTH, Room, rig

from coclo_vio.frontend.config import FrontendConfig
from coclo_vio.frontend.frontend import StereoFrontend
from coclo_vio.geometry import se3
from coclo_vio.values.errors import DatasetError
from coclo_vio.values.measurements import StereoFrame, StereoTracks, TrackingQuality

Walk = tuple[list[StereoFrame], np.ndarray]
CENTRE = np.array([239.5, 179.5])


def uniform(level: float, stamp_ns: int = 1) -> StereoFrame:
    image = np.full((HEIGHT, WIDTH), level, dtype=np.uint8)
    return StereoFrame(stamp_ns, image, image)


def noise(stamp_ns: int) -> StereoFrame:
    rng = np.random.default_rng(stamp_ns)
    left, right = (rng.integers(0, 256, (HEIGHT, WIDTH), dtype=np.uint8) for _ in range(2))
    return StereoFrame(stamp_ns, left, right)


def changed(frame: StereoFrame, gain: float, offset: float, sides: str = "both") -> StereoFrame:
    def exposed(image: np.ndarray) -> np.ndarray:
        return np.clip(np.rint(gain * image + offset), 0, 255).astype(np.uint8)

    return StereoFrame(frame.stamp_ns, exposed(frame.left) if sides == "both" else frame.left, exposed(frame.right))


def matched(tracks: StereoTracks) -> np.ndarray:
    return np.isfinite(tracks.right_px[:, 0])


def drift_px(room: Room, cameras: np.ndarray, results: list[StereoTracks]) -> np.ndarray:
    """Distance of each old track of the last frame from the surface point that it was detected on, px."""
    first: dict[int, np.ndarray] = {}
    for T_world_camera, tracks in zip(cameras, results, strict=True):
        depth = room.depth(T_world_camera, tracks.left_px)
        rays = np.column_stack(((tracks.left_px - CENTRE) / FOCAL_PX, np.ones(len(tracks))))
        points = se3.apply(T_world_camera, rays * depth[:, None])
        for number, point in zip(tracks.track_ids.tolist(), points, strict=True):
            first.setdefault(number, point)
    last = results[-1]
    old = last.ages > 5
    points = np.array([first[number] for number in last.track_ids[old].tolist()])
    moved = se3.apply(se3.inverse(cameras[-1]), points)
    return np.linalg.norm(moved[:, :2] / moved[:, 2:] * FOCAL_PX + CENTRE - last.left_px[old], axis=1)


@pytest.fixture(scope="module")
def results(walked: Walk) -> list[StereoTracks]:
    frontend = StereoFrontend(rig())
    return [frontend.track(frame) for frame in walked[0]]


def test_a_walk_is_tracked_without_drift(room: Room, walked: Walk, results: list[StereoTracks]) -> None:
    assert all(len(tracks) > 140 for tracks in results)
    assert all(tracks.quality is TrackingQuality.HEALTHY and tracks.reason == "" for tracks in results)
    assert (results[-1].ages == len(results)).mean() > 0.6
    drift = drift_px(room, walked[1], results)
    assert len(drift) > 100
    assert np.median(drift) < 0.05
    assert (drift < 0.5).mean() > 0.97


def test_disparities_agree_with_depth_in_every_frame(room: Room, walked: Walk, results: list[StereoTracks]) -> None:
    for T_world_camera, tracks in zip(walked[1], results, strict=True):
        both = matched(tracks)
        assert both.sum() > 125
        disparity = (tracks.left_px - tracks.right_px)[both, 0]
        error = disparity - FOCAL_PX * BASELINE_M / room.depth(T_world_camera, tracks.left_px[both])
        assert (np.abs(error) < 0.2).mean() > 0.95


def test_identities_persist_and_are_never_reused(results: list[StereoTracks]) -> None:
    gone: set[int] = set()
    before: dict[int, int] = {}
    for tracks in results:
        now = dict(zip(tracks.track_ids.tolist(), tracks.ages.tolist(), strict=True))
        assert not gone & set(now)
        assert all(now[number] == before[number] + 1 for number in set(now) & set(before))
        fresh = sorted(set(now) - set(before))
        assert all(now[number] == 1 for number in fresh)
        assert not fresh or not before or min(fresh) > max(before)
        gone |= set(before) - set(now)
        before = now
    assert gone


@pytest.mark.parametrize("threads", [1, 2])
def test_the_same_frames_make_the_same_tracks(walked: Walk, results: list[StereoTracks], threads: int) -> None:
    used = cv2.getNumThreads()
    cv2.setNumThreads(threads)
    try:
        frontend = StereoFrontend(rig())
        again = [frontend.track(frame) for frame in walked[0]]
    finally:
        cv2.setNumThreads(used)
    for first, second in zip(results, again, strict=True):
        np.testing.assert_array_equal(first.track_ids, second.track_ids)
        np.testing.assert_array_equal(first.left_px, second.left_px)
        np.testing.assert_array_equal(first.right_px, second.right_px)


def test_a_prediction_finds_points_after_a_jump(room: Room) -> None:
    """A turn of 0.25 rad moves the image by 77 px; the prediction is the true motion."""
    start = se3.transform(np.eye(3), np.array([0.0, 0.0, 0.4]))
    turned = start @ se3.exp(np.array([0.0, 0.0, 0.25, 0.02, 0.0, 0.0]))
    frames = [room.frame(0, start), room.frame(PERIOD_NS, turned)]
    T_body_camera = rig().T_body_left_camera
    motion = se3.inverse(start @ T_body_camera) @ turned @ T_body_camera
    config = FrontendConfig.parse({"flow": {"search_levels": 1, "levels": 1}}, "frontend")
    tracked = []
    for prediction in (None, motion):
        frontend = StereoFrontend(rig(), config)
        frontend.track(frames[0])
        tracked.append(int((frontend.track(frames[1], prediction).ages == 2).sum()))
    assert tracked[1] > 80
    assert tracked[1] > 2 * tracked[0]


def test_a_wrong_prediction_does_not_lose_the_points(walked: Walk) -> None:
    frontend = StereoFrontend(rig())
    frontend.track(walked[0][0])
    tracks = frontend.track(walked[0][1], se3.exp(np.array([0.0, 0.3, 0.0, 0.0, 0.0, 0.0])))
    assert (tracks.ages == 2).sum() > 110
    assert frontend.counts["flow_retries"] == 1


@pytest.mark.parametrize(("level", "cause"), [(0, "dark"), (255, "overexposed"), (127, "featureless")])
def test_an_image_without_features_is_lost_with_its_reason(walked: Walk, level: int, cause: str) -> None:
    frontend = StereoFrontend(rig())
    frontend.track(walked[0][0])
    tracks = frontend.track(uniform(level))
    assert tracks.quality is TrackingQuality.LOST
    assert len(tracks) == 0
    assert cause in tracks.reason


def test_the_first_image_may_be_black() -> None:
    assert StereoFrontend(rig()).track(uniform(0)).quality is TrackingQuality.LOST


def test_images_of_noise_are_lost(walked: Walk) -> None:
    frontend = StereoFrontend(rig())
    frontend.track(walked[0][0])
    for stamp_ns in (1, 2, 3):
        assert frontend.track(noise(stamp_ns)).quality is TrackingQuality.LOST


def test_points_are_found_again_after_a_blackout(walked: Walk) -> None:
    frontend = StereoFrontend(rig())
    for frame in walked[0][:3]:
        before = frontend.track(frame)
    for number in (3, 4):
        assert frontend.track(uniform(0, number * PERIOD_NS)).quality is TrackingQuality.LOST
    after = frontend.track(walked[0][5])
    assert after.quality is TrackingQuality.HEALTHY
    assert len(np.intersect1d(before.track_ids, after.track_ids)) > 90


def test_after_a_long_blackout_all_points_are_new(walked: Walk) -> None:
    frontend = StereoFrontend(rig())
    before = frontend.track(walked[0][0])
    for number in range(1, 9):
        frontend.track(uniform(0, number))
    after = frontend.track(walked[0][9])
    assert after.quality is TrackingQuality.HEALTHY
    assert after.track_ids.min() > before.track_ids.max()


def test_points_are_tracked_over_missing_frames(walked: Walk) -> None:
    frontend = StereoFrontend(rig())
    for frame in walked[0][:3]:
        before = frontend.track(frame)
    after = frontend.track(walked[0][7])
    assert len(np.intersect1d(before.track_ids, after.track_ids)) > 75


def test_repeated_images_are_lost_not_at_rest(walked: Walk) -> None:
    frontend = StereoFrontend(rig())
    frontend.track(walked[0][0])
    repeated = StereoFrame(PERIOD_NS, walked[0][0].left, walked[0][0].right)
    tracks = frontend.track(repeated)
    assert tracks.quality is TrackingQuality.LOST
    assert "the camera repeats them" in tracks.reason
    assert frontend.track(walked[0][1]).quality is TrackingQuality.HEALTHY


def test_at_rest_points_stay_where_they_are(room: Room) -> None:
    frontend, pose = StereoFrontend(rig()), se3.transform(np.eye(3), np.array([0.0, 0.0, 0.4]))
    results = [frontend.track(room.frame(number * PERIOD_NS, pose)) for number in range(4)]
    _, first, last = np.intersect1d(results[0].track_ids, results[-1].track_ids, return_indices=True)
    assert len(first) > 130
    assert np.abs(results[0].left_px[first] - results[-1].left_px[last]).mean() < 0.02


@pytest.mark.parametrize(("gain", "offset"), [(0.4, 0.0), (1.3, -30.0)])
def test_a_sudden_change_of_exposure_loses_few_points(walked: Walk, gain: float, offset: float) -> None:
    frontend = StereoFrontend(rig())
    frontend.track(walked[0][0])
    tracks = frontend.track(changed(walked[0][1], gain, offset))
    assert tracks.quality is TrackingQuality.HEALTHY
    assert (tracks.ages == 2).sum() > 100
    assert matched(tracks).sum() > 120


def test_a_covered_right_camera_leaves_the_left_tracks(walked: Walk) -> None:
    frontend = StereoFrontend(rig())
    frontend.track(walked[0][0])
    covered = changed(walked[0][1], 0.0, 0.0, sides="right")
    tracks = frontend.track(covered)
    assert tracks.quality is TrackingQuality.DEGRADED
    assert "the right image is dark" in tracks.reason
    assert (tracks.ages == 2).sum() > 110
    assert not matched(tracks).any()
    after = frontend.track(walked[0][2])
    assert after.quality is TrackingQuality.HEALTHY
    assert (after.ages == 3).sum() > 90


def test_images_of_another_size_than_calibrated_are_refused() -> None:
    small = np.zeros((HEIGHT // 2, WIDTH // 2), dtype=np.uint8)
    with pytest.raises(DatasetError, match="have 240 x 180 px"):
        StereoFrontend(rig()).track(StereoFrame(0, small, small))


def test_images_that_change_their_size_are_lost_until_they_have_it_again(walked: Walk) -> None:
    frontend = StereoFrontend(rig())
    frames = walked[0]
    before = [frontend.track(frame) for frame in frames[:3]][-1]
    half = StereoFrame(frames[3].stamp_ns, frames[3].left[::2, ::2], frames[3].right[::2, ::2])
    lost = frontend.track(half)
    assert lost.quality is TrackingQuality.LOST
    assert f"have {WIDTH // 2} x {HEIGHT // 2} px, the cameras were calibrated with {WIDTH} x {HEIGHT}" in lost.reason
    assert frontend.overlay().shape == (HEIGHT, 2 * WIDTH, 3)
    after = frontend.track(frames[4])
    assert after.quality is TrackingQuality.HEALTHY
    assert len(set(after.track_ids) & set(before.track_ids)) > 100


def test_interchanged_images_are_lost_until_they_are_right_again(walked: Walk) -> None:
    frontend = StereoFrontend(rig())
    frames = walked[0]
    for frame in frames[:3]:
        frontend.track(frame)
    lost = frontend.track(StereoFrame(frames[3].stamp_ns, frames[3].right, frames[3].left))
    assert lost.quality is TrackingQuality.LOST
    assert lost.reason.startswith("left and right images are interchanged: 1")
    assert len(lost) == 0
    after = frontend.track(frames[4])
    assert after.quality is TrackingQuality.HEALTHY
    assert (after.ages >= 4).sum() > 90
    alone = StereoFrontend(rig()).track(StereoFrame(frames[0].stamp_ns, frames[0].right, frames[0].left))
    assert alone.quality is TrackingQuality.LOST


def test_images_of_a_few_pixels_are_lost() -> None:
    tiny = rig().left.model_copy(update={"width_px": 24, "height_px": 20})
    frontend = StereoFrontend(rig().model_copy(update={"left": tiny, "right": tiny}))
    for stamp_ns in (1, 2):
        image = np.random.default_rng(stamp_ns).integers(0, 256, (20, 24), dtype=np.uint8)
        assert frontend.track(StereoFrame(stamp_ns, image, image)).quality is TrackingQuality.LOST


def test_the_overlay_shows_both_images_with_their_points(walked: Walk) -> None:
    frontend = StereoFrontend(rig())
    assert frontend.overlay().shape == (HEIGHT, 2 * WIDTH, 3)
    assert not frontend.overlay().any()
    tracks = frontend.track(walked[0][0])
    picture = frontend.overlay()
    assert picture.dtype == np.uint8
    coloured = np.ptp(picture.astype(int), axis=2) > 60
    for pixel, shift in ((tracks.left_px, 0), (tracks.right_px[matched(tracks)], WIDTH)):
        column, row = np.rint(pixel + np.array([shift, 0.0])).astype(int).T
        near = [coloured[y - 4 : y + 5, x - 4 : x + 5].any() for x, y in zip(column, row, strict=True)]
        assert np.mean(near) > 0.98
    frontend.track(uniform(0))
    assert not np.array_equal(frontend.overlay(), picture)


def test_frames_and_points_are_counted(walked: Walk) -> None:
    frontend = StereoFrontend(rig())
    frontend.track(walked[0][0])
    frontend.track(uniform(0))
    assert frontend.counts["frames"] == 2
    assert frontend.counts["lost_frames"] == 1
    assert frontend.counts["detected"] >= 140
