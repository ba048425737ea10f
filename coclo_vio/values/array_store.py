# SPDX-License-Identifier: BSD-3-Clause
"""Arrays in one block of bytes, each with its layout in memory, and views of one another as views."""

from typing import Any

import numpy as np

from coclo_vio.values.arrays import Array


class ArrayWriter:
    """Collects arrays; whoever shares memory in the program shares it in the block."""

    def __init__(self) -> None:
        self._blocks: list[bytes] = []
        self._numbers: dict[int, int] = {}
        self._kept: list[Array] = []  # so that no other array gets the address of one that was written

    def write(self, array: Array) -> list[Any]:
        """Keep an array; what has to be known to find it again."""
        base = array
        while type(base.base) is np.ndarray:
            base = base.base
        if base.base is not None and not _is_gapless(base):  # a part of the memory of something else
            base = array = array.copy(order="K")
        interface, of_base = array.__array_interface__, base.__array_interface__
        offset = interface["data"][0] - of_base["data"][0] if base is not array else 0
        return [self._block(base), offset, array.dtype.str, array.shape, array.strides, array.flags.writeable]

    def blocks(self) -> list[bytes]:
        """All that was written."""
        return self._blocks

    def _block(self, base: Array) -> int:
        """The number of the memory of an array that owns it."""
        number = self._numbers.get(id(base))
        if number is None:
            number = self._numbers[id(base)] = len(self._blocks)
            self._kept.append(base)
            self._blocks.append(_memory(base))
        return number


def _in_memory(base: Array) -> Array:
    """The array with its axes in the order in which they stand in memory."""
    return base.transpose(np.argsort([-stride for stride in base.strides], kind="stable"))


def _is_gapless(base: Array) -> bool:
    return bool(_in_memory(base).flags.c_contiguous)


def _memory(base: Array) -> bytes:
    """The bytes of an array in the order in which they stand in memory."""
    return _in_memory(base).tobytes() if base.size else b""


class ArrayReader:
    """Finds the arrays again, writable or not as they were."""

    def __init__(self, blocks: list[bytes]) -> None:
        self._memory = [np.array(np.frombuffer(block, dtype=np.uint8)) for block in blocks]

    def read(self, place: list[Any]) -> Array:
        """The array that ``write`` gave this for."""
        number, offset, dtype, shape, strides, is_writable = place
        memory = self._memory[number]
        if not memory.size:
            array: Array = np.empty(shape, dtype)
        else:
            array = np.ndarray(tuple(shape), np.dtype(dtype), memory, offset, tuple(strides))
        array.flags.writeable = is_writable
        return array
