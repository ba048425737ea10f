# SPDX-License-Identifier: BSD-3-Clause
"""Results as Markdown, each from its JSON file and with its origin."""

from collections.abc import Callable, Mapping

from coclo_vio.experiments.grid.grid_record import GridRecord
from coclo_vio.experiments.grid.grid_text import SHARE_HEAD, cell_head, cell_rows, share_rows
from coclo_vio.experiments.results.fault_blocks import FAULT_BLOCKS
from coclo_vio.experiments.results.kill_blocks import KILL_BLOCKS
from coclo_vio.experiments.results.legged_blocks import LEGGED_BLOCKS
from coclo_vio.experiments.results.performance_blocks import PERFORMANCE_BLOCKS
from coclo_vio.experiments.results.result_files import ResultFiles, markdown_table
from coclo_vio.experiments.table.table_record import FigureSpreads, TableSummary
from coclo_vio.runs.modes.registry import modes
from coclo_vio.values.trajectory_kind import trajectory_kind

_TRIALS = ("flat", "ramp", "stairs")
_COLUMNS = ("coclo", "vins", "combined_coclo", "combined_vins")
_SPEED = (
    ("filter_cycles_per_s", "filter, predict and update, cycles a second", "{:.0f}"),
    ("filter_vs_filterpy", "the same against filterpy's UKF of equal models, times as fast", "{:.1f}"),
    ("realtime_factor", "leg odometry at 100 Hz, times real time", "{:.1f}"),
    ("frontend_ms_median", "front end, ms a frame, median", "{:.1f}"),
    ("frontend_ms_p95", "front end, ms a frame, 95th percentile", "{:.1f}"),
    ("smoother_ms_median", "smoother, ms a keyframe, median", "{:.1f}"),
    ("smoother_ms_p95", "smoother, ms a keyframe, 95th percentile", "{:.1f}"),
    ("vision_ms_per_frame", "vision, ms a frame, mean", "{:.1f}"),
    ("peak_rss_mb", "largest memory, MiB", "{:.0f}"),
)


def _demo(files: ResultFiles) -> str:
    """What the demo prints."""
    return f"```text\n{files.read('demo.json')['printed']}\n```\n\n{files.origin('demo.json')}"


def _trials(files: ResultFiles) -> str:
    """The paper's trials over seeds: median drift / RPE (worst), wins, and consistency."""
    summary = files.table()
    rows = [[trial, *(_drift_and_rpe(summary.trials[trial][name].vicon) for name in _COLUMNS)] for trial in _TRIALS]
    table = markdown_table(["trial", *(_head(name) for name in _COLUMNS)], rows)
    return f"{table}\n\n{_wins(summary)}\n{_consistency(summary)}\n\n{files.origin('table.json')}"


def _trials_in_short(files: ResultFiles) -> str:
    """The same without spreads."""
    trials = files.table().trials
    rows = [
        [trial, *(_drift_and_rpe(trials[trial][name].vicon, with_worst=False) for name in _COLUMNS)]
        for trial in _TRIALS
    ]
    table = markdown_table(["trial", *(_head(name) for name in _COLUMNS)], rows)
    return f"{table}\n\n{files.origin('table.json')}"


def _head(name: str) -> str:
    modes()  # registers the kinds
    kind = trajectory_kind(name)
    return f"**{kind.label}**" if kind.standalone else kind.label


def _drift_and_rpe(against: FigureSpreads, *, with_worst: bool = True) -> str:
    drift, rpe = against.drift_percent, against.rpe_1m_percent
    if drift is None or rpe is None:
        return "-"
    median = f"{drift.median:.2f} / {rpe.median:.2f}"
    return f"{median} ({drift.worst:.2f} / {rpe.worst:.2f})" if with_worst else median


def _wins(summary: TableSummary) -> str:
    sentences = []
    for name, wins in summary.wins.items():
        every = wins["vicon"]["all"]
        kind = trajectory_kind(name)
        alone = trajectory_kind(kind.standalone or "").label
        sentences.append(
            f"{kind.label} drifts less than {alone} in {every.drift.wins} of {every.drift.of} pairs of trial and "
            f"seed, and has the lower RPE in {every.rpe.wins}."
        )
    return " ".join(sentences)


def _consistency(summary: TableSummary) -> str:
    cells = ", ".join(
        f"{trial} {_anees(summary, trial, 'combined_coclo')} ({_anees(summary, trial, 'coclo')}, "
        f"{_anees(summary, trial, 'vins')})"
        for trial in _TRIALS
    )
    return f"Median ANEES of combined COCLO against the truth (in parentheses COCLO, VINS): {cells}."


def _anees(summary: TableSummary, trial: str, name: str) -> str:
    spread = summary.trials[trial][name].truth.anees_pose
    return "-" if spread is None else f"{spread.median:.2f}"


def _go1(files: ResultFiles) -> str:
    """A real robot, every mode of legs."""
    keys = (
        ("ate_planar_m", "planar ATE [m]", "{:.3f}"),
        ("path_length_ratio", "path ratio", "{:.3f}"),
        ("drift_percent", "drift [%]", "{:.2f}"),
        ("yaw_drift_deg", "yaw drift [deg]", "{:.1f}"),
        ("anees_pose", "ANEES", "{:.0f}"),
    )
    metrics = files.read("go1.json")
    rows = [
        [f"`{name}`", *("" if one[key] is None else form.format(one[key]) for key, _, form in keys)]
        for name, one in metrics.items()
    ]
    return f"{markdown_table(['', *(title for _, title, _ in keys)], rows)}\n\n{files.origin('go1.json')}"


def _legs(files: ResultFiles) -> str:
    """Legs alone on the simulated trials: the contact-centric filter and the IMU-centric one."""
    summary = files.read("leg_odometry.json")["summary"]
    rows = []
    for trial in _TRIALS:
        for name, one in summary[f"imperfect {trial}"].items():
            rows.append(
                [
                    trial,
                    f"`{name}`",
                    f"{one['drift_percent']:.2f} ({one['worst_drift_percent']:.2f})",
                    f"{one['rpe_1m_percent']:.2f} ({one['worst_rpe_1m_percent']:.2f})",
                    f"{one['path_length_ratio']:.3f}",
                    f"{one['anees_pose']:.1f}",
                    f"{100.0 * one['contact_right']:.1f}",
                ]
            )
    head = ("trial", "", "drift [%], mean (worst)", "RPE [%], mean (worst)", "path ratio", "ANEES", "contact right [%]")
    return f"{markdown_table(head, rows)}\n\n{files.origin('leg_odometry.json')}"


def _vision(files: ResultFiles) -> str:
    """Vision alone on trials of a robot exactly as described."""
    rows = []
    for trial, by_mode in files.read("visual_odometry.json")["summary"].items():
        for name, one in by_mode.items():
            truth = one["truth"]
            rows.append(
                [
                    trial,
                    f"`{name}`",
                    str(one["seeds"]),
                    *(_median_and_worst(truth[key]) for key in ("drift_percent", "rpe_1m_percent")),
                    f"{truth['yaw_drift_deg']['median']:.2f}",
                ]
            )
    head = ("trial", "", "seeds", "drift [%], median (worst)", "RPE [%], median (worst)", "yaw [deg]")
    return f"{markdown_table(head, rows)}\n\n{files.origin('visual_odometry.json')}"


def _median_and_worst(spread: Mapping[str, float]) -> str:
    return f"{spread['median']:.2f} ({spread['worst']:.2f})"


def _speed(files: ResultFiles) -> str:
    """Rates and latencies on one core."""
    figures = files.read("speed.json")
    rows = [[title, form.format(figures[key])] for key, title, form in _SPEED if figures.get(key) is not None]
    return f"{markdown_table(('one core', ''), rows)}\n\n{files.origin('speed.json')}"


def _grid(files: ResultFiles) -> str:
    """The grid of conditions, a cell a line."""
    modes()  # registers the kinds
    record = GridRecord.read(files.folder / "grid.json")
    shares, cells = markdown_table(SHARE_HEAD, share_rows(record)), markdown_table(cell_head(record), cell_rows(record))
    return f"{shares}\n\n{cells}\n\n{files.origin('grid.json')}"


def _contradictions(files: ResultFiles) -> str:
    """Recordings that physics contradicts, and what is said of them."""
    rows = [
        [
            one["kind"],
            f"{one['name']} ({one['form']})",
            str(one["says"]).replace("|", "\\|"),
            ", ".join(f"`{each}`" for each in one["settings"]) or "-",
            f"{one['inspect']}, {one['run']}, {one['doctor']}",
        ]
        for one in files.read("contradictions.json")
    ]
    head = (
        "kind",
        "member",
        "what is said",
        "settings that certainly correct it",
        "inspect; exit status of run, doctor",
    )
    return f"{markdown_table(head, rows)}\n\n{files.origin('contradictions.json')}"


BLOCKS: Mapping[str, Callable[[ResultFiles], str]] = {
    "demo": _demo,
    "trials": _trials,
    "trials_in_short": _trials_in_short,
    "go1": _go1,
    "legs": _legs,
    "vision": _vision,
    "speed": _speed,
    "grid": _grid,
    "contradictions": _contradictions,
    **PERFORMANCE_BLOCKS,
    **LEGGED_BLOCKS,
    **FAULT_BLOCKS,
    **KILL_BLOCKS,
}
"""What pages can show, by name."""
