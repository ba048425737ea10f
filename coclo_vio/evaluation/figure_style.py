# SPDX-License-Identifier: BSD-3-Clause
"""What all figures share: an empty one, how an estimator is drawn, and the way to a PNG file.

The only importer of matplotlib (extra ``viz``), inside the functions and without a display. An estimator has one
colour in all figures; the colours can be told apart by colour-blind eyes (Okabe and Ito, "Color universal design",
2008).
"""

from collections.abc import Iterable, Mapping, Sequence
from math import ceil
from pathlib import Path
from typing import TYPE_CHECKING, Any

from coclo_vio.values.errors import EvaluationError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_DPI = 110
_ENTRY_WIDTH = 1.45
_BLUE, _ORANGE, _GREEN, _PURPLE = "#0072b2", "#e69f00", "#009e73", "#cc79a7"
_SKY, _VERMILLION, _BROWN = "#56b4e9", "#d55e00", "#8c5a2b"
_GREY, _DARK = "#8a8a8a", "#5a5a5a"

_STYLES: Mapping[str, Mapping[str, Any]] = {
    "coclo": {"color": _BLUE, "linewidth": 1.3, "zorder": 4},
    "vins": {"color": _ORANGE, "linewidth": 1.3, "zorder": 4},
    "combined_coclo": {"color": _GREEN, "linewidth": 1.4, "zorder": 6},
    "combined_vins": {"color": _PURPLE, "linewidth": 3.0, "zorder": 5},  # wider: the two are often one curve
    "coclo_paper": {"color": _SKY, "linewidth": 1.0, "linestyle": "--", "zorder": 3},
    "coclo_leg_scale": {"color": _BLUE, "linewidth": 1.0, "linestyle": "-.", "zorder": 3},
    "inekf": {"color": _VERMILLION, "linewidth": 1.0, "linestyle": "--", "zorder": 3},
    "stereo": {"color": _BROWN, "linewidth": 1.0, "linestyle": "--", "zorder": 3},
    "stereo_twist": {"color": _BROWN, "linewidth": 1.0, "linestyle": ":", "zorder": 3},
    "naive": {"color": _GREY, "linewidth": 1.0, "linestyle": "--", "zorder": 2},
    "naive_rolling": {"color": _DARK, "linewidth": 1.0, "linestyle": ":", "zorder": 2},
    "naive_weighted": {"color": _DARK, "linewidth": 1.0, "linestyle": "-.", "zorder": 2},
}
_OTHERS = (_VERMILLION, _SKY, _BROWN, _DARK)
_EVENT_COLOURS = (_VERMILLION, _BROWN, _DARK, _SKY)

COMBINED = ("combined_coclo", "combined_vins")
"""The answers of legs and eyes together."""
REFERENCE: Mapping[str, Any] = {"color": "#303030", "linewidth": 2.6, "label": "ground truth", "zorder": 1}
"""How ground truth is drawn: below all, wide and dark, so that it shows beside what lies on it."""


def style_of(name: str) -> dict[str, Any]:
    """How an estimator is drawn, in matplotlib's words, its legend included; the same for one name wherever it is."""
    style = _STYLES.get(name) or {"color": _OTHERS[sum(name.encode()) % len(_OTHERS)], "linewidth": 1.2, "zorder": 4}
    return {**style, "label": name}


NO_FIGURES = "no figures: matplotlib is not installed; pip install 'coclo-vio[viz]' brings it"
"""What to tell where nothing can be drawn."""


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
    for index, (kind, times_s) in enumerate(events.items()):
        colour = _EVENT_COLOURS[index % len(_EVENT_COLOURS)]
        for axis in axes:
            for number, time_s in enumerate(times_s):
                label = kind if axis is axes[0] and number == 0 else None
                axis.axvline(time_s, color=colour, linewidth=0.9, alpha=0.55, zorder=0, label=label)


def finish(figure: "Figure", axes: Sequence[Any], x_label: str, path: Path, *, labelled: Iterable[Any] = ()) -> Path:
    """Grid, legend beside the curves and the label of the last axis; then the PNG file.

    Args:
        figure: what to write.
        axes: all of it.
        x_label: below the last one, and below each of ``labelled``.
        path: PNG file to write.
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
        known = [str(REFERENCE["label"]), *_STYLES]
        labels = sorted(entries, key=lambda label: known.index(label) if label in known else len(known))
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
    figure.savefig(path, dpi=_DPI, format="png")
    return path


def _legend_columns(entries: int, width: float) -> int:
    """As few rows as fit into a figure of this width, inches, and those evenly filled."""
    rows = ceil(entries / max(2, int(width / _ENTRY_WIDTH)))
    return ceil(entries / rows)
