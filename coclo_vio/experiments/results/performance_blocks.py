# SPDX-License-Identifier: BSD-3-Clause
"""Costs and speed as Markdown, each from its JSON file and with its origin."""

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from coclo_vio.experiments.bench.bench_record import BenchRecord, Endurance, Sweep
from coclo_vio.experiments.bench.commit_speed import CommitSpeed
from coclo_vio.experiments.results.result_files import ResultFiles, markdown_table


def _commit_speed(files: ResultFiles) -> str:
    """How many times as fast as the commit before the work on speed."""
    speed = CommitSpeed.read(files.folder / "commit_speed.json")
    rows = [
        [ratio.what, f"{ratio.before:.1f}", f"{ratio.after:.1f}", f"**{ratio.ratio:.1f}**"]
        for ratio in speed.ratios.values()
    ]
    table = markdown_table(["one core", f"commit {speed.before}", "now", "times as fast"], rows)
    return f"{table}\n\n{_second_core(speed)}{files.origin('commit_speed.json')}"


def _second_core(speed: CommitSpeed) -> str:
    second = speed.second_core
    if second is None:
        return ""
    same = "the same bytes" if second.is_same else "not the same bytes"
    return (
        f"`combined` on the bundled sample takes {second.one_s:.1f} s on one core, and {second.two_s:.1f} s on two "
        f"with `bridge.frame_threads` and `dataset.reading_threads` 1: "
        f"{second.one_s / second.two_s:.2f} times as fast, with {same} in every trajectory.\n\n"
    )


def _bench(files: ResultFiles) -> str:
    """Cost of every stage."""
    record = BenchRecord.read(files.folder / "bench.json")
    rows = [[stage.what, f"{stage.ms:.2f}", f"{stage.units:.4f}"] for stage in record.stages.values()]
    table = markdown_table(["one core", "ms", "calibration loops"], rows)
    sentences = [
        f"The calibration loop took {record.calibration_ms:.1f} ms.",
        f"`combined` of four legs at 500 Hz with stereo images at 15 Hz runs at "
        f"{record.combined_realtime_factor:.2f} times real time.",
    ]
    if record.compile_s is not None:
        sentences.append(f"Compiling all kernels, once on a machine, takes {record.compile_s:.1f} s.")
    return f"{table}\n\n{' '.join(sentences)}\n\n{files.origin('bench.json')}"


def _scaling(files: ResultFiles) -> str:
    """Exponents of the costs, and long inputs."""
    record = BenchRecord.read(files.folder / "bench.json")
    grown = markdown_table(
        ["cost", "grows with", "from, to", "ms", "exponent", "at the end"],
        [_sweep_row(sweep) for sweep in record.sweeps.values()],
    )
    long = markdown_table(
        ["long input", "minutes", "ms, all stretches", "growth over all", "memory first, MiB", "memory last, MiB"],
        [_endurance_row(endured) for endured in record.endurance.values()],
    )
    return f"{grown}\n\n{long}\n\n{files.origin('bench.json')}"


def _sweep_row(sweep: Sweep) -> list[str]:
    return [
        sweep.what,
        sweep.size,
        f"{sweep.sizes[0]:g} to {sweep.sizes[-1]:g}",
        f"{sweep.ms_at_one_speed[0]:.2f} to {sweep.ms_at_one_speed[-1]:.2f}",
        f"{sweep.exponent:.2f}",
        f"{sweep.last_exponent:.2f}",
    ]


def _endurance_row(endured: Endurance) -> list[str]:
    return [
        endured.what,
        f"{endured.minutes[-1]:g}",
        f"{min(endured.ms_at_one_speed):.3f} to {max(endured.ms_at_one_speed):.3f}",
        f"{_growth_percent(endured.minutes, endured.units):+.1f} %",
        f"{endured.resident_mb[0]:.0f}",
        f"{endured.resident_mb[-1]:.0f}",
    ]


def _growth_percent(minutes: Sequence[float], units: Sequence[float]) -> float:
    """Change of a cost over a long input, of the straight line through its stretches after the first, %."""
    at, cost = np.array(minutes[1:]), np.array(units[1:])
    slope, start = np.polyfit(at, cost, 1)
    return float(100.0 * slope * (at[-1] - at[0]) / (start + slope * at[0]))


PERFORMANCE_BLOCKS: Mapping[str, Callable[[ResultFiles], str]] = {
    "commit_speed": _commit_speed,
    "bench": _bench,
    "scaling": _scaling,
}
"""What the page on performance can show, by name."""
