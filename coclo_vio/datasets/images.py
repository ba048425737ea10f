# SPDX-License-Identifier: BSD-3-Clause
"""Image files in memory: grey 8-bit images to PNG or JPEG and back. The only importer of cv2 among the readers."""

from typing import Any, Literal

import cv2
import numpy as np
import numpy.typing as npt

from coclo_vio.values.arrays import ByteImage
from coclo_vio.values.errors import DatasetError

ImageEncoding = Literal["png", "jpeg"]

_SUFFIXES: dict[ImageEncoding, str] = {"png": ".png", "jpeg": ".jpg"}
_TO_GREY = {3: cv2.COLOR_BGR2GRAY, 4: cv2.COLOR_BGRA2GRAY}

# What OpenCV has to say of a broken file would stand between the lines of ours.
cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_ERROR)


def suffix_of(encoding: ImageEncoding) -> str:
    """How the name of such a file ends."""
    return _SUFFIXES[encoding]


def encoded(image: ByteImage, encoding: ImageEncoding) -> bytes:
    """The file of a grey image (rows, columns): PNG keeps every pixel, JPEG (quality 95) does not.

    Raises:
        DatasetError: the image is empty or not of a kind that can be written.
    """
    try:
        done, data = cv2.imencode(_SUFFIXES[encoding], image)
    except cv2.error as error:
        raise DatasetError(f"cannot write an image of {image.shape} {image.dtype} as {encoding}") from error
    if not done:
        raise DatasetError(f"cannot write an image of {image.shape} {image.dtype} as {encoding}")
    return data.tobytes()


def decoded(data: bytes, source: str) -> ByteImage:
    """The grey image (rows, columns) in an image file; colours are turned to grey.

    Args:
        data: the whole file, of any kind that OpenCV reads.
        source: where it is from, for an error message.

    Raises:
        DatasetError: no image, one that was cut off, or one of more than 8 bits a channel.
    """
    try:
        image = cv2.imdecode(np.frombuffer(data, dtype=np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error:  # of an empty file
        image = None
    if image is None:
        raise DatasetError(f"{source} is no image that can be read ({len(data)} bytes); was it cut off?")
    return grey(np.asarray(image), source)


def grey(image: npt.NDArray[np.integer[Any] | np.floating[Any]], source: str) -> ByteImage:
    """An 8-bit image in OpenCV's order of channels (grey, BGR or BGRA) as a grey one (rows, columns).

    Raises:
        DatasetError: more than 8 bits a channel, or another number of channels.
    """
    if image.dtype != np.uint8:
        raise DatasetError(
            f"{source} has pixels of {image.dtype}, only 8-bit images are read: how its range becomes 0..255 is "
            "for you to say; convert the images first"
        )
    if image.ndim == 2:
        return image.astype(np.uint8, copy=False)
    channels = image.shape[2]
    if channels not in _TO_GREY:
        raise DatasetError(f"{source} has {channels} channels; grey, colour and colour with alpha are read")
    return np.asarray(cv2.cvtColor(image, _TO_GREY[channels]))
