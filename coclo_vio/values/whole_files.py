# SPDX-License-Identifier: BSD-3-Clause
"""Files that are whole at any moment, and the whole lines of those that are not.

A file that is replaced is written beside its place and moved there at the end, so whoever reads it gets the earlier one
or the new one. A file that grows may end in a line that was cut short, by a kill or a full disk: only a line without
its newline can be one, and it can only be the last.
"""

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import NamedTuple


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A place to write a file that replaces the one at ``path`` once it is whole; an error leaves that one as it was.

    Raises:
        OSError: the file cannot be written.
    """
    beside = path.with_name(f"{path.name}.part")
    try:
        yield beside
        beside.replace(path)
    except BaseException:
        with suppress(OSError):
            beside.unlink(missing_ok=True)
        raise


def write_whole(path: Path, content: str | bytes) -> None:
    """Replace a file by this content, text as UTF-8.

    Raises:
        OSError: the file cannot be written.
    """
    with replacing(path) as beside:
        beside.write_bytes(content.encode("utf-8") if isinstance(content, str) else content)


class WholeLines(NamedTuple):
    """The lines of a text file.

    Attributes:
        lines: those that end in a newline, without it.
        cut: what follows the last newline; empty where nothing does.
    """

    lines: list[str]
    cut: str

    @classmethod
    def read(cls, path: Path) -> "WholeLines":
        """Of a file in UTF-8. Zero bytes at the end, which a loss of power may leave, count as nothing.

        Raises:
            OSError: the file cannot be read.
            ValueError: a whole line is not UTF-8.
        """
        whole, newline, cut = path.read_bytes().rstrip(b"\0").rpartition(b"\n")
        half_letter = "replace" if newline else "strict"  # a cut may go through a letter, where there are lines at all
        return cls((whole + newline).decode("utf-8").splitlines(), cut.decode("utf-8", errors=half_letter))

    def cut_note(self, path: Path) -> str | None:
        """A sentence on the cut line that is left out, None where there is none."""
        if not self.cut:
            return None
        return f"the last line of {path.name}, line {len(self.lines) + 1}, was cut short and is left out"
