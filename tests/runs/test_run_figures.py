# SPDX-License-Identifier: BSD-3-Clause
"""The figures of a run by name, with ground truth and without."""

from pathlib import Path

import pytest

from coclo_vio.runs.evaluating import evaluate_run
from coclo_vio.runs.run_config import resolve
from coclo_vio.runs.run_figures import draw_figure
from coclo_vio.runs.running import run_modes
from coclo_vio.values.errors import EvaluationError

CONFIG = resolve()

pytest.importorskip("matplotlib")
pytestmark = pytest.mark.usefixtures("stand_ins")


def test_figures_follow_from_what_a_run_has(film: Path, tmp_path: Path) -> None:
    record = run_modes(film, ["resting"], CONFIG, tmp_path)
    evaluations, _ = evaluate_run(tmp_path, CONFIG.evaluation)
    figure = draw_figure("position_error", tmp_path, record, evaluations, CONFIG.evaluation)
    labels = {text.get_text() for legend in figure.legends for text in legend.get_texts()}
    assert labels == {"resting", "event: vision_lost"}
    for kind, has_truth in (("keyframes", True), ("keyframes", False), ("path", False)):
        drawn = draw_figure(kind, tmp_path, record, evaluations if has_truth else {}, CONFIG.evaluation)
        assert any(axis.get_lines() for axis in drawn.axes), kind
    for kind in ("overview", "position_error", "error_bands", "contacts"):
        with pytest.raises(
            EvaluationError, match=rf"no data for the figure '{kind}': overview, position_error and error_bands need"
        ):
            draw_figure(kind, tmp_path, record, {}, CONFIG.evaluation)
    with pytest.raises(EvaluationError, match=r"no figure 'pth'; the figures are: contacts, error_bands, .*velocities"):
        draw_figure("pth", tmp_path, record, evaluations, CONFIG.evaluation)


def test_a_run_without_any_estimate_has_nothing_to_draw(leg_log: Path, tmp_path: Path) -> None:
    config = resolve("daisy")
    record = run_modes(leg_log, ["failing_at_once"], config, tmp_path)
    with pytest.raises(EvaluationError, match="has no estimate to draw"):
        draw_figure("path", tmp_path, record, {}, config.evaluation)
