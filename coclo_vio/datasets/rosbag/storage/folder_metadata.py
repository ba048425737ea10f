# SPDX-License-Identifier: BSD-3-Clause
"""``metadata.yaml`` of a ROS 2 bag: only its compression is needed, the rest is in the files themselves.

It is written when a recording is closed; after a crash it is absent, empty, or that of an earlier recording.
"""

from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path, PurePath
from typing import Any, Literal, cast

from coclo_vio.values.config import read_yaml
from coclo_vio.values.errors import ConfigError, listing

METADATA = "metadata.yaml"
Compression = Literal["none", "file", "message"]
_KEY = "rosbag2_bagfile_information"


@dataclass(frozen=True, slots=True)
class FolderMetadata:
    """What is used of a ``metadata.yaml``.

    Attributes:
        compression: what is compressed by zstd: every file, every message, or nothing.
        messages: how many it says there are; None where it does not.
        notes: sentences on what is wrong with it.
    """

    compression: Compression = "none"
    messages: int | None = None
    notes: tuple[str, ...] = ()


def read_metadata(folder: Path, files: Collection[str]) -> FolderMetadata:
    """The metadata of a folder that holds ``files``, by name; never an error."""
    path = folder / METADATA
    if not path.is_file():
        return FolderMetadata(_by_suffix(files))
    try:
        values = read_yaml(path).get(_KEY)
    except ConfigError as error:
        return FolderMetadata(_by_suffix(files), None, (f"{error}: the files beside it are read as they are",))
    if not isinstance(values, dict):
        note = f"{path} is empty or not that of a bag: the files beside it are read as they are"
        return FolderMetadata(_by_suffix(files), None, (note,))
    mode = str(values.get("compression_mode") or "").lower()
    count = values.get("message_count")
    compression = cast("Literal['file', 'message']", mode) if mode in ("file", "message") else _by_suffix(files)
    return FolderMetadata(compression, count if isinstance(count, int) else None, tuple(_notes(path, values, files)))


def _by_suffix(files: Collection[str]) -> Literal["none", "file"]:
    return "file" if files and all(name.endswith(".zstd") for name in files) else "none"


def _notes(path: Path, values: dict[str, Any], files: Collection[str]) -> list[str]:
    named = values.get("relative_file_paths")
    names = {PurePath(str(name)).name for name in named} if isinstance(named, list) else set()
    notes = []
    if missing := names - set(files):
        notes.append(f"{path} names {listing(missing)}, which is not there: the recording has a gap")
    if more := set(files) - names:
        notes.append(f"{path} does not name {listing(more)}, which is read too")
    return notes
