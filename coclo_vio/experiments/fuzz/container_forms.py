# SPDX-License-Identifier: BSD-3-Clause
"""Other forms of bags, made by hand: chunks that are not compressed, and small chunks that expand to very much.

Changes of a compressed chunk are found by its checksum or its decompressor; those of a plain one reach the records.
"""

import bz2
import struct

import lz4.frame  # type: ignore[import-untyped]

from coclo_vio.datasets.rosbag.storage.unpack import unpacked_prefix

_BAG_MAGIC = b"#ROSBAG V2.0\n"
_MCAP_MAGIC = b"\x89MCAP0\r\n"
_HEADER, _FOOTER, _CHUNK, _DATA_END = 0x01, 0x02, 0x06, 0x0F
_BLOCK = 128 * 1024  # bytes, the longest block of zstd
EXPANDED = 1_500_000_000  # bytes of a chunk that expands


def plain_bag(data: bytes) -> bytes:
    """A ROS 1 bag of one chunk with that chunk not compressed; its index stays valid."""
    head, start = _record(data, len(_BAG_MAGIC))
    fields, after = _record(data, start)
    compression = _field(fields[0], b"compression")
    plain = unpacked_prefix(compression.decode(), fields[1])
    header = _fields({b"op": b"\x05", b"compression": b"none", b"size": struct.pack("<I", len(plain))})
    chunk = _sized(header) + _sized(plain)
    shift = len(chunk) - (after - start)
    index = struct.unpack("<Q", _field(head[0], b"index_pos"))[0] + shift
    at = head[0].index(b"index_pos=") + len(b"index_pos=")
    moved = head[0][:at] + struct.pack("<Q", index) + head[0][at + 8 :]
    return _BAG_MAGIC + _sized(moved) + _sized(head[1]) + chunk + data[after:]


def expanding_bag(compression: str) -> bytes:
    """A ROS 1 bag without index whose chunk (``bz2``, ``lz4``) expands to hundreds of megabytes of zeros."""
    zeros = bytes(EXPANDED // 4 if compression == "lz4" else EXPANDED // 20)
    packed = lz4.frame.compress(zeros) if compression == "lz4" else bz2.compress(zeros) * 20
    size = struct.pack("<I", EXPANDED)
    header = _fields({b"op": b"\x05", b"compression": compression.encode(), b"size": size})
    counts = {b"conn_count": bytes(4), b"chunk_count": b"\x01\0\0\0", b"index_pos": bytes(8)}
    head = _fields({b"op": b"\x03", **counts})
    return _BAG_MAGIC + _sized(head) + _sized(b" " * 64) + _sized(header) + _sized(packed)


def plain_mcap(data: bytes) -> bytes:
    """An MCAP file without index, with chunks that are not compressed and have no checksum."""
    records = []
    at = len(_MCAP_MAGIC)
    while True:
        op, size = struct.unpack_from("<BQ", data, at)
        body = data[at + 9 : at + 9 + size]
        at += 9 + size
        if op == _DATA_END:
            break
        records.append(_mcap_record(op, _plain_chunk(body) if op == _CHUNK else body))
    return _closed(b"".join(records))


def expanding_mcap(data: bytes) -> bytes:
    """The beginning of an MCAP file and a chunk of 48 kB that expands to 1.5 GB."""
    size = struct.unpack_from("<BQ", data, len(_MCAP_MAGIC))[1]
    head = data[len(_MCAP_MAGIC) : len(_MCAP_MAGIC) + 9 + size]
    blocks = EXPANDED // _BLOCK
    # A frame of blocks that each repeat one byte (RFC 8878): magic, no size, a window of 128 kB.
    frame = b"\x28\xb5\x2f\xfd\x00\x38" + b"".join(
        struct.pack("<I", _BLOCK << 3 | 1 << 1 | int(i == blocks - 1))[:3] + b"\0" for i in range(blocks)
    )
    chunk = struct.pack("<QQQI", 0, 2**62, blocks * _BLOCK, 0) + _sized(b"zstd") + struct.pack("<Q", len(frame)) + frame
    return _closed(head + _mcap_record(_CHUNK, chunk))


def _plain_chunk(body: bytes) -> bytes:
    start, end, size, _ = struct.unpack_from("<QQQI", body)
    length = struct.unpack_from("<I", body, 28)[0]
    compression = body[32 : 32 + length].decode()
    plain = unpacked_prefix(compression, body[40 + length :])
    return struct.pack("<QQQI", start, end, size, 0) + _sized(b"") + struct.pack("<Q", len(plain)) + plain


def _mcap_record(op: int, body: bytes) -> bytes:
    return struct.pack("<BQ", op, len(body)) + body


def _closed(records: bytes) -> bytes:
    end = _mcap_record(_DATA_END, bytes(4)) + _mcap_record(_FOOTER, bytes(20))
    return _MCAP_MAGIC + records + end + _MCAP_MAGIC


def _record(data: bytes, at: int) -> tuple[tuple[bytes, bytes], int]:
    """Header and data of a record of a ROS 1 bag, and where the next begins."""
    parts = []
    for _ in range(2):
        length = struct.unpack_from("<I", data, at)[0]
        parts.append(data[at + 4 : at + 4 + length])
        at += 4 + length
    return (parts[0], parts[1]), at


def _field(header: bytes, name: bytes) -> bytes:
    at = header.index(name + b"=")
    length = struct.unpack_from("<I", header, at - 4)[0]
    return header[at + len(name) + 1 : at + length]


def _fields(values: dict[bytes, bytes]) -> bytes:
    return b"".join(_sized(name + b"=" + value) for name, value in values.items())


def _sized(data: bytes) -> bytes:
    return struct.pack("<I", len(data)) + data
