# SPDX-License-Identifier: BSD-3-Clause
"""Latency, memory, processor time and drift over time, one below the other."""

from pathlib import Path

from coclo_vio.evaluation.figure_style import empty_figure, save_png
from coclo_vio.experiments.soak.soak_record import SoakRecord


def plot_soak(record: SoakRecord, path: Path) -> Path:
    """Draw the record; returns the path.

    Raises:
        EvaluationError: matplotlib is missing.
        OSError: the file cannot be written.
    """
    figure = empty_figure(8.0, 9.0)
    latency, memory, cpu, drift = (figure.add_subplot(4, 1, row + 1) for row in range(4))
    intervals = record.latency.intervals
    for name in record.latency.trajectories:
        rows = [(one.time_s / 60.0, one.latency_p95_ms[name]) for one in intervals if name in one.latency_p95_ms]
        latency.semilogy([time for time, _ in rows], [p95 for _, p95 in rows], label=name, linewidth=0.9)
    for name in sorted({name for one in intervals for name in one.processes}):
        known = [(one.time_s / 60.0, one.processes[name]) for one in intervals if name in one.processes]
        times = [time for time, _ in known]
        memory.plot(times, [load.rss_mb for _, load in known], label=name)
        cpu.plot(times, [load.cpu_percent for _, load in known], label=name, linewidth=0.9)
    for name in record.latency.trajectories:
        own = [one for one in record.rounds if one.trajectory == name]
        drift.plot(
            [one.time_s / record.latency.rate / 60.0 for one in own],
            [one.drift_percent for one in own],
            "o-",
            label=name,
        )
    latency.set_ylabel("latency, p95, ms")
    memory.set_ylabel("memory, MiB")
    cpu.set_ylabel("of a core, %")
    drift.set_ylabel("drift of a round, %")
    drift.set_xlabel("time, min")
    for axis in (latency, memory, cpu, drift):
        axis.grid(visible=True, alpha=0.3)
        if axis.get_legend_handles_labels()[0]:
            axis.legend(fontsize="small")
    return save_png(figure, path)
