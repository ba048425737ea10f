# SPDX-License-Identifier: BSD-3-Clause
"""Left and right images of a bag, paired by stamp in one pass and decoded on demand."""

from collections import deque
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from coclo_vio.datasets import images
from coclo_vio.datasets.read_report import ReadTally
from coclo_vio.datasets.rosbag.storage.message_set import MessageSet
from coclo_vio.values.arrays import ByteImage
from coclo_vio.values.errors import DatasetError
from coclo_vio.values.measurements import StereoFrame

_CHANNELS = {"mono8": 1, "8UC1": 1, "bgr8": 3, "rgb8": 3}
_MOST_DIFFERENCES = 1000  # of stamps, for their median
_MAX_HELD = 60  # images of one side that wait for the other side


class RawImage(NamedTuple):
    """An image message that is not yet decoded; images of one time have the same ``match_ns``."""

    stamp_ns: int
    match_ns: int
    topic: str
    data: bytes


class RawPair(NamedTuple):
    """Two image messages of one time."""

    left: RawImage
    right: RawImage

    @property
    def stamp_ns(self) -> int:
        """The time of the left image, ns."""
        return self.left.stamp_ns

    def decoded(self, bag: MessageSet) -> StereoFrame:
        """The two images.

        Raises:
            DatasetError: an unsupported encoding, a damaged image, or two sizes.
        """
        left, right = (decoded_image(bag, image) for image in self)
        if left.shape != right.shape:
            raise DatasetError(
                f"{bag.origin}: the images on {self.left.topic} and {self.right.topic} at {self.stamp_ns} ns have "
                f"{left.shape[1]} x {left.shape[0]} and {right.shape[1]} x {right.shape[0]} pixels; they must agree"
            )
        return StereoFrame(self.stamp_ns, left, right)


class StereoPairer:
    """Pairs images whose stamps are equal within a tolerance; an image without a partner is dropped and counted.

    Where most are dropped a note says how far apart the stamps are, and which setting allows for it.
    """

    def __init__(self, left_topic: str, tolerance_ns: int, tally: ReadTally) -> None:
        self._left_topic = left_topic
        self._tolerance_ns = tolerance_ns
        self._tally = tally
        self._left: deque[RawImage] = deque()
        self._right: deque[RawImage] = deque()
        self._last_ns: dict[bool, int] = {}  # of the images dropped last, by whether they are left ones
        self._apart_ns: list[int] = []  # of images without a partner from the nearest of the other camera
        self._pairs = 0
        self._dropped = 0

    def push(self, image: RawImage) -> Iterator[RawPair]:
        """Add an image of either side; yields the pairs that it completes."""
        side = self._left if image.topic == self._left_topic else self._right
        side.append(image)
        if len(side) > _MAX_HELD:
            self._drop(side)
        while self._left and self._right:
            apart_ns = self._left[0].match_ns - self._right[0].match_ns
            if abs(apart_ns) <= self._tolerance_ns:
                self._pairs += 1
                yield RawPair(self._left.popleft(), self._right.popleft())
            else:
                self._drop(self._without_partner(apart_ns), abs(apart_ns))

    def finish(self) -> None:
        """Count the images that are still without a partner at the end; note how far apart the stamps are."""
        for side in (self._left, self._right):
            while side:
                self._drop(side)
        if not self._apart_ns or self._dropped <= 2 * self._pairs:
            return
        images = self._dropped + 2 * self._pairs
        apart_ms, allowed_ms = float(np.median(self._apart_ns)) / 1e6, self._tolerance_ns / 1e6
        self._tally.note(
            f"left and right images: {2 * self._pairs} of {images} have a partner; the stamps of the others are "
            f"{apart_ms:.4g} ms apart (median), more than the {allowed_ms:.4g} ms of dataset.rosbag.pair_tolerance_s; "
            "increase it if both cameras expose at one time"
        )

    def _without_partner(self, apart_ns: int) -> deque[RawImage]:
        """The side whose first image has no partner: the earlier one, unless its partner came after the other one."""
        earlier, later = (self._left, self._right) if apart_ns < 0 else (self._right, self._left)
        has_partner = any(abs(image.match_ns - earlier[0].match_ns) <= self._tolerance_ns for image in later)
        return later if has_partner else earlier

    def _drop(self, side: deque[RawImage], apart_ns: int | None = None) -> None:
        image = side.popleft()
        is_left = side is self._left
        if apart_ns is not None and len(self._apart_ns) < _MOST_DIFFERENCES:
            before_ns = self._last_ns.get(not is_left)
            self._apart_ns.append(apart_ns if before_ns is None else min(apart_ns, abs(image.match_ns - before_ns)))
        self._last_ns[is_left] = image.match_ns
        self._dropped += 1
        self._tally.dropped[f"{image.topic}: no image of the other camera at this stamp"] += 1


def decoded_image(bag: MessageSet, image: RawImage) -> ByteImage:
    """The grey image (rows, columns) of an Image or CompressedImage message.

    Raises:
        DatasetError: an unsupported encoding, or a damaged image.
    """
    message = bag.decoded(image.topic, image.data)
    where = f"{bag.origin}, the image on {image.topic} at {image.stamp_ns} ns"
    try:
        if not hasattr(message, "encoding"):
            return images.decoded(bytes(message.data), f"{where} ({message.format})")
        return _unpacked(message, where)
    except (AttributeError, TypeError, ValueError, OverflowError) as error:  # of a damaged or foreign definition
        raise DatasetError(f"{where} has other fields than an image: {error}; check the type of the topic") from error


def _unpacked(message: Any, where: str) -> ByteImage:
    """The pixels of a raw Image, whose rows may be padded to ``step`` bytes."""
    channels = _CHANNELS.get(message.encoding)
    if channels is None:
        raise DatasetError(
            f"{where} has the encoding {message.encoding!r}; supported are {', '.join(_CHANNELS)}, all of 8 "
            "bits; convert it, or name other topics in dataset.rosbag.topics"
        )
    rows, columns, data = int(message.height), int(message.width), np.asarray(message.data, dtype=np.uint8)
    step = int(message.step) or columns * channels
    if step < columns * channels or len(data) < rows * step or not rows * columns:
        raise DatasetError(
            f"{where} has {len(data)} bytes for {columns} x {rows} pixels of {channels} bytes in rows of {step} bytes"
        )
    pixels = data[: rows * step].reshape(rows, step)[:, : columns * channels]
    if channels == 1:
        return np.ascontiguousarray(pixels)
    colours = pixels.reshape(rows, columns, channels)
    return images.grey(colours[..., ::-1].copy() if message.encoding == "rgb8" else colours, where)
