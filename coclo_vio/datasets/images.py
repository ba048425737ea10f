# SPDX-License-Identifier: BSD-3-Clause
"""Encoding and decoding of grey 8-bit images as PNG or JPEG. The only importer of cv2 among the readers."""

from typing import Any, Literal

import cv2
import numpy as np
import numpy.typing as npt

from coclo_vio.values.arrays import ByteImage
from coclo_vio.values.errors import DatasetError

ImageEncoding = Literal["png", "jpeg"]

_SUFFIXES: dict[ImageEncoding, str] = {"png": ".png", "jpeg": ".jpg"}
_TO_GREY = {3: cv2.COLOR_BGR2GRAY, 4: cv2.COLOR_BGRA2GRAY}

# OpenCV would print its own warnings on damaged files to standard error.
cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_ERROR)


def suffix_of(encoding: ImageEncoding) -> str:
    """The file name suffix of an encoding."""
    return _SUFFIXES[encoding]


def encoded(image: ByteImage, encoding: ImageEncoding) -> bytes:
    """A grey image (rows, columns) as an image file: PNG is lossless, JPEG has quality 95.

    Raises:
        DatasetError: the image is empty, or its type cannot be encoded.
    """
    try:
        done, data = cv2.imencode(_SUFFIXES[encoding], image)
    except cv2.error as error:
        raise DatasetError(f"cannot write an image of {image.shape} {image.dtype} as {encoding}") from error
    if not done:
        raise DatasetError(f"cannot write an image of {image.shape} {image.dtype} as {encoding}")
    return data.tobytes()


def decoded(data: bytes, source: str) -> ByteImage:
    """The grey image (rows, columns) in an image file; colour is converted to grey.

    Args:
        data: the whole file, in any encoding that OpenCV reads.
        source: its origin, for error messages.

    Raises:
        DatasetError: not an image, a file that was cut off, or more than 8 bits per channel.
    """
    try:
        image = cv2.imdecode(np.frombuffer(data, dtype=np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error:  # an empty file
        image = None
    if image is None:
        raise DatasetError(f"{source} cannot be decoded as an image ({len(data)} bytes); check whether it was cut off")
    return grey(np.asarray(image), source)


def grey(image: npt.NDArray[np.integer[Any] | np.floating[Any]], source: str) -> ByteImage:
    """An 8-bit image in OpenCV's order of channels (grey, BGR or BGRA) as a grey one (rows, columns).

    Raises:
        DatasetError: more than 8 bits per channel, or another number of channels.
    """
    if image.dtype != np.uint8:
        raise DatasetError(
            f"{source} has pixels of {image.dtype}, only 8-bit images are read: convert the images to 8 bits first, "
            "with the scaling of your choice"
        )
    if image.ndim == 2:
        return image.astype(np.uint8, copy=False)
    channels = image.shape[2]
    if channels not in _TO_GREY:
        raise DatasetError(
            f"{source} has {channels} channels; supported are 1 (grey), 3 (colour) and 4 (colour with alpha)"
        )
    return np.asarray(cv2.cvtColor(image, _TO_GREY[channels]))
