# SPDX-License-Identifier: BSD-3-Clause
"""Compressed chunks unpacked within bounds, whole or, where one was cut off or damaged, as far as it can be."""

import bz2
import sys
from typing import Any

from lz4.frame import LZ4FrameDecompressor  # type: ignore[import-untyped]

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

__all__ = ["MOST_UNPACKED", "check_size", "unpacked", "unpacked_prefix", "zstd"]

MOST_UNPACKED = 128 * 2**20
"""Bytes of one chunk; recorders close a chunk of a few megabytes, and 48 kB can expand to gigabytes."""

_UNSUSPICIOUS = 16 * 2**20  # bytes of a chunk that may expand any number of times
_MOST_TIMES = 200  # a larger one; images of one colour expand so, joint names a hundred times
_PIECE = 1024  # bytes; at most this much is lost before the damage


def check_size(size: int) -> None:
    """Check the size of a chunk, or of a message.

    Raises:
        ValueError: it is larger than ``MOST_UNPACKED``.
    """
    if size > MOST_UNPACKED:
        raise ValueError(
            f"a chunk of {size / 2**20:.0f} MB is larger than the {MOST_UNPACKED // 2**20} MB that are read"
        )


def unpacked(compression: str, data: bytes, size: int | None) -> bytes:
    """A whole chunk.

    Args:
        compression: ``none`` or empty, ``bz2``, ``lz4``, ``zstd``.
        data: the compressed bytes.
        size: the size of the result as recorded; None where it is not.

    Raises:
        ValueError: an unknown compression, damaged data, or a result that is too large or not of that size.
    """
    check_size(max(len(data), size or 0))
    if compression in {"", "none"}:
        return data
    most = _limit(data) if size is None else size
    if most > _limit(data):
        raise ValueError(
            f"a chunk of {len(data)} bytes expands to {most / 2**20:.0f} MB, more than {_MOST_TIMES} times"
        )
    parts, length = [], 0
    while data and length <= most:
        frame = _decompressor(compression)
        part = _of_frame(frame, data, most + 1 - length)
        parts.append(part)
        length += len(part)
        if not frame.eof:
            break
        data = frame.unused_data or b""
    if length > most or (size is not None and length != size):
        raise ValueError(f"a chunk of {compression} does not unpack to its recorded size of {most} bytes")
    return parts[0] if len(parts) == 1 else b"".join(parts)


def unpacked_prefix(compression: str, data: bytes) -> bytes:
    """The unpacked data up to the end, the damage, or the limit.

    Args:
        compression: ``none`` or empty, ``bz2``, ``lz4`` (ROS 1), ``zstd`` (MCAP).
        data: the compressed bytes, or their beginning.

    Raises:
        ValueError: an unknown compression.
    """
    if compression in {"", "none"}:
        return data
    frame = _decompressor(compression)
    unpacked, most = bytearray(), _limit(data)
    for start in range(0, len(data), _PIECE):
        try:
            unpacked += frame.decompress(data[start : start + _PIECE], most + 1 - len(unpacked))
        except Exception:  # each library has its own error for damaged data
            break
        if len(unpacked) > most:
            break
    return bytes(unpacked)


def _limit(data: bytes) -> int:
    """How many bytes packed data may expand to."""
    return min(MOST_UNPACKED, max(_UNSUSPICIOUS, _MOST_TIMES * len(data)))


def _of_frame(frame: Any, data: bytes, most: int) -> bytes:
    """At most so many bytes of one frame."""
    parts, left = [], most
    while left > 0:
        try:
            part = frame.decompress(data, left)
        except Exception as error:  # each library has its own error for damaged data
            raise ValueError(f"a chunk cannot be unpacked: {error}") from error
        data = b""
        parts.append(part)
        left -= len(part)
        if frame.eof or not part:
            break
    return parts[0] if len(parts) == 1 else b"".join(parts)


def _decompressor(compression: str) -> Any:
    """An object with ``decompress``, ``eof`` and ``unused_data`` of one frame."""
    match compression:
        case "bz2":
            return bz2.BZ2Decompressor()
        case "lz4":
            return LZ4FrameDecompressor()
        case "zstd":
            return zstd.ZstdDecompressor()
    raise ValueError(f"compression {compression!r} is not supported; supported are none, bz2, lz4 and zstd")
