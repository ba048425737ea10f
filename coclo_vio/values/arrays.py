# SPDX-License-Identifier: BSD-3-Clause
"""Array types, and the check of arrays that every value makes when it is constructed."""

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from coclo_vio.geometry.array_types import Array, BoolArray, ByteImage, FloatImage, IntArray

__all__ = [
    "Array",
    "BoolArray",
    "ByteImage",
    "FloatImage",
    "IntArray",
    "checked",
    "frozen",
    "has_nan",
    "is_finite",
    "read_only",
]

_ANY_VECTOR = (None,)


def checked(name: str, value: npt.ArrayLike, shape: tuple[int | None, ...], *, allow_nan: bool = False) -> Array:
    """A read-only float64 copy of ``value`` after a check of its shape and finiteness.

    Args:
        name: of the array, for error messages.
        value: anything that NumPy converts to an array.
        shape: expected shape; ``None`` for any length.
        allow_nan: whether entries may be NaN (missing readings). Infinity is refused always.

    Raises:
        ValueError: the shape differs, or an entry is not finite.
    """
    array = np.array(value, dtype=np.float64)
    if array.shape != shape and not _has_shape(array.shape, shape):
        expected_shape = tuple("any" if length is None else length for length in shape)
        raise ValueError(f"{name} must have shape {expected_shape}, got {array.shape}")
    if not is_finite(array):
        is_invalid = np.isinf(array) if allow_nan else ~np.isfinite(array)
        if is_invalid.any():
            index = tuple(int(i) for i in np.argwhere(is_invalid)[0])
            raise ValueError(f"{name} must be finite, got {array[index]} at index {index}")
    array.setflags(write=False)
    return array


def _has_shape(actual: tuple[int, ...], expected: tuple[int | None, ...]) -> bool:
    if expected == _ANY_VECTOR:  # by far the most frequent
        return len(actual) == 1
    return len(actual) == len(expected) and all(
        wanted is None or wanted == length for wanted, length in zip(expected, actual, strict=True)
    )


def is_finite(array: Array) -> bool:
    """Whether every entry is finite; several times faster than ``isfinite().all()`` where no square overflows."""
    return math.isfinite(np.vdot(array, array)) or bool(np.isfinite(array).all())


def has_nan(array: Array) -> bool:
    """Whether an array without infinite entries has one that is NaN; several times faster than ``isnan().any()``."""
    return math.isnan(np.vdot(array, array))


def read_only(image: ByteImage) -> ByteImage:
    """A read-only view of an image; images are too large to copy for every value."""
    view = image.view()
    view.flags.writeable = False
    return view


def frozen(owner: object, name: str, value: Any) -> None:
    """Set a field of a frozen dataclass inside its ``__post_init__``."""
    object.__setattr__(owner, name, value)
