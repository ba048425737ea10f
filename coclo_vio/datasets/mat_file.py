# SPDX-License-Identifier: BSD-3-Clause
"""MATLAB files through SciPy: names first, then only the requested arrays.

SciPy raises a different exception for each kind of damage, and silently drops arrays that were cut off at the end.
"""

from collections.abc import Iterable
from pathlib import Path

import numpy as np
import scipy.io

from coclo_vio.values.arrays import Array
from coclo_vio.values.errors import DatasetError, listing

_NEXT_STEP = "only MATLAB files up to version 7 are read: save it again with -v7, or copy it again if it was cut off"


def variable_names(path: Path) -> tuple[str, ...]:
    """The names of the arrays in a MATLAB file.

    Raises:
        DatasetError: no such file, or it cannot be read.
    """
    try:
        return tuple(name for name, _, _ in scipy.io.whosmat(path, appendmat=False))
    except Exception as error:
        raise _unreadable(path, error) from error


def read_arrays(path: Path, names: Iterable[str]) -> dict[str, Array]:
    """Arrays of numbers by name; the other arrays of the file are not loaded.

    Raises:
        DatasetError: an array is missing or does not hold real numbers, or the file cannot be read.
    """
    requested = list(names)
    try:
        found = scipy.io.loadmat(path, variable_names=requested, appendmat=False)
    except Exception as error:
        raise _unreadable(path, error) from error
    missing = [name for name in requested if name not in found]
    if missing:
        raise DatasetError(f"{path} has no {listing(missing)}, or was cut off before it; {_NEXT_STEP}")
    dtypes = {name: np.asarray(found[name]).dtype for name in requested}
    for name, dtype in dtypes.items():
        if dtype.kind not in "fiu":
            raise DatasetError(f"{path}: {name} must be an array of real numbers, it holds {dtype}")
    return {name: np.asarray(found[name], dtype=np.float64) for name in requested}


def _unreadable(path: Path, error: Exception) -> DatasetError:
    reason = error.strerror if isinstance(error, OSError) and error.strerror else f"{error}"
    return DatasetError(f"cannot read the MATLAB file {path} ({reason}); {_NEXT_STEP}")
