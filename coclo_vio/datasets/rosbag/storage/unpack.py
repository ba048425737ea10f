# SPDX-License-Identifier: BSD-3-Clause
"""The part of a compressed chunk that can be unpacked, where the chunk was cut off or damaged."""

import bz2
import sys
from collections.abc import Callable

from lz4.frame import LZ4FrameDecompressor  # type: ignore[import-untyped]

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

_PIECE = 1024  # bytes; at most this much is lost before the damage


def unpacked_prefix(compression: str, data: bytes) -> bytes:
    """The unpacked data up to the end or the damage.

    Args:
        compression: ``none`` or empty, ``bz2``, ``lz4`` (ROS 1), ``zstd`` (MCAP).
        data: the compressed bytes, or their beginning.

    Raises:
        ValueError: an unknown compression.
    """
    if compression in {"", "none"}:
        return data
    decompress = _decompressor(compression)
    unpacked = bytearray()
    for start in range(0, len(data), _PIECE):
        try:
            unpacked += decompress(data[start : start + _PIECE])
        except Exception:  # each library has its own error for damaged data
            break
    return bytes(unpacked)


def _decompressor(compression: str) -> Callable[[bytes], bytes]:
    match compression:
        case "bz2":
            return bz2.BZ2Decompressor().decompress
        case "lz4":
            return LZ4FrameDecompressor().decompress  # type: ignore[no-any-return]
        case "zstd":
            return zstd.ZstdDecompressor().decompress
    raise ValueError(f"compression {compression!r} is not supported; supported are none, bz2, lz4 and zstd")
