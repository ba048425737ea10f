# SPDX-License-Identifier: BSD-3-Clause
"""Names for NumPy arrays of one element type; ``values.arrays`` re-exports them."""

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]
ByteImage = npt.NDArray[np.uint8]
FloatImage = npt.NDArray[np.float32]
