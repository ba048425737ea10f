# SPDX-License-Identifier: BSD-3-Clause
"""Memory through which one process gives stereo images to another: an anonymous file that both map.

It has no name, so that nothing is left of it: the system frees it with the last process that has it open.
"""

import mmap
import os
import tempfile
from dataclasses import dataclass

import numpy as np

from coclo_vio.values.measurements import StereoFrame

_HEADER_BYTES = 64


@dataclass(frozen=True, slots=True)
class SharedFrame:
    """A frame whose images stand one after the other in a slot of the memory.

    Attributes:
        stamp_ns: of the frame, in nanoseconds.
        shape: rows and columns of each image.
        slot: number of the slot.
    """

    stamp_ns: int
    shape: tuple[int, int]
    slot: int


class SharedImages:
    """Slots for stereo frames, written in turn by one process and read in the same order by another.

    Attributes:
        image_bytes: room for one image.
        slots: number of frames that can be on their way.
        descriptor: of the open file, for the other process.
    """

    def __init__(self, image_bytes: int, slots: int, descriptor: int | None = None) -> None:
        """Make the memory, or map that of an open file, which is closed with this object."""
        self.image_bytes, self.slots = image_bytes, slots
        size = _HEADER_BYTES + 2 * image_bytes * slots
        self.descriptor = _anonymous_file(size) if descriptor is None else descriptor
        everything = np.frombuffer(mmap.mmap(self.descriptor, size), dtype=np.uint8)
        self._consumed = everything[:8].view(np.int64)
        self._slots = everything[_HEADER_BYTES:].reshape(slots, 2 * image_bytes)
        self._written = 0

    @property
    def is_full(self) -> bool:
        """Whether no frame can be written before another one is read."""
        return self._written - int(self._consumed[0]) >= self.slots

    def fits(self, frame: StereoFrame) -> bool:
        """Whether the images are small enough."""
        return bool(frame.left.size <= self.image_bytes)

    def write(self, frame: StereoFrame) -> SharedFrame:
        """Put the images of a frame that fits into the next slot, where the memory is not full."""
        slot, size = self._written % self.slots, frame.left.size
        self._slots[slot, :size] = frame.left.reshape(-1)
        self._slots[slot, size : 2 * size] = frame.right.reshape(-1)
        self._written += 1
        rows, columns = frame.left.shape
        return SharedFrame(frame.stamp_ns, (rows, columns), slot)

    def read(self, shared: SharedFrame) -> StereoFrame:
        """The frame with copies of the images; its slot is free then."""
        rows, columns = shared.shape
        both = self._slots[shared.slot, : 2 * rows * columns].reshape(2, rows, columns).copy()
        self._consumed[0] += 1
        return StereoFrame(shared.stamp_ns, both[0], both[1])

    def clear(self) -> None:
        """Forget what was written, once the other process is gone."""
        self._written = 0
        self._consumed[0] = 0

    def __del__(self) -> None:
        if hasattr(self, "descriptor"):
            os.close(self.descriptor)


def _anonymous_file(size: int) -> int:
    """A file without a name: in memory where the system has that, else in the folder of temporary files."""
    if hasattr(os, "memfd_create"):
        descriptor = os.memfd_create("coclo_vio_images")
    else:
        with tempfile.TemporaryFile() as file:
            descriptor = os.dup(file.fileno())
    os.ftruncate(descriptor, size)
    return descriptor
