# SPDX-License-Identifier: BSD-3-Clause
"""From the load on a foot to a probability of contact."""

import numpy as np
from scipy.special import expit

from coclo_vio.values.arrays import Array


def paper_probability(load: Array, span: float) -> Array:
    """``|F| / (|Fmax| - |Fmin|)`` clipped to 0..1, (legs,) from a load (legs,) (paper, section III-D).

    The paper leaves open what happens above 1 (here clipped), that the ratio passes 1 already at Fmax - Fmin and is
    not 0 at Fmin, and over what time the two extremes are recorded: here they are configuration.
    """
    return np.clip(load / span, 0.0, 1.0)


def logistic_probability(load: Array, centre: float, width: float) -> Array:
    """``1 / (1 + exp(-(F - centre) / width))``, (legs,): grows with the load, 0.5 at the centre."""
    return np.asarray(expit((load - centre) / width), dtype=np.float64)
