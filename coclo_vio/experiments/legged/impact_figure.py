# SPDX-License-Identifier: BSD-3-Clause
"""Contact-centric against IMU-centric by the strength of impacts: ``docs/images/legged_impacts.png``."""

from typing import TYPE_CHECKING

from coclo_vio.evaluation.figure_style import empty_figure, finish, style_of
from coclo_vio.experiments.legged.legged_record import LeggedRecord, LeggedRow
from coclo_vio.experiments.legged.legged_text import impact_pairs
from coclo_vio.runs.modes.registry import modes
from coclo_vio.values.errors import EvaluationError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_PANELS = (("drift_percent", "drift [%]"), ("rpe_1m_percent", "RPE over 1 m [%]"), ("anees_pose", "ANEES"))
_MARKERS = "os^D"


def impact_figure(record: LeggedRecord) -> "Figure":
    """Drift, RPE and ANEES of both estimators over the 99th percentile of the accelerometer, a marker a robot.

    Raises:
        EvaluationError: matplotlib is missing, or impacts were not varied.
    """
    modes()  # registers the colours
    pairs = impact_pairs(record)
    if not pairs:
        raise EvaluationError("the record has no trots of which impacts are varied; run the benchmark with --impacts")
    figure = empty_figure(8.0, 3.2)
    panels = list(figure.subplots(1, len(_PANELS)))
    robots = list(dict.fromkeys(ours.group.partition(" ")[0] for ours, _ in pairs))
    for panel, (key, title) in zip(panels, _PANELS, strict=True):
        panel.set_title(title, fontsize=9, loc="left")
        panel.set_yscale("log")
        panel.yaxis.set_major_formatter("{x:g}")
        panel.yaxis.set_minor_formatter("{x:g}")
        panel.tick_params(axis="y", which="both", labelsize="small")
        for number, robot in enumerate(robots):
            of_robot = [pair for pair in pairs if pair[0].group.startswith(f"{robot} ")]
            for name, rows in zip(("coclo", "inekf"), zip(*of_robot, strict=True), strict=True):
                points = [(_strength(row), getattr(row.figures, key)) for row in rows]
                shown = [(x, y) for x, y in points if y is not None]
                style = {**style_of(name), "label": f"{name}, {robot}", "linestyle": ""}
                panel.plot([x for x, _ in shown], [y for _, y in shown], marker=_MARKERS[number], markersize=5, **style)
    label = "accelerometer, 99 % [m/s$^2$]"
    return finish(figure, panels, label, labelled=panels[:-1])


def _strength(row: LeggedRow) -> float:
    return 0.0 if row.impacts is None else row.impacts.peak_mps2
