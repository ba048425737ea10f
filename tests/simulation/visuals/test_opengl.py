# SPDX-License-Identifier: BSD-3-Clause
import pytest

from coclo_vio.simulation.visuals import opengl
from coclo_vio.values.errors import CocloError, ConfigError


def test_a_backend_named_by_the_environment_is_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(opengl, "works", lambda backend: True)
    for backend in opengl.BACKENDS:
        monkeypatch.setenv("MUJOCO_GL", backend)
        assert opengl.choose_backend() == backend


def test_the_first_that_works_is_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("MUJOCO_GL", raising=False)
    monkeypatch.setattr(opengl, "works", lambda backend: True)
    assert opengl.choose_backend() == "egl"
    monkeypatch.setattr(opengl, "works", lambda backend: backend == "osmesa")
    assert opengl.choose_backend() == "osmesa"


def test_without_a_backend_the_error_names_the_packages(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("MUJOCO_GL", raising=False)
    monkeypatch.setattr(opengl, "works", lambda backend: False)
    with pytest.raises(CocloError, match=r"libegl1 libgles2 libgl1-mesa-dri, or libosmesa6, .* --no-images"):
        opengl.choose_backend()
    monkeypatch.setenv("MUJOCO_GL", "osmesa")
    with pytest.raises(CocloError, match="MUJOCO_GL=osmesa is set"):
        opengl.choose_backend()


def test_a_backend_with_a_screen_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MUJOCO_GL", "glfw")
    with pytest.raises(ConfigError, match="set it to egl or osmesa"):
        opengl.choose_backend()


def test_a_backend_that_does_not_exist_does_not_work() -> None:
    assert not opengl.works("direct3d")
