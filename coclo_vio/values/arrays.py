# SPDX-License-Identifier: BSD-3-Clause
"""Array types and the one check that every value makes at its boundary."""

from typing import Any

import numpy as np
import numpy.typing as npt

from coclo_vio.geometry.array_types import Array, BoolArray, ByteImage, IntArray

__all__ = ["Array", "BoolArray", "ByteImage", "IntArray", "checked", "frozen", "read_only"]


def checked(name: str, value: npt.ArrayLike, shape: tuple[int | None, ...], *, allow_nan: bool = False) -> Array:
    """A read-only float64 copy of ``value`` after a check of its shape and finiteness.

    Args:
        name: what the array is called in an error message.
        value: anything NumPy turns into an array.
        shape: the shape it must have; ``None`` where any length will do.
        allow_nan: whether NaN (a reading that is missing) may stand in it. Infinity never may.

    Raises:
        ValueError: the shape is another, or an entry is not finite.
    """
    array = np.array(value, dtype=np.float64)
    fits = array.ndim == len(shape) and all(want in (None, got) for want, got in zip(shape, array.shape, strict=True))
    if not fits:
        wanted = tuple("any" if length is None else length for length in shape)
        raise ValueError(f"{name} must have shape {wanted}, got {array.shape}")
    bad = np.isinf(array) if allow_nan else ~np.isfinite(array)
    if bad.any():
        where = tuple(int(i) for i in np.argwhere(bad)[0])
        raise ValueError(f"{name} must be finite, got {array[where]} at index {where}")
    array.flags.writeable = False
    return array


def read_only(image: ByteImage) -> ByteImage:
    """The same image as a view that cannot be written to; images are too large to be copied at every boundary."""
    view = image.view()
    view.flags.writeable = False
    return view


def frozen(owner: object, name: str, value: Any) -> None:
    """Set a field of a frozen dataclass inside its ``__post_init__``."""
    object.__setattr__(owner, name, value)
