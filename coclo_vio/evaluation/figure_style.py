# SPDX-License-Identifier: BSD-3-Clause
"""What all figures share: an empty one, how a trajectory is drawn, and the way to a PNG file.

The only importer of matplotlib (extra ``viz``), inside the functions and without a display. A trajectory has one
colour in all figures, that of its kind.
"""

from collections.abc import Iterable, Mapping, Sequence
from math import ceil
from pathlib import Path
from typing import TYPE_CHECKING, Any

from coclo_vio.evaluation.trajectory_roles import in_order
from coclo_vio.values.errors import EvaluationError
from coclo_vio.values.trajectory_kind import trajectory_kind
from coclo_vio.values.whole_files import replacing

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_DPI = 110
_ENTRY_WIDTH = 1.45
# Okabe and Ito, "Color universal design", 2008: distinguishable with any colour vision.
_EVENT_COLOURS = ("#d55e00", "#8c5a2b", "#5a5a5a", "#56b4e9")

STANCE_COLOUR = "#0072b2"
"""Of the bands of feet in stance."""
REFERENCE: Mapping[str, Any] = {"color": "#303030", "linewidth": 2.6, "label": "ground truth", "zorder": 1}
"""How ground truth is drawn: below all, wide and dark, so that it shows beside what lies on it."""


def style_of(name: str) -> dict[str, Any]:
    """How a trajectory is drawn, as keyword arguments of matplotlib's ``plot``, its legend included."""
    kind = trajectory_kind(name)
    return {
        "color": kind.colour,
        "linewidth": kind.line_width,
        "linestyle": kind.line_style,
        "zorder": kind.layer,
        "label": name,
    }


def event_colours(count: int) -> list[str]:
    """Colours of so many kinds of events, the same in all figures."""
    return [_EVENT_COLOURS[index % len(_EVENT_COLOURS)] for index in range(count)]


NO_FIGURES = "no figures: matplotlib is not installed; pip install 'coclo-vio[viz]' brings it"
"""Why a report has no figures, where matplotlib is missing."""


def can_draw() -> bool:
    """Whether matplotlib is there."""
    try:
        import matplotlib.figure  # noqa: F401, PLC0415 -- an extra, and slow
    except ImportError:
        return False
    return True


def empty_figure(width: float, height: float) -> "Figure":
    """A figure of this size, inches, without a display.

    Raises:
        EvaluationError: matplotlib is missing.
    """
    try:
        from matplotlib.backends.backend_agg import FigureCanvasAgg  # noqa: PLC0415 -- an extra, and slow
        from matplotlib.figure import Figure  # noqa: PLC0415
    except ImportError as error:
        raise EvaluationError(
            "figures need matplotlib, which is not installed; install it with `pip install 'coclo-vio[viz]'`, or go "
            "without figures"
        ) from error
    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def mark_events(axes: Sequence[Any], events: Mapping[str, Sequence[float]]) -> None:
    """A vertical line at each event, behind the curves, its kind in the legend of the first axis.

    Args:
        axes: of matplotlib, the time in seconds along x.
        events: times, s, by kind.
    """
    for colour, (kind, times_s) in zip(event_colours(len(events)), events.items(), strict=True):
        for axis in axes:
            for number, time_s in enumerate(times_s):
                label = kind if axis is axes[0] and number == 0 else None
                axis.axvline(time_s, color=colour, linewidth=0.9, alpha=0.55, zorder=0, label=label)


def finish(figure: "Figure", axes: Sequence[Any], x_label: str, *, labelled: Iterable[Any] = ()) -> "Figure":
    """Grid, legend beside the curves and the label of the last axis; returns the figure.

    Args:
        figure: with its curves.
        axes: all of it.
        x_label: below the last one, and below each of ``labelled``.
        labelled: further axes that stand at the bottom.
    """
    entries: dict[str, Any] = {}
    for axis in axes:
        axis.grid(visible=True, alpha=0.3)
        for handle, label in zip(*axis.get_legend_handles_labels(), strict=True):
            entries.setdefault(label, handle)
    for axis in (axes[-1], *labelled):
        axis.set_xlabel(x_label)
    if entries:
        truth = str(REFERENCE["label"])
        labels = [*({truth} & set(entries)), *in_order(label for label in entries if label != truth)]
        legend = figure.legend(
            [entries[label] for label in labels],
            labels,
            loc="outside upper center",
            ncols=_legend_columns(len(labels), figure.get_figwidth()),
            fontsize="small",
            frameon=False,
        )
        for line in legend.get_lines():
            line.set_linewidth(2.2)
    return figure


def save_png(figure: "Figure", path: Path) -> Path:
    """Write a figure as a PNG file; returns the path.

    Raises:
        OSError: the file cannot be written.
    """
    with replacing(path) as beside:
        figure.savefig(beside, dpi=_DPI, format="png")
    return path


def _legend_columns(entries: int, width: float) -> int:
    """As few rows as fit into a figure of this width, inches, and those evenly filled."""
    rows = ceil(entries / max(2, int(width / _ENTRY_WIDTH)))
    return ceil(entries / rows)
