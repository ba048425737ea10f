# SPDX-License-Identifier: BSD-3-Clause
"""Few constants from many values that are linear in them, some of which are wrong: robust recursive least squares.

Batches come one after the other; the constants have a normal prior about zero that is never forgotten, the values are.
The spread of the values is learnt. Weights are Cauchy's: 95 % efficient where errors are normal.
Source: Holland and Welsch, "Robust regression using iteratively reweighted least-squares", 1977.
"""

import numpy as np

from coclo_vio.geometry.array_types import Array

_ITERATIONS = 4
_TAIL = 2.385  # of Cauchy's weight, in sigmas
_MEDIAN_OF_NORMAL = 0.6745  # of absolute values, in sigmas
_KNOWN_SIGMA = 1e-9  # least of a constant: one that is known to be zero stays there
_FEW = 4  # values whose spread shows nothing


class RecursiveRegression:
    """The constants by all values so far.

    Attributes:
        estimate: the constants, (k,).
        sigma: of a value, as learnt.
    """

    def __init__(self, prior_sigmas: Array, sigma: float, least_sigma: float, memory: float) -> None:
        """Take what is known before.

        Args:
            prior_sigmas: of the constants, 0 for one that is known to be zero, (k,).
            sigma: of a value at first.
            least_sigma: of a value; errors that values have in common do not show in their spread.
            memory: values are forgotten after about so many.
        """
        self.estimate: Array = np.zeros(len(prior_sigmas))
        self.sigma = sigma
        self._least_sigma, self._memory = least_sigma, memory
        self._prior = np.diag(1.0 / np.square(np.maximum(prior_sigmas, _KNOWN_SIGMA)))
        self._information, self._vector = np.zeros_like(self._prior), np.zeros(len(prior_sigmas))

    @property
    def sigmas(self) -> Array:
        """One sigma of each constant, (k,)."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    @property
    def covariance(self) -> Array:
        """Of the constants, (k, k)."""
        return np.asarray(np.linalg.inv(self._prior + self._information))

    def learn(self, rows: Array, values: Array, added: Array | None = None) -> None:
        """Take a batch.

        Args:
            rows: derivatives of the values by the constants, (N, k).
            values: (N,).
            added: one sigma of each value beyond ``sigma``, (N,); None for none.
        """
        if not len(values):
            return
        kept = float(np.exp(-len(values) / self._memory))
        information, vector, estimate = kept * self._information, kept * self._vector, self.estimate
        sigmas = np.hypot(self.sigma, np.zeros(len(values)) if added is None else added)
        for _ in range(_ITERATIONS):
            off = (values - rows @ estimate) / sigmas
            weighted = rows.T / ((1.0 + np.square(off / _TAIL)) * np.square(sigmas))
            self._information, self._vector = information + weighted @ rows, vector + weighted @ values
            estimate = np.asarray(np.linalg.solve(self._prior + self._information, self._vector))
        self.estimate = estimate
        if len(values) >= _FEW:
            spread = self.sigma * float(np.median(np.abs(values - rows @ estimate) / sigmas)) / _MEDIAN_OF_NORMAL
            self.sigma = max(kept * self.sigma + (1.0 - kept) * spread, self._least_sigma)
