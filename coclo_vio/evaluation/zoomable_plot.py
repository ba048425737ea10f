# SPDX-License-Identifier: BSD-3-Clause
"""A zoomable plot as data: panels one below the other with curves, or bands of contact; and its form for plotly.js.

A plot is plain values until ``drawn`` makes the JSON object that plotly.js draws; columns are sent as 32-bit floats.
"""

import base64
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np

from coclo_vio.evaluation.figure_style import REFERENCE, STANCE_COLOUR, event_colours
from coclo_vio.values.arrays import Array
from coclo_vio.values.trajectory_kind import trajectory_kind

GROUND_TRUTH = "ground truth"
"""The group of curves of the reference."""
_DASHES = {"-": "solid", "--": "dash", ":": "dot", "-.": "dashdot"}
_GAP_PX, _GAP_WITH_LABELS_PX = 14, 56  # between panels, without and with an axis of their own
_MARGINS = {"l": 56, "r": 8, "t": 30, "b": 40}
_GRID, _BAND_OPACITY, _EVENT_OPACITY, _MOST_EVENT_LINES = "#e4e4e4", 0.2, 0.55, 200


@dataclass(frozen=True, slots=True, eq=False)
class Curve:
    """A line of one trajectory in one panel.

    Attributes:
        group: the trajectory, or ``GROUND_TRUTH``; what one tick box of the page shows and hides.
        row: of the panel, from above.
        x: (N,).
        y: (N,); NaN breaks the line.
        half_width: of a band about zero that goes with the line, (N,); None without.
    """

    group: str
    row: int
    x: Array
    y: Array
    half_width: Array | None = None


@dataclass(frozen=True, slots=True, eq=False)
class ContactBands:
    """Contact probability over time, a band a leg.

    Attributes:
        times_s: (N,).
        probability: 0..1, (N, legs).
        legs: names.
    """

    times_s: Array
    probability: Array
    legs: Sequence[str]


@dataclass(frozen=True, slots=True, eq=False)
class ZoomablePlot:
    """Panels one below the other.

    Attributes:
        key: name of the plot, such as ``path``.
        caption: below it.
        y_labels: of the panels.
        x_labels: of the panels; of one panel, if all share its axis.
        heights_px: of the panels.
        curves: in the order in which they are drawn.
        bands: instead of curves.
        is_to_scale: whether both axes of the first panel have one scale.
        from_zero: whether the panels begin at zero.
        events: times, s, by kind; a vertical line each.
    """

    key: str
    caption: str
    y_labels: Sequence[str]
    x_labels: Sequence[str]
    heights_px: Sequence[int]
    curves: Sequence[Curve] = ()
    bands: ContactBands | None = None
    is_to_scale: bool = False
    from_zero: bool = False
    events: Mapping[str, Sequence[float]] = field(default_factory=dict)

    @property
    def height_px(self) -> int:
        """Of the whole, px."""
        return sum(self.heights_px) + self._gap_px * (len(self.heights_px) - 1) + _MARGINS["t"] + _MARGINS["b"]

    @property
    def _gap_px(self) -> int:
        return _GAP_WITH_LABELS_PX if len(self.x_labels) > 1 else _GAP_PX

    def drawn(self, most: int) -> dict[str, Any]:
        """``data`` and ``layout`` for plotly.js.

        Args:
            most: points of a curve; longer ones are thinned, extremes stay.
        """
        traces = [trace for curve in self.curves for trace in _traces(curve, most)]
        if self.bands is not None:
            traces.append(_heat(self.bands, most))
        return {"key": self.key, "data": traces, "layout": self._layout()}

    def _layout(self) -> dict[str, Any]:
        layout: dict[str, Any] = {
            "height": self.height_px,
            "margin": _MARGINS,
            "showlegend": False,
            "hovermode": "closest" if self.bands or len(self.x_labels) > 1 else "x unified",
            "font": {"family": "system-ui, sans-serif", "size": 12},
            "plot_bgcolor": "white",
            "shapes": self._event_lines(),
        }
        inner = self.height_px - _MARGINS["t"] - _MARGINS["b"]
        top = inner
        for row, (height, label) in enumerate(zip(self.heights_px, self.y_labels, strict=True)):
            number = _number(row)
            own = self.x_labels[row] if len(self.x_labels) > 1 else ""
            is_last = row == len(self.heights_px) - 1
            axis_style = {"gridcolor": _GRID, "zerolinecolor": _GRID, "linecolor": "#999", "automargin": False}
            layout[f"xaxis{number}"] = {
                **axis_style,
                "anchor": f"y{number}",
                "title": {"text": own or (self.x_labels[0] if is_last else ""), "standoff": 6},
                "showticklabels": bool(own) or is_last,
                **({"matches": "x"} if row and not own else {}),
            }
            layout[f"yaxis{number}"] = {
                **axis_style,
                "anchor": f"x{number}",
                "domain": [max(0.0, (top - height) / inner), top / inner],
                "title": {"text": label, "standoff": 4},
                **({"rangemode": "tozero"} if self.from_zero else {}),
                **({"scaleanchor": "x", "scaleratio": 1} if self.is_to_scale and row == 0 else {}),
            }
            top -= height + self._gap_px
        if self.bands is not None:
            layout["yaxis"] |= {"autorange": "reversed", "fixedrange": True, "title": {"text": ""}}
        return layout

    def _event_lines(self) -> list[dict[str, Any]]:
        lines = [
            {
                "type": "line",
                "xref": "x",
                "yref": "paper",
                "x0": round(time_s, 4),
                "x1": round(time_s, 4),
                "y0": 0,
                "y1": 1,
                "layer": "below",
                "opacity": _EVENT_OPACITY,
                "line": {"color": colour, "width": 1},
            }
            for colour, times_s in zip(event_colours(len(self.events)), self.events.values(), strict=True)
            for time_s in times_s
        ]
        return lines[:_MOST_EVENT_LINES]


def thinned(columns: Array, most: int) -> "np.ndarray[tuple[int], np.dtype[np.int64]]":
    """Increasing indices of at most about so many rows of columns (N, k): the extremes of each stretch, and breaks.

    In each of ``most / 2k`` stretches the rows of the smallest and largest value of each column stay, so peaks stay
    where they are.
    """
    count, width = columns.shape
    if count <= most:
        return np.arange(count)
    edges = np.linspace(0, count, max(2, most // (2 * width)) + 1).astype(np.int64)
    kept = [np.array([0, count - 1])]
    for column in columns.T:
        is_hole = np.isnan(column)
        kept.append(np.flatnonzero(np.diff(is_hole.astype(np.int8))) + 1)
        low, high = np.where(is_hole, np.inf, column), np.where(is_hole, -np.inf, column)
        for start, end in pairwise(edges):
            kept.append(np.array([start + np.argmin(low[start:end]), start + np.argmax(high[start:end])]))
    return np.unique(np.concatenate(kept))


def _traces(curve: Curve, most: int) -> list[dict[str, Any]]:
    """The line, and before it its band."""
    band = curve.half_width
    columns = np.column_stack([curve.x, curve.y, *([] if band is None else [band])])
    monotone = bool(np.all(np.diff(curve.x[~np.isnan(curve.x)]) >= 0.0))
    rows = columns[thinned(columns[:, 1:] if monotone else columns, most)]
    common: dict[str, Any] = {
        "type": "scatter",
        "mode": "lines",
        "xaxis": f"x{_number(curve.row)}",
        "yaxis": f"y{_number(curve.row)}",
        "meta": curve.group,
        "name": curve.group,
    }
    style = _line_of(curve.group)
    line = common | {"x": _packed(rows[:, 0]), "y": _packed(rows[:, 1]), "line": style}
    if band is None:
        return [line]
    edge = common | {"x": _packed(rows[:, 0]), "line": {"width": 0, "color": style["color"]}, "hoverinfo": "skip"}
    lower = edge | {"y": _packed(-rows[:, 2])}
    fill = f"rgba({','.join(str(int(style['color'][at : at + 2], 16)) for at in (1, 3, 5))},{_BAND_OPACITY})"
    return [lower, edge | {"y": _packed(rows[:, 2]), "fill": "tonexty", "fillcolor": fill}, line]


def _heat(bands: ContactBands, most: int) -> dict[str, Any]:
    """Contact probability in percent as a picture with a row a leg; of a long log the mean over each stretch."""
    times_s, percent = bands.times_s, 100.0 * bands.probability
    if len(times_s) > most:
        edges = np.linspace(0, len(times_s), most + 1).astype(np.int64)[:-1]
        lengths = np.diff([*edges, len(times_s)])
        times_s = np.add.reduceat(times_s, edges) / lengths
        percent = np.add.reduceat(percent, edges, axis=0) / lengths[:, None]
    whole = np.ascontiguousarray(np.rint(np.clip(percent, 0.0, 100.0)).T.astype(np.uint8))
    return {
        "type": "heatmap",
        "x": _packed(times_s),
        "y": list(bands.legs),
        "z": {**_bytes(whole, "u1"), "shape": f"{whole.shape[0]}, {whole.shape[1]}"},
        "zmin": 0,
        "zmax": 100,
        "ygap": 3,
        "colorscale": [[0, "#ffffff"], [1, STANCE_COLOUR]],
        "showscale": False,
        "hovertemplate": "%{y}: %{z} % at %{x:.2f} s<extra></extra>",
    }


def _line_of(group: str) -> dict[str, Any]:
    if group == GROUND_TRUTH:
        return {"color": REFERENCE["color"], "width": REFERENCE["linewidth"], "dash": "solid"}
    kind = trajectory_kind(group)
    return {"color": kind.colour, "width": kind.line_width, "dash": _DASHES.get(kind.line_style, "solid")}


def _number(row: int) -> str:
    return "" if row == 0 else str(row + 1)


def _packed(column: Array) -> dict[str, str]:
    """A column as plotly.js reads typed arrays."""
    return _bytes(np.ascontiguousarray(column, dtype="<f4"), "f4")


def _bytes(values: Any, dtype: str) -> dict[str, str]:
    return {"dtype": dtype, "bdata": base64.b64encode(values.tobytes()).decode("ascii")}
