# SPDX-License-Identifier: BSD-3-Clause
"""A text file that grows by whole lines while a run goes on."""

import errno
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from coclo_vio.values.errors import DatasetError


class LineFile:
    """A file to which whole lines are appended, each block in one write, so that a kill cuts the last line at most.

    A write that fails is taken back: the file ends in the last line that was whole.

    Attributes:
        size: bytes of the whole lines.
    """

    def __init__(self, path: Path, size: int = 0) -> None:
        """Begin a file, or go on after its first ``size`` bytes and drop what follows them.

        Raises:
            OSError: the file cannot be written.
            DatasetError: it has fewer bytes.
        """
        self._path, self.size = path, size
        if size and (not path.is_file() or path.stat().st_size < size):
            raise DatasetError(
                f"{path} has lost lines since its run was checkpointed; begin anew with --overwrite, or choose another "
                "folder with -o"
            )
        self._out = path.open("r+b" if size else "wb", buffering=0)
        self._out.truncate(size)
        self._out.seek(size)

    def append(self, lines: Sequence[str]) -> None:
        """Append lines, each with its newline.

        Raises:
            OSError: they cannot be written, such as on a full disk; names the file.
        """
        data = "".join(lines).encode("utf-8")
        written = 0
        try:
            while written < len(data):
                written += self._out.write(data[written:])
        except OSError as error:
            with suppress(OSError):
                self._out.truncate(self.size)
                self._out.seek(self.size)
            raise OSError(error.errno or errno.EIO, error.strerror or str(error), str(self._path)) from error
        self.size += len(data)

    def close(self) -> None:
        """Close the file."""
        self._out.close()
