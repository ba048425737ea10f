# SPDX-License-Identifier: BSD-3-Clause
"""Zoomable plots on a page: plotly.js, once and compressed, the data, and tick boxes that show and hide trajectories.

The only importer of plotly (extra ``viz``), which brings plotly.js; the page loads nothing from the network. plotly.js
has 4.8 MB; it is embedded as gzip (2 MB as text), which a browser unpacks by itself.
"""

import base64
import gzip
import json
from collections.abc import Sequence
from html import escape

from coclo_vio.evaluation.figure_style import event_colours
from coclo_vio.evaluation.trajectory_roles import featured, in_order
from coclo_vio.evaluation.zoomable_plot import GROUND_TRUTH, ZoomablePlot
from coclo_vio.values.trajectory_kind import trajectory_kind

_DATA_BYTES = 2_000_000
_POINTS = (3000, 2000, 1000, 500, 250, 100)
_TRUTH_COLOUR = "#303030"
_SCRIPT = """
(async () => {
  const text = (id) => document.getElementById(id).textContent;
  const holders = document.querySelectorAll('div.zoomable');
  try {
    const packed = Uint8Array.from(atob(text('plotly')), (letter) => letter.charCodeAt(0));
    const unpacked = new Blob([packed]).stream().pipeThrough(new DecompressionStream('gzip'));
    const script = document.createElement('script');
    script.textContent = await new Response(unpacked).text();
    document.head.append(script);
    const plots = JSON.parse(text('plots'));
    const boxes = [...document.querySelectorAll('#trajectories input')];
    const hidden = () => new Set(boxes.filter((box) => !box.checked).map((box) => box.value));
    const byTouch = matchMedia('(pointer: coarse)').matches;
    const settings = {responsive: true, displaylogo: false, displayModeBar: byTouch ? true : 'hover',
      plotlyServerURL: '', modeBarButtons: [['zoom2d', 'pan2d', 'zoomIn2d', 'zoomOut2d', 'resetScale2d']]};
    for (const plot of plots) {
      const away = hidden();
      for (const trace of plot.data) trace.visible = !away.has(trace.meta);
      plot.layout.dragmode = byTouch ? false : 'zoom';
      await Plotly.newPlot('plot-' + plot.key, plot.data, plot.layout, settings);
    }
    for (const box of boxes) box.addEventListener('change', () => {
      const away = hidden();
      for (const holder of holders)
        Plotly.restyle(holder, {visible: holder.data.map((trace) => !away.has(trace.meta))});
    });
    document.body.dataset.drawn = plots.length;
  } catch (error) {
    for (const holder of holders) holder.textContent = 'This browser could not draw the plot (' + error.message +
      '); the folder figures, beside this page, has it as a picture.';
    document.body.dataset.failed = error.message;
  }
})();
"""


def can_zoom() -> bool:
    """Whether plotly is there."""
    try:
        import plotly.offline  # noqa: F401, PLC0415 -- an extra, and slow
    except ImportError:
        return False
    return True


def holder(plot: ZoomablePlot) -> str:
    """Where a plot goes on the page, with its caption."""
    kinds = "".join(
        f'<span class="swatch" style="background:{colour}"></span>{escape(kind)} '
        for kind, colour in zip(plot.events, event_colours(len(plot.events)), strict=True)
    )
    return (
        f'<figure><div class="zoomable" id="plot-{escape(plot.key)}" style="height:{plot.height_px}px"></div>'
        f"<figcaption>{escape(plot.caption)} {kinds}</figcaption></figure>"
    )


def tick_boxes(plots: Sequence[ZoomablePlot]) -> str:
    """A box for each trajectory that shows it in all plots; baselines are hidden at first."""
    names = {curve.group for plot in plots for curve in plot.curves}
    estimates = in_order(name for name in names if name != GROUND_TRUTH)
    shown = {GROUND_TRUTH, *featured(estimates)}
    boxes = [
        f'<label><input type="checkbox" value="{escape(name)}"{" checked" if name in shown else ""}>'
        f'<span class="swatch" style="background:{_colour(name)}"></span>{escape(name)}</label>'
        for name in [*(name for name in (GROUND_TRUTH,) if name in names), *estimates]
    ]
    return (
        f'<div id="trajectories">{"".join(boxes)}</div>'
        "<noscript><p>The plots need JavaScript; the folder figures, beside this page, has them as pictures.</p>"
        "</noscript>"
    )


def scripts(plots: Sequence[ZoomablePlot]) -> str:
    """plotly.js, the data of the plots, and what draws them; to stand once, after all holders.

    Raises:
        ImportError: plotly is missing.
    """
    from plotly.offline import get_plotlyjs  # noqa: PLC0415 -- an extra, and slow

    library = base64.b64encode(gzip.compress(get_plotlyjs().encode("utf-8"), mtime=0)).decode("ascii")
    return (
        f'<script type="text/plain" id="plotly">{library}</script>\n'
        f'<script type="application/json" id="plots">{_data(plots)}</script>\n<script>{_SCRIPT}</script>'
    )


def _data(plots: Sequence[ZoomablePlot]) -> str:
    """The plots as JSON, their curves thinned until they have a size that a page can bear."""
    text = ""
    for most in _POINTS:
        text = json.dumps([plot.drawn(most) for plot in plots], separators=(",", ":")).replace("</", "<\\/")
        if len(text) <= _DATA_BYTES:
            break
    return text


def _colour(name: str) -> str:
    return _TRUTH_COLOUR if name == GROUND_TRUTH else trajectory_kind(name).colour
