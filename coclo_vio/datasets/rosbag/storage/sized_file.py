# SPDX-License-Identifier: BSD-3-Clause
"""Files for the readers of ``rosbags`` that never reserve more memory than the file has bytes.

A damaged length of four gigabytes would otherwise be reserved before the end of the file is found.
"""

import io
import os
from pathlib import Path, PurePath
from typing import Any, BinaryIO

_SMALL = 2**16


class SizedFile(io.BufferedReader):
    """A binary file, open for reading."""

    def __init__(self, path: Path) -> None:
        super().__init__(io.FileIO(path))
        self._size = os.fstat(self.fileno()).st_size

    def read(self, size: int | None = -1, /) -> bytes:
        """At most ``size`` bytes, and no more than are left."""
        if size is None or size < 0 or size > _SMALL:
            left = max(0, self._size - self.tell())
            size = left if size is None or size < 0 else min(size, left)
        return super().read(size)


class SizedPath:
    """A path whose ``open`` gives a ``SizedFile``; the part of ``Path`` that ``rosbags`` uses."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def exists(self) -> bool:
        """Whether it exists."""
        return self._path.exists()

    def is_dir(self) -> bool:
        """Whether it is a folder."""
        return self._path.is_dir()

    def open(self, *_args: Any, **_kwargs: Any) -> BinaryIO:
        """The file, binary."""
        return SizedFile(self._path)

    def read_text(self, encoding: str | None = None) -> str:
        """The whole file as text."""
        return self._path.read_text(encoding)

    def stat(self, *, follow_symlinks: bool = True) -> os.stat_result:
        """Its size."""
        return self._path.stat(follow_symlinks=follow_symlinks)

    def __truediv__(self, key: "SizedPath | PurePath | str") -> "SizedPath":
        return SizedPath(self._path / str(key))

    def __str__(self) -> str:
        return str(self._path)

    @property
    def stem(self) -> str:
        """The name without suffix."""
        return self._path.stem

    @property
    def suffix(self) -> str:
        """The suffix of the name."""
        return self._path.suffix
