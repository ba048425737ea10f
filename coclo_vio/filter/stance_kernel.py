# SPDX-License-Identifier: BSD-3-Clause
"""Compiled form of the part of ``Footholds`` that turns with the legs."""

import numpy as np

from coclo_vio.geometry.array_types import Array, BoolArray
from coclo_vio.geometry.compiled import compiled
from coclo_vio.geometry.so3_kernels import set_log, set_product_transposed


@compiled
def turns_of(holds: BoolArray, rotation: Array, before: Array) -> Array:
    """Rotation vectors (n, 3) from earlier to later rotations of the feet (n, 3, 3): ``stance.turns_of``."""
    turns, relative = np.zeros((len(holds), 3)), np.empty((3, 3))
    for leg in range(len(holds)):
        if holds[leg]:
            set_product_transposed(relative, rotation[leg], before[leg])
            set_log(turns[leg], relative)
    return turns
