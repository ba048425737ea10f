# SPDX-License-Identifier: BSD-3-Clause
"""As much of a compressed chunk as can be unpacked, where it was cut off or damaged."""

import bz2
import sys
from collections.abc import Callable

from lz4.frame import LZ4FrameDecompressor  # type: ignore[import-untyped]

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

_PIECE = 1024  # bytes; at most this much before the damage is lost


def unpacked_prefix(compression: str, data: bytes) -> bytes:
    """What can be unpacked before the data end or turn out damaged.

    Args:
        compression: ``none`` or empty, ``bz2``, ``lz4`` (ROS 1), ``zstd`` (MCAP).
        data: the packed bytes, or the beginning of them.

    Raises:
        ValueError: a compression that is not known.
    """
    if compression in {"", "none"}:
        return data
    decompress = _decompressor(compression)
    unpacked = bytearray()
    for start in range(0, len(data), _PIECE):
        try:
            unpacked += decompress(data[start : start + _PIECE])
        except Exception:  # each library has its own for damaged data
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
    raise ValueError(f"compression {compression!r} is not known; known are none, bz2, lz4 and zstd")
