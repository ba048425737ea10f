# SPDX-License-Identifier: BSD-3-Clause
"""Compiled forms of parts of ``Footholds``: feet that turn with the legs, and loads."""

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


@compiled
def load_change(load: Array, standing_load: float, most: float, ratio: Array, is_loaded: BoolArray) -> Array:
    """Change of the load ratio of each foot, (n,): ``stance.load_change``, which says what the arguments are."""
    change = np.zeros(len(load))
    for leg in range(len(load)):
        was_loaded, before = is_loaded[leg], ratio[leg]
        is_loaded[leg] = np.isfinite(load[leg])
        if is_loaded[leg]:
            ratio[leg] = min(max(load[leg] / standing_load, 0.0), most)
            if was_loaded:
                change[leg] = ratio[leg] - before
    return change
