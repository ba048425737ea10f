# SPDX-License-Identifier: BSD-3-Clause
"""A format: CSV with semicolons, decimal commas and milliseconds since the start, as spreadsheets write it."""

import csv
from collections.abc import Iterator
from pathlib import Path

import coclo_vio as cv
from coclo_vio.datasets.recording_reader import RecordingReader

PARTS = ("pos", "vel", "torque")  # rad, rad/s, Nm


class SemicolonLog(RecordingReader):
    """Columns ``t_ms``, ``wx`` to ``wz`` (rad/s), ``ax`` to ``az`` (m/s^2), ``<joint>.pos``, ``.vel``, ``.torque``."""

    format_name = "semicolon log"

    def __init__(self, path: Path, robot: cv.RobotDescription | None, config: object) -> None:
        super().__init__(path.stem, config)
        self._path, self._joints = path, () if robot is None else robot.joint_names

    def _samples(self, tally: object) -> Iterator[cv.Measurement]:
        with self._path.open(encoding="utf-8", newline="") as lines:
            rows = csv.DictReader(lines, delimiter=";")
            try:
                for row in rows:
                    cell = {name: float(text.replace(",", ".")) for name, text in row.items()}
                    stamp_ns = round(cell["t_ms"] * 1e6)
                    yield cv.ImuSample(stamp_ns, *([cell[f"{v}{axis}"] for axis in "xyz"] for v in "wa"))
                    if self._joints:
                        parts = ([cell[f"{joint}.{part}"] for joint in self._joints] for part in PARTS)
                        yield cv.JointSample(stamp_ns, *parts)
            except (AttributeError, KeyError, ValueError) as error:
                raise cv.DatasetError(f"{self._path}, line {rows.line_num}: {error}; correct it") from error


def _header(path: Path) -> list[str]:
    with path.open(encoding="utf-8", errors="replace") as lines:
        return lines.readline().strip().split(";")


def _joint_names(path: Path, columns: object) -> tuple[Path, tuple[str, ...]]:
    return path, tuple(name.removesuffix(".pos") for name in _header(path) if name.endswith(".pos"))


def _matches(path: Path) -> bool:
    return path.suffix == ".csv" and _header(path)[0] == "t_ms"


cv.register_format("semicolon log", _matches, SemicolonLog, layout="a .csv with semicolons", joint_names=_joint_names)
