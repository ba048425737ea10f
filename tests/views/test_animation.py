# SPDX-License-Identifier: BSD-3-Clause
"""The animation of a run: what is in the file, read back."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from coclo_vio.robot.description import load_robot
from coclo_vio.values.arrays import Array
from coclo_vio.values.errors import ConfigError
from coclo_vio.values.estimates import StateEstimate
from coclo_vio.values.measurements import JointSample
from coclo_vio.values.outputs import Estimate, Event, Picture
from coclo_vio.views import animation_canvas
from coclo_vio.views.animation_canvas import AnimationCanvas
from coclo_vio.views.opening import open_view
from coclo_vio.views.perspective import Perspective
from coclo_vio.views.view import Setting

Walk = tuple[list[JointSample], list[Estimate]]
WORLD_PX = 480  # columns of the world; images, speed and contacts are beside it


def frames_of(file: Path) -> tuple[list[Array], list[int]]:
    is_read, film = cv2.imreadanimation(str(file))
    assert is_read
    return [np.asarray(frame)[:, :, :3] for frame in film.frames], list(film.durations)


def played(walk: Walk, file: Path) -> tuple[list[Array], list[int]]:
    """The frames of a walk, and how long each is shown, ms."""
    joints, estimates = walk
    setting = Setting(load_robot("daisy"), None, lambda image: cv2.imencode(".jpg", image)[1].tobytes())
    view = open_view("animation", setting, file=file)
    for sample, estimate in zip(joints, estimates, strict=True):
        view.measurement(sample)
        view.take(estimate)
    view.take(Picture(estimates[-1].state.stamp_ns, np.full((120, 320, 3), (10, 200, 30), dtype=np.uint8)))
    view.close()
    return frames_of(file)


def test_there_are_ten_frames_a_second_of_the_recording_and_the_robot_is_in_each(walk: Walk, tmp_path: Path) -> None:
    frames, durations = played(walk, tmp_path / "walk.webp")
    assert len(frames) == len(durations) == 10
    assert set(durations) == {100}
    for frame in frames:
        assert frame.shape == (360, 800, 3)
        world = frame[:, :WORLD_PX].astype(int)
        is_blue = (world[:, :, 0] - world[:, :, 2] > 80).sum()  # feet in stance
        is_drawn = (world.min(axis=2) < 235).mean()
        assert is_blue > 50
        assert 0.02 < is_drawn < 0.6
    moved = np.abs(frames[-1][:, :WORLD_PX].astype(int) - frames[0][:, :WORLD_PX].astype(int))
    assert (moved.max(axis=2) > 40).sum() > 500, "legs, grid and path move"


def test_the_image_with_its_tracks_is_beside_it_and_an_event_below(walk: Walk, tmp_path: Path) -> None:
    joints, estimates = walk
    file = tmp_path / "walk.webp"
    encode = lambda image: cv2.imencode(".png", image)[1].tobytes()  # noqa: E731
    view = open_view("animation", Setting(load_robot("daisy"), None, encode), file=file)
    view.take(Picture(estimates[0].state.stamp_ns, np.full((120, 320, 3), (10, 200, 30), dtype=np.uint8)))
    for number, (sample, estimate) in enumerate(zip(joints, estimates, strict=True)):
        if number == 50:
            view.take(Event(estimate.state.stamp_ns, "vision_lost", "dark"))
        view.measurement(sample)
        view.take(estimate)
    view.close()
    frames, _ = frames_of(file)
    image = frames[3][10:110, WORLD_PX + 10 : -10].reshape(-1, 3).mean(axis=0)
    np.testing.assert_allclose(image, (10, 200, 30), atol=12)
    reds = [(frame[335:, :WORLD_PX, 2].astype(int) - frame[335:, :WORLD_PX, 1] > 60).sum() for frame in frames]
    assert reds[2] < 20
    assert reds[8] > 50


def test_a_long_run_has_a_bounded_number_of_frames_which_last_longer(
    walk: Walk, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(animation_canvas, "_MOST_FRAMES", 6)
    frames, durations = played(walk, tmp_path / "walk.webp")
    assert 4 <= len(frames) <= 6
    assert set(durations) == {200}


def test_joints_and_covariances_that_are_no_numbers_are_no_reason_to_stop(walk: Walk, tmp_path: Path) -> None:
    state = walk[1][0].state
    joints = JointSample(state.stamp_ns, *[np.full_like(walk[0][0].position, np.nan)] * 3)
    estimate = Estimate("coclo", StateEstimate(state.stamp_ns, state.nav, np.zeros((9, 9)), state.feet))
    frames, _ = played(([joints], [estimate]), tmp_path / "walk.webp")
    assert len(frames) == 1


def test_it_needs_a_file_and_has_no_server(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"no server.*\.webp"):
        open_view("animation", Setting())
    with pytest.raises(ConfigError, match="no server"):
        open_view("animation", Setting(), file=tmp_path / "a.webp", port=8000)
    with pytest.raises(ConfigError, match=r"ends in \.webp"):
        open_view("animation", Setting(), file=tmp_path / "a.gif")


def test_a_file_that_cannot_be_written_is_an_error_that_names_it(tmp_path: Path) -> None:
    canvas = AnimationCanvas(tmp_path / "gone" / "a.webp")
    canvas.links(0, np.eye(4), {})
    with pytest.raises(ConfigError, match="cannot be written"):
        canvas.close()


def test_a_point_in_the_middle_is_in_the_middle_and_up_is_up() -> None:
    view = Perspective((200, 100), np.array([0.0, -2.0, 0.5]), np.array([0.0, 0.0, 0.5]), (1.0, 1.0, 1.0))
    pixels, depth = view.project(np.array([[0.0, 0.0, 0.5], [0.1, 0.0, 0.6], [0.0, -3.0, 0.5]]))
    np.testing.assert_allclose(pixels[0], [100.0, 50.0], atol=1e-9)
    assert pixels[1][0] > 100.0, "x is to the right, seen along y"
    assert pixels[1][1] < 50.0
    assert depth[0] == pytest.approx(2.0)
    assert np.isnan(pixels[2]).all(), "behind the viewpoint"
