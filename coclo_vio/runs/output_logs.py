# SPDX-License-Identifier: BSD-3-Clause
"""What a run folder keeps of keyframes, of learnt calibrations and of pictures."""

import csv
import logging
from array import array
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from pathlib import Path

import numpy as np

from coclo_vio.datasets.images import encoded
from coclo_vio.runs.line_file import LineFile
from coclo_vio.runs.run_record import KeyframeSummary
from coclo_vio.values.arrays import Array
from coclo_vio.values.errors import DatasetError
from coclo_vio.values.outputs import Calibration, KeyframeHealth, Picture
from coclo_vio.values.units import MS_PER_S
from coclo_vio.values.whole_files import WholeLines, write_whole

_log = logging.getLogger(__name__)
_COLUMNS = tuple(field.name for field in fields(KeyframeHealth))
_CALIBRATION_COLUMNS = (
    "stamp_ns",
    *(f"rotation_body_{axis}_rad" for axis in "xyz"),
    *(f"rotation_sigma_{axis}_rad" for axis in "xyz"),
    "stereo_scale",
    "stereo_scale_sigma",
)
_SUMMED = ("tracks", "reprojection_px", "iterations", "compute_s")


class KeyframeWriter:
    """Writes ``<estimator>_keyframes.csv``, a row for each keyframe as it comes, and sums them up.

    Its columns are the fields of ``KeyframeHealth``. Without a keyframe there is no file.
    """

    def __init__(self, folder: Path, estimator: str, state: "KeyframeLogState | None" = None) -> None:
        """Begin, or go on from a state.

        Raises:
            OSError: the file cannot be written.
            DatasetError: it has lost rows.
        """
        self._path = keyframes_path(folder, estimator)
        self._out: LineFile | None = None
        self._kept = {name: array("d") for name in _SUMMED}
        if state is not None and state.size:
            self._out = LineFile(self._path, state.size)
            self._kept = {name: array("d", kept) for name, kept in state.kept.items()}
        else:
            self._path.unlink(missing_ok=True)

    @property
    def state(self) -> "KeyframeLogState":
        """To go on from."""
        kept = {name: array("d", kept) for name, kept in self._kept.items()}
        return KeyframeLogState(0 if self._out is None else self._out.size, kept)

    def write(self, health: KeyframeHealth) -> None:
        """Append one keyframe."""
        if self._out is None:
            self._out = LineFile(self._path)
            self._out.append([",".join(_COLUMNS) + "\n"])
        values = asdict(health)
        cells = (f"{value:.9g}" if isinstance(value, float) else str(value) for value in values.values())
        self._out.append([",".join(cells) + "\n"])
        for name, kept in self._kept.items():
            kept.append(values[name])

    def summary(self) -> KeyframeSummary | None:
        """Their number, and medians and 95th percentiles of what describes them; None without a keyframe."""
        if self._out is None:
            return None
        figures: dict[str, float | None] = {}
        for name, kept in self._kept.items():
            values, label = np.array(kept), name
            if name == "compute_s":
                values, label = values * MS_PER_S, "compute_ms"
            values = values[np.isfinite(values)]
            for suffix, share in (("median", 50.0), ("p95", 95.0)):
                figures[f"{label}_{suffix}"] = float(np.percentile(values, share)) if len(values) else None
        return KeyframeSummary.model_validate({"count": len(self._kept["tracks"]), **figures})

    def close(self) -> None:
        """Close the file, if there is one."""
        if self._out is not None:
            self._out.close()


@dataclass(frozen=True, slots=True)
class KeyframeLogState:
    """How far a file of keyframes is written.

    Attributes:
        size: bytes.
        kept: what is summed up, by column.
    """

    size: int
    kept: Mapping[str, "array[float]"]


def keyframes_path(folder: Path, estimator: str) -> Path:
    """Where the keyframes of an estimator stand in a run folder."""
    return folder / f"{estimator}_keyframes.csv"


def read_keyframes(folder: Path, estimator: str) -> Mapping[str, Array] | None:
    """The columns (N,) of an estimator's keyframes by name; None where it has none.

    Raises:
        DatasetError: the file is malformed.
    """
    path = keyframes_path(folder, estimator)
    if not path.is_file():
        return None
    rows = _read_rows(path, _COLUMNS)
    try:
        table = np.array([[float(cell) for cell in row] for row in rows]).reshape(len(rows), len(_COLUMNS))
    except ValueError as error:
        raise _malformed(path, error) from error
    return dict(zip(_COLUMNS, table.T, strict=True))


def read_health(folder: Path, trajectory: str) -> tuple[KeyframeHealth, ...]:
    """The keyframes of a trajectory in time order; none where it has none.

    Raises:
        DatasetError: the file is malformed.
    """
    path = keyframes_path(folder, trajectory)
    if not path.is_file():
        return ()
    try:
        return tuple(_health(dict(zip(_COLUMNS, row, strict=True))) for row in _read_rows(path, _COLUMNS))
    except ValueError as error:
        raise _malformed(path, error) from error


def _health(row: Mapping[str, str]) -> KeyframeHealth:
    return KeyframeHealth(
        stamp_ns=int(row["stamp_ns"]),
        keyframes=int(row["keyframes"]),
        tracks=int(row["tracks"]),
        landmarks=int(row["landmarks"]),
        factors=int(row["factors"]),
        reprojection_px=float(row["reprojection_px"]),
        iterations=int(row["iterations"]),
        compute_s=float(row["compute_s"]),
        condition=float(row["condition"]),
    )


def _read_rows(path: Path, columns: tuple[str, ...]) -> list[list[str]]:
    """The rows of a file with these columns, as text.

    Raises:
        DatasetError: the file cannot be read, has other columns, or a row of another length.
    """
    try:
        read = WholeLines.read(path)
        header, *rows = [*csv.reader(read.lines)] or [[]]
    except (OSError, ValueError, csv.Error) as error:
        raise _malformed(path, error) from error
    if read.cut:
        _log.warning("%s: %s", path, read.cut_note(path))
    if not read.lines:
        return []
    if tuple(header) != columns:
        raise _malformed(path, f"its columns are {','.join(header) or 'none'}, they must be {','.join(columns)}")
    for number, row in enumerate(rows, start=2):
        if len(row) != len(columns):
            raise _malformed(path, f"line {number} has {len(row)} cells under a header of {len(columns)} columns")
    return rows


def _malformed(path: Path, problem: object) -> DatasetError:
    return DatasetError(f"{path}: {problem}; run again, or delete it to do without")


class CalibrationWriter:
    """Writes ``<trajectory>_calibration.csv``, a row for each calibration as it is learnt, and keeps the last.

    Without a calibration there is no file.
    """

    def __init__(self, folder: Path, trajectory: str, size: int = 0, last: Calibration | None = None) -> None:
        """Begin, or go on after so many bytes and the last calibration.

        Raises:
            OSError: the file cannot be written.
            DatasetError: it has lost rows.
        """
        self._path = folder / f"{trajectory}_calibration.csv"
        self._out: LineFile | None = LineFile(self._path, size) if size else None
        self.last = last
        if not size:
            self._path.unlink(missing_ok=True)

    @property
    def size(self) -> int:
        """Bytes that are written."""
        return 0 if self._out is None else self._out.size

    def write(self, calibration: Calibration) -> None:
        """Append one."""
        if self._out is None:
            self._out = LineFile(self._path)
            self._out.append([",".join(_CALIBRATION_COLUMNS) + "\n"])
        scale = (calibration.stereo_scale, calibration.stereo_scale_sigma)
        values = (*calibration.rotation_body, *calibration.rotation_sigma, *scale)
        self._out.append([f"{calibration.stamp_ns}," + ",".join(f"{value:.9g}" for value in values) + "\n"])
        self.last = calibration

    def close(self) -> None:
        """Close the file, if there is one."""
        if self._out is not None:
            self._out.close()


def read_calibrations(folder: Path, trajectory: str) -> tuple[Calibration, ...]:
    """What a run learnt of the cameras, in time order; nothing where it learnt nothing.

    Raises:
        DatasetError: the file is malformed.
    """
    path = folder / f"{trajectory}_calibration.csv"
    if not path.is_file():
        return ()
    try:
        return tuple(_calibration(row) for row in _read_rows(path, _CALIBRATION_COLUMNS))
    except ValueError as error:
        raise _malformed(path, error) from error


def _calibration(row: list[str]) -> Calibration:
    values = [float(cell) for cell in row[1:]]
    return Calibration(int(row[0]), np.array(values[:3]), np.array(values[3:6]), values[6], values[7])


class PictureWriter:
    """Writes frames with their tracks drawn on them to ``debug_images/<mode>/<stamp in ns>.jpg``."""

    def __init__(self, folder: Path, estimator: str, written: int = 0) -> None:
        self._folder = folder / "debug_images" / estimator
        self.written = written

    def write(self, picture: Picture) -> None:
        """Write one."""
        self._folder.mkdir(parents=True, exist_ok=True)
        write_whole(self._folder / f"{picture.stamp_ns}.jpg", encoded(picture.image, "jpeg"))
        self.written += 1
