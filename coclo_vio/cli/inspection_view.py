# SPDX-License-Identifier: BSD-3-Clause
"""An inspection as it is shown on a terminal: one table of streams, and rows of text under titles."""

from collections.abc import Iterator

from rich.box import SIMPLE_HEAD
from rich.console import RenderableType
from rich.table import Table
from rich.text import Text

from coclo_vio.datasets.read_report import StreamReport
from coclo_vio.runs.inspection import Inspection, Joints, Topic, Truth
from coclo_vio.values.errors import listing
from coclo_vio.values.units import NS_PER_S

_COLUMNS = ("samples", "rate\nHz", "start\ns", "length\ns", "gaps", "longest\npause s", "at\ns")
_WIDEST_LABEL = 24
_READY = "ready"
_MOST_OTHERS = 8

Section = tuple[str, list[tuple[str, str]]]  # title, and rows of label and text


def drawn(inspection: Inspection) -> Iterator[RenderableType]:
    """What to print, piece by piece."""
    yield Text(f"{inspection.name}: {inspection.report.format}", style="bold")
    yield _stream_table(inspection.report.streams)
    grid = Table.grid(padding=(0, 2))
    grid.add_column(style="bold", no_wrap=True)
    grid.add_column(max_width=_WIDEST_LABEL, overflow="fold")
    grid.add_column(overflow="fold")
    for title, rows in _sections(inspection):
        for number, (label, text) in enumerate(rows):
            mode_style = "green" if text == _READY else "yellow"
            grid.add_row(title if number == 0 else "", Text(label), Text(text, mode_style if title == "modes" else ""))
    yield grid


def _stream_table(streams: tuple[StreamReport, ...]) -> Table:
    table = Table(box=SIMPLE_HEAD, pad_edge=False, collapse_padding=True)
    table.add_column("stream", no_wrap=True)
    for label in _COLUMNS:
        table.add_column(label, justify="right", no_wrap=True)
    begin_ns = min(stream.start_ns for stream in streams)
    for stream in streams:
        start_s, pause_at_s = ((at - begin_ns) / NS_PER_S for at in (stream.start_ns, stream.longest_gap_start_ns))
        figures = (f"{stream.rate_hz:.1f}", f"{start_s:.3f}", f"{stream.duration_s:.2f}", str(stream.gaps))
        pause = (f"{stream.longest_gap_s:.3f}", f"{pause_at_s:.2f}") if stream.longest_gap_s else ("-", "-")
        table.add_row(stream.name, str(stream.samples), *figures, *pause)
    return table


def _sections(inspection: Inspection) -> list[Section]:
    """What stands under the table of streams; empty ones left out."""
    doubtful = [(stream.name, _doubts(stream)) for stream in inspection.report.streams if _doubts(stream)]
    all_sections: list[Section] = [
        ("stamps", doubtful),
        ("robot", _robot_rows(inspection)),
        ("topics", [(topic.role, _topic_sentence(topic)) for topic in inspection.topics]),
        ("calibration", [(sensor, text or "not in the recording") for sensor, text in inspection.calibrations.items()]),
        ("ground truth", [_truth_row(inspection.ground_truth)]),
        ("problems", [("-", problem) for problem in inspection.problems]),
        ("findings", [(finding.severity.value, finding.sentence) for finding in inspection.findings]),
        ("left out", [(str(count), reason) for reason, count in inspection.report.dropped.items()]),
        ("notes", [("-", note) for note in inspection.report.notes if note not in " ".join(inspection.problems)]),
        ("modes", list(_mode_rows(inspection))),
    ]
    return [(title, rows) for title, rows in all_sections if rows]


def _mode_rows(inspection: Inspection) -> Iterator[tuple[str, str]]:
    """Modes that lack the same stand in one row."""
    by_lack: dict[tuple[str, ...], list[str]] = {}
    for mode, lacks in inspection.missing.items():
        by_lack.setdefault(lacks, []).append(mode)
    for lacks, names in by_lack.items():
        yield ", ".join(names), f"needs {'; '.join(lacks)}" if lacks else _READY


def _doubts(stream: StreamReport) -> str:
    """What is wrong with a stream's samples, empty where nothing is."""
    counts = (
        (stream.repeated_stamps, "with the stamp of the one before"),
        (stream.backward_stamps, "older than the one before (the clock jumps; --set dataset.sort=true sorts them)"),
        (stream.samples_with_nan, "with a reading that is NaN"),
    )
    return ", ".join(f"{count} {what}" for count, what in counts if count)


def _robot_rows(inspection: Inspection) -> list[tuple[str, str]]:
    joints = inspection.joints
    total = len(joints.matched) + len(joints.missing)
    if inspection.robot is None:
        return [("none", f"{_fit(joints)}; name yours with --robot" if joints.there else "there are no joints")]
    if joints.missing:
        return [
            (
                inspection.robot,
                f"{len(joints.matched)} of {total} joints found, not {listing(joints.missing)}; {_fit(joints)}",
            )
        ]
    return [(inspection.robot, f"all {total} joints found, {'with' if joints.has_effort else 'without'} torques")]


def _fit(joints: Joints) -> str:
    """Which robot the recording's joints fit."""
    if joints.fitting:
        return f"the joints fit {listing(joints.fitting)}"
    if joints.nearest is not None:
        return f"the joints fit {joints.nearest} but for {listing(joints.missing)}; there are {listing(joints.there)}"
    return f"the joints {listing(joints.there)} are those of no known robot" if joints.there else "there are no joints"


def _topic_sentence(topic: Topic) -> str:
    kind = topic.msgtype.rpartition("/")[2]
    chosen = f"{', '.join(topic.topics)} ({kind}): {topic.reason}" if topic.topics else f"none: {topic.reason}"
    return f"{chosen}; could be {listing(topic.others, _MOST_OTHERS)}" if topic.others else chosen


def _truth_row(truth: Truth | None) -> tuple[str, str]:
    if truth is None:
        return "none", "a run cannot be evaluated unless one is given with --vicon"
    span = "without stamps" if truth.duration_s is None else f"over {truth.duration_s:.1f} s"
    return truth.source, f"{truth.poses} poses {span}, path of {truth.path_length_m:.1f} m"
