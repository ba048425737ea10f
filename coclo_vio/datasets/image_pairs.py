# SPDX-License-Identifier: BSD-3-Clause
"""Stereo image pairs as files: paired by stamp, opened on demand; and the image lists of an EuRoC folder.

``cam<N>/data.csv`` has the columns ``#timestamp [ns]`` and ``filename``; the files are in ``cam<N>/data``.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from coclo_vio.datasets import images
from coclo_vio.datasets.columns import ColumnNames, Header, StampColumn
from coclo_vio.datasets.config import DatasetConfig
from coclo_vio.datasets.csv_table import CsvTable
from coclo_vio.datasets.read_report import ReadTally
from coclo_vio.values.errors import DatasetError, TopicNotFound, listing, shortened
from coclo_vio.values.measurements import StereoFrame

CAMERAS = ("cam0", "cam1")
_MAX_NAMED = 3
_FILE_NAME = "filename"


@dataclass(frozen=True, slots=True)
class ImagePair:
    """Two image files of one stamp, not yet opened."""

    stamp_ns: int
    left: Path
    right: Path

    def decoded(self) -> StereoFrame:
        """The two images.

        Raises:
            DatasetError: a file is not a grey or colour 8-bit image, or the two differ in size; names the file.
        """
        left, right = (images.decoded(read_bytes(path), str(path)) for path in (self.left, self.right))
        if left.shape != right.shape:
            raise DatasetError(
                f"{self.left} has {left.shape[1]} x {left.shape[0]} pixels, {self.right} "
                f"{right.shape[1]} x {right.shape[0]}; the images of a pair must agree"
            )
        return StereoFrame(self.stamp_ns, left, right)


class ImagePairSource(Protocol):
    """The source of a recording's image pairs."""

    def pairs(self, tally: ReadTally, config: DatasetConfig) -> list[ImagePair]:
        """The pairs, not yet opened; ``tally`` counts what is left out.

        Raises:
            DatasetError: the list of images is malformed.
        """


class EurocImagePairs:
    """The image pairs that the lists of two cameras name and whose files exist.

    Only names and stamps are held in memory: about a hundred bytes per pair.
    """

    def __init__(self, mav0: Path, columns: ColumnNames) -> None:
        """Find the columns.

        Raises:
            TopicNotFound: a list lacks a column; lists those it has.
            DatasetError: a list cannot be read.
        """
        self._lists = tuple(_ImageList.open(mav0 / camera / "data.csv", columns) for camera in CAMERAS)

    def pairs(self, tally: ReadTally, config: DatasetConfig) -> list[ImagePair]:
        """The pairs in the order of the left camera's list, or sorted by stamp if so configured.

        Raises:
            DatasetError: a malformed row.
        """
        left, right = self._lists
        right_paths = dict(right.files(tally))
        pairs = []
        left_alone = 0
        for stamp_ns, left_path in left.files(tally):
            right_path = right_paths.pop(stamp_ns, None)
            if right_path is None:
                left_alone += 1
            else:
                pairs.append(ImagePair(stamp_ns, left_path, right_path))
        for label, count in ((left.label, left_alone), (right.label, len(right_paths))):
            if count:
                tally.dropped[f"{label}: no image of the other camera at this stamp"] += count
        return sorted(pairs, key=lambda pair: pair.stamp_ns) if config.sort else pairs


@dataclass(frozen=True, slots=True)
class _ImageList:
    """One camera's ``data.csv``."""

    table: CsvTable
    label: str
    stamp: StampColumn
    name_column: int

    @classmethod
    def open(cls, path: Path, columns: ColumnNames) -> "_ImageList":
        table = CsvTable.open(path, ends_in_text=True)
        stamp = Header(path, table.header, columns).stamp()
        if _FILE_NAME not in table.header:
            raise TopicNotFound(f"{path} has no column {_FILE_NAME}; the columns are {listing(table.header)}")
        return cls(table, f"{path.parent.name}/{path.name}", stamp, table.header.index(_FILE_NAME))

    def files(self, tally: ReadTally) -> Iterator[tuple[int, Path]]:
        """Stamp and path of every row whose file exists."""
        folder = self.table.path.parent / "data"
        absent: list[str] = []
        for row in self.table.rows():
            stamp_ns, name = self.stamp.read(row), row.text(self.name_column)
            if stamp_ns is None or not name:
                tally.dropped[f"{self.label}: row without a stamp or a file name"] += 1
            elif not _is_file(folder / name):
                absent.append(name)
            else:
                yield stamp_ns, folder / name
        if self.table.has_cut_line:
            tally.dropped[f"{self.label}: last line cut off"] += 1
        if absent:
            tally.dropped[f"{self.label}: image file is missing"] += len(absent)
            more = ", ..." if len(absent) > _MAX_NAMED else ""
            named = ", ".join(map(shortened, absent[:_MAX_NAMED])) + more
            tally.note(f"{self.label} names {len(absent)} images whose files are missing: {named}")


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except OSError:  # a name that is too long
        return False


def read_bytes(path: Path) -> bytes:
    """The whole file.

    Raises:
        DatasetError: it cannot be read.
    """
    try:
        return path.read_bytes()
    except OSError as error:
        raise DatasetError(f"cannot read the image {path}: {error.strerror}") from error
