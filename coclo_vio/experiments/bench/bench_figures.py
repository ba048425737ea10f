# SPDX-License-Identifier: BSD-3-Clause
"""Costs over sizes as plots, with their exponents."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from coclo_vio.evaluation.figure_style import empty_figure, save_png
from coclo_vio.experiments.bench.bench_record import Endurance, Sweep

_COLUMNS = 3


def plot_scaling(sweeps: Mapping[str, Sweep], endurance: Mapping[str, Endurance], path: Path) -> None:
    """Draw every sweep with logarithmic axes, and every long input over its minutes.

    Raises:
        EvaluationError: matplotlib is missing.
    """
    panels = len(sweeps) + len(endurance)
    rows = -(-panels // _COLUMNS)
    figure = empty_figure(4.0 * _COLUMNS, 3.0 * rows)
    axes = [figure.add_subplot(rows, _COLUMNS, number + 1) for number in range(panels)]
    for axis, sweep in zip(axes, sweeps.values(), strict=False):
        axis.loglog(sweep.sizes, sweep.ms_at_one_speed, "o-", color="tab:blue")
        sizes = np.array(sweep.sizes)
        fitted = np.exp(
            np.mean(np.log(sweep.ms_at_one_speed)) + sweep.exponent * (np.log(sizes) - np.mean(np.log(sizes)))
        )
        axis.loglog(sizes, fitted, "--", color="0.5", label=f"exponent {sweep.exponent:.2f}")
        axis.set_xticks(sweep.sizes, [f"{size:g}" for size in sweep.sizes])
        axis.xaxis.minorticks_off()
        axis.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
        axis.yaxis.set_minor_formatter(lambda value, _: f"{value:g}")
        axis.tick_params(axis="y", which="both", labelsize=7)
        axis.set(xlabel=sweep.size, title=sweep.what)
        axis.title.set_fontsize(9)
        axis.legend()
    for axis, long in zip(axes[len(sweeps) :], endurance.values(), strict=True):
        axis.plot(long.minutes, long.ms_at_one_speed, "o-", color="tab:blue")
        axis.set(xlabel="input, min", title=long.what)
        axis.title.set_fontsize(9)
        axis.set_ylim(0.0, 1.5 * max(long.ms_at_one_speed))
        memory = axis.twinx()
        memory.plot(long.minutes, long.resident_mb, "s--", color="tab:red")
        memory.set_ylabel("memory, MiB", color="tab:red")
        memory.set_ylim(0.0, 1.2 * max(long.resident_mb))
    save_png(figure, path)
