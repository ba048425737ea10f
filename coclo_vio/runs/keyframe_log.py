# SPDX-License-Identifier: BSD-3-Clause
"""What a run folder keeps of a smoother's keyframes and of a front end's pictures."""

import csv
from array import array
from collections.abc import Callable, Mapping
from dataclasses import asdict, fields
from pathlib import Path
from types import TracebackType
from typing import IO, Protocol, Self, runtime_checkable

import numpy as np

from coclo_vio.datasets.images import encoded
from coclo_vio.values.arrays import Array, ByteImage
from coclo_vio.values.errors import DatasetError, listing
from coclo_vio.values.outputs import KeyframeHealth
from coclo_vio.values.units import MS_PER_S

_COLUMNS = tuple(field.name for field in fields(KeyframeHealth))
_SUMMED = ("tracks", "reprojection_px", "iterations", "compute_s")


class KeyframeWriter:
    """Writes ``<estimator>_keyframes.csv``, a row for each keyframe as it comes, and sums them up.

    Its columns are the fields of ``KeyframeHealth``. Without a keyframe there is no file.
    """

    def __init__(self, folder: Path, estimator: str) -> None:
        self._path = keyframes_path(folder, estimator)
        self._out: IO[str] | None = None
        self._kept = {name: array("d") for name in _SUMMED}

    def write(self, health: KeyframeHealth) -> None:
        """Append one keyframe."""
        if self._out is None:
            self._out = self._path.open("w", encoding="ascii", newline="\n")
            self._out.write(",".join(_COLUMNS) + "\n")
        values = asdict(health)
        self._out.write(
            ",".join(f"{value:.9g}" if isinstance(value, float) else str(value) for value in values.values())
        )
        self._out.write("\n")
        for name, kept in self._kept.items():
            kept.append(values[name])

    def summary(self) -> dict[str, float | None] | None:
        """Their number, and median and 95th percentile of what tells how they fared; None without a keyframe."""
        if self._out is None:
            return None
        told: dict[str, float | None] = {"count": len(self._kept["tracks"])}
        for name, kept in self._kept.items():
            values, label = np.array(kept), name
            if name == "compute_s":
                values, label = values * MS_PER_S, "compute_ms"
            values = values[np.isfinite(values)]
            for suffix, share in (("median", 50.0), ("p95", 95.0)):
                told[f"{label}_{suffix}"] = float(np.percentile(values, share)) if len(values) else None
        return told

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        if self._out is not None:
            self._out.close()


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
    try:
        with path.open(encoding="ascii", newline="") as lines:
            header = next(csv.reader(lines), [])
            table = np.array([[float(cell) for cell in row] for row in csv.reader(lines)])
    except (OSError, ValueError, csv.Error) as error:
        raise DatasetError(f"{path}: {error}; run again, or delete it to do without") from error
    missing = [name for name in _COLUMNS if name not in header]
    if missing or table.ndim != 2 or table.shape[1] != len(header):
        raise DatasetError(f"{path} is malformed ({listing(missing)} missing); run again, or delete it to do without")
    return dict(zip(header, table.T, strict=True))


@runtime_checkable
class HasPictures(Protocol):
    """An estimator that looks at images and can show what it sees in them."""

    def show(self, every: int, take: Callable[[int, ByteImage], None]) -> None:
        """From now on hand on the picture of every n-th frame with its stamp (ns)."""


class PictureWriter:
    """Writes pictures of an estimator's front end to ``debug_images/<estimator>/<stamp in ns>.jpg``."""

    def __init__(self, folder: Path, estimator: str) -> None:
        self._folder = folder / "debug_images" / estimator
        self.written = 0

    def write(self, stamp_ns: int, picture: ByteImage) -> None:
        """Write one."""
        self._folder.mkdir(parents=True, exist_ok=True)
        (self._folder / f"{stamp_ns}.jpg").write_bytes(encoded(picture, "jpeg"))
        self.written += 1
