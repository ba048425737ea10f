# SPDX-License-Identifier: BSD-3-Clause
"""Figures are PNG files with something in them, and say what they need."""

import sys

import numpy as np
import pytest

from coclo_vio.errors import EvaluationError
from coclo_vio.evaluation.figures import plot_contacts, plot_keyframes, plot_position_error, write_figures

matplotlib_image = pytest.importorskip("matplotlib.image", reason="figures need the extra `viz`")


def coloured(path) -> int:
    """Pixels that are not grey: drawn lines of estimates."""
    assert path.read_bytes().startswith(b"\x89PNG")
    return int((np.ptp(matplotlib_image.imread(path)[..., :3], axis=2) > 0.2).sum())


def test_every_figure_shows_every_estimate(walk, tmp_path):
    truth = walk(np.arange(0.0, 25.0, 0.02))
    one = {"coclo": walk(np.arange(0.0, 25.0, 0.02), 1)}
    both = {**one, "vins": walk(np.arange(0.0, 25.0, 0.1), 2)}
    few, many = write_figures(one, truth, tmp_path / "one"), write_figures(both, truth, tmp_path / "two")
    assert [path.name for path in few] == ["path.png", "positions.png", "velocities.png", "position_error.png"]
    for path_one, path_two in zip(few, many, strict=True):
        assert coloured(path_two) > coloured(path_one) > 100


def test_figures_without_ground_truth(walk, tmp_path):
    written = write_figures({"coclo": walk(np.arange(0.0, 25.0, 0.1))}, None, tmp_path)
    assert [path.name for path in written] == ["path.png", "positions.png", "velocities.png"]


def test_contact_bands_show_stance(tmp_path):
    stamps_ns = np.arange(200) * 10_000_000
    standing = plot_contacts(stamps_ns, np.ones((200, 2)), ["FL", "FR"], tmp_path / "stand.png")
    flying = plot_contacts(stamps_ns, np.zeros((200, 2)), ["FL", "FR"], tmp_path / "fly.png")
    assert coloured(standing) > 10_000 > coloured(flying)
    with pytest.raises(EvaluationError, match=r"\(200, 3\)"):
        plot_contacts(stamps_ns, np.ones((200, 2)), ["FL", "FR", "RL"], tmp_path / "wrong.png")


def test_keyframes_of_every_smoother_are_shown(tmp_path):
    def columns(level: float) -> dict[str, np.ndarray]:
        stamps_ns = 1e18 + np.arange(50) * 2e8
        return {"stamp_ns": stamps_ns, "tracks": np.full(50, 100 * level), "reprojection_px": np.full(50, level)}

    one = plot_keyframes({"vins": columns(1.0)}, tmp_path / "one.png")
    two = plot_keyframes({"vins": columns(1.0), "stereo": columns(0.5)}, tmp_path / "two.png")
    assert coloured(two) > coloured(one) > 100
    with pytest.raises(EvaluationError, match="there is none; run a visual mode first"):
        plot_keyframes({"vins": {"stamp_ns": np.zeros(0)}}, tmp_path / "none.png")


def test_position_error_outside_the_ground_truth_is_an_error(line, tmp_path):
    late = line(1.0).restamped(line(1.0).stamps_ns + 10**12)
    with pytest.raises(EvaluationError, match="no pose between"):
        plot_position_error({"late": late}, line(1.0), tmp_path / "error.png")


def test_no_estimate_is_an_error(line, tmp_path):
    with pytest.raises(EvaluationError, match="at least one estimate"):
        write_figures({}, line(1.0), tmp_path)


def test_missing_matplotlib_says_how_to_install_it(line, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    with pytest.raises(EvaluationError, match=r"pip install 'coclo-vio\[viz\]'"):
        write_figures({"coclo": line(1.0)}, line(1.0), tmp_path)
