# SPDX-License-Identifier: BSD-3-Clause
"""Figures are PNG files with lines in them; errors name what is missing."""

import sys
from dataclasses import replace

import numpy as np
import pytest

from coclo_vio.evaluation.figure_style import save_png
from coclo_vio.evaluation.figures import plot_overview, plot_path, plot_position_error, plot_positions, plot_velocities
from coclo_vio.values.errors import EvaluationError

matplotlib_image = pytest.importorskip("matplotlib.image", reason="figures need the extra `viz`")


def coloured(path) -> int:
    """Pixels that are not grey: drawn lines of estimates."""
    assert path.read_bytes().startswith(b"\x89PNG")
    return int((np.ptp(matplotlib_image.imread(path)[..., :3], axis=2) > 0.2).sum())


def drawn(estimates, references, folder) -> list[int]:
    """Coloured pixels of every figure that needs trajectories only."""
    reference = next(iter(references.values()), None)
    figures = [plot(estimates, reference) for plot in (plot_path, plot_positions, plot_velocities)]
    if references:
        figures += [plot(estimates, references) for plot in (plot_overview, plot_position_error)]
    folder.mkdir()
    return [coloured(save_png(figure, folder / f"{index}.png")) for index, figure in enumerate(figures)]


@pytest.mark.long
def test_every_figure_shows_every_estimate(walk, tmp_path):
    truth = walk(np.arange(0.0, 25.0, 0.02))
    first = {"legs": walk(np.arange(0.0, 25.0, 0.02), 1)}
    both = {**first, "vision": walk(np.arange(0.0, 25.0, 0.1), 2)}
    few = drawn(first, dict.fromkeys(first, truth), tmp_path / "first")
    many = drawn(both, dict.fromkeys(both, truth), tmp_path / "both")
    assert len(few) == len(many) == 5
    assert all(pixels_both > pixels_first > 100 for pixels_first, pixels_both in zip(few, many, strict=True))


def test_figures_without_ground_truth(walk, tmp_path):
    pixels = drawn({"legs": walk(np.arange(0.0, 25.0, 0.1))}, {}, tmp_path / "figures")
    assert len(pixels) == 3
    assert min(pixels) > 100


def test_fused_trajectories_are_beside_standalone_ones(walk, tmp_path):
    truth = walk(np.arange(0.0, 25.0, 0.1))
    alone = {"legs": truth, "vision": truth}
    narrow = save_png(plot_positions(alone, truth), tmp_path / "alone.png")
    wide = save_png(plot_positions({**alone, "fused_legs": truth}, truth), tmp_path / "both.png")
    assert matplotlib_image.imread(wide).shape[1] > 1.3 * matplotlib_image.imread(narrow).shape[1]


def test_of_a_long_recording_velocities_show_twenty_seconds_of_the_middle(line, tmp_path):
    """Changes at its ends do not change the figure."""
    steady_truth = line(6.0, seconds=60.0)
    jumpy = replace(steady_truth, velocity_world=np.where(steady_truth.times_s[:, None] < 15.0, 3.0, 0.1) * np.ones(3))
    steady = replace(steady_truth, velocity_world=np.full((len(steady_truth), 3), 0.1))
    pictures = [
        save_png(plot_velocities({"legs": estimate}, steady_truth), tmp_path / f"{index}.png").read_bytes()
        for index, estimate in enumerate((jumpy, steady))
    ]
    assert pictures[0] == pictures[1]


def test_time_is_counted_from_the_given_start(line, tmp_path):
    truth = line(1.0, seconds=2.0)
    pictures = [
        save_png(plot_positions({"legs": truth}, truth, start_ns=start_ns), tmp_path / f"{name}.png").read_bytes()
        for name, start_ns in (("default", None), ("first", int(truth.stamps_ns[0])), ("earlier", -5_000_000_000))
    ]
    assert pictures[0] == pictures[1] != pictures[2]


def test_events_are_marked_in_the_errors(walk, tmp_path):
    truth = walk(np.arange(0.0, 25.0, 0.1))
    estimates, references = {"legs": walk(np.arange(0.0, 25.0, 0.1), 1)}, {"legs": truth}
    quiet = save_png(plot_position_error(estimates, references), tmp_path / "quiet.png")
    eventful = save_png(
        plot_position_error(estimates, references, events={"vins: vision_lost": [5_000_000_000, 9_000_000_000]}),
        tmp_path / "eventful.png",
    )
    assert coloured(eventful) > coloured(quiet) + 300


def test_a_baseline_that_is_far_off_does_not_flatten_the_others(line, tmp_path):
    truth = line(5.0)
    near = {"legs": line(5.0, scale=1.01)}
    far = {**near, "naive": line(5.0, scale=3.0)}
    alone = save_png(plot_position_error(near, dict.fromkeys(near, truth)), tmp_path / "near.png")
    beside = save_png(plot_position_error(far, dict.fromkeys(far, truth)), tmp_path / "far.png")
    assert coloured(beside) > 0.3 * coloured(alone)


def test_position_error_outside_the_ground_truth_is_an_error(line, tmp_path):
    late = line(1.0).restamped(line(1.0).stamps_ns + 10**12)
    with pytest.raises(EvaluationError, match="no pose between"):
        save_png(plot_position_error({"late": late}, {"late": line(1.0)}), tmp_path / "error.png")


@pytest.mark.parametrize("plot", [plot_path, plot_positions, plot_velocities])
def test_no_estimate_is_an_error(plot):
    with pytest.raises(EvaluationError, match="at least one estimate"):
        plot({}, None)


def test_missing_matplotlib_is_an_error_with_the_command_that_installs_it(line, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    with pytest.raises(EvaluationError, match=r"pip install 'coclo-vio\[viz\]'"):
        plot_path({"legs": line(1.0)}, line(1.0))
