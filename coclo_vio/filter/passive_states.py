# SPDX-License-Identifier: BSD-3-Clause
"""What the filter knows of passive states (remembered poses, cameras) between the frames that use them.

Neither process nor measurements touch these states: prediction leaves them as they are, and an update reaches them
through their correlations alone. So prediction and update run on the active states, and the passive ones follow by
products. With ``a`` the active and ``p`` the passive errors, ``C = P_ap``, ``F`` the transition of the step, ``H`` the
measurement's Jacobian, ``S`` the innovation covariance and ``nu`` the innovation:

    prediction   C <- F C
    update       Z = C^T H^T S^(-T/2),  p <- p + Z S^(-1/2) nu,  C <- C - K S^(1/2) Z^T,  P_pp <- P_pp - Z Z^T

This is the compressed filter of Guivant and Nebot (2001), whose passive block follows the product of all ``F`` and
``I - K H`` (so do the clones of Roumeliotis and Burdick, 2002). The product is multiplied into ``C`` at once: where
the passive states are fewer than the active ones that is less work than to accumulate it, and their means are current.

``F`` and ``H`` are those of the sigma points. With the factor ``P_aa = L L^T`` the first rows ``A`` of
``SigmaSpread.rows`` (odd halves and flat columns) are ``A = (F L)^T``, so that ``F C = A^T (L^-1 C)``, and the same for
``H``. The gain ``K`` is the optimal one also where active states are only considered (Schmidt): with an optimal gain of
the passive states, that of the active ones has no part in ``C`` and ``P_pp``.
"""

import numpy as np
from scipy.linalg import blas

from coclo_vio.filter.unscented_transform import lower_factor
from coclo_vio.values.arrays import Array

_SINGULAR = 1e-13  # share of a row's norm on the diagonal below which the factor has no inverse


class PassiveStates:
    """Covariance of the passive errors, among each other and with the active ones.

    Attributes:
        cross: ``P_ap``, (a, p).
        own: ``P_pp``, (p, p).
    """

    def __init__(self, cross: Array, own: Array) -> None:
        self.cross, self.own = cross, own

    @classmethod
    def of_factor(cls, factor: Array, active: int) -> "PassiveStates":
        """From a lower factor (L, L) of all errors, the active ones first."""
        passive = factor[active:]
        return cls(factor[:active, :active] @ passive[:, :active].T, passive @ passive.T)

    def __len__(self) -> int:
        """Number of passive errors."""
        return len(self.own)

    def predict(self, factor: Array, rows: Array) -> None:
        """Follow a prediction of the active errors.

        Args:
            factor: lower factor before it, (a, a).
            rows: the first rows of the prediction's ``SigmaSpread.rows``, (a, a).
        """
        self.cross = rows.T @ self._whitened(factor)

    def observed(self, factor: Array, rows: Array) -> Array:
        """Cross covariance ``H P_ap`` with a measurement, (M, p), of the first of its rows, (a, M)."""
        return rows.T @ self._whitened(factor)

    def correct(self, observed: Array, triangle: Array, whitened: Array) -> Array:
        """Follow an update of the active errors; returns the correction of the passive ones, (p,).

        Args:
            observed: as ``observed`` returned it, (M, p).
            triangle: of the update's array (``unscented_transform.correct``), (M, M + a) or more rows.
            whitened: the innovation in units of its factor, (M,).
        """
        width = len(whitened)
        gains = self.gains(observed, triangle, width)
        self.cross = self.cross - triangle[:width, width:].T @ gains
        self.own = self.own - gains.T @ gains
        return np.asarray(whitened @ gains)

    @staticmethod
    def gains(observed: Array, triangle: Array, width: int) -> Array:
        """Optimal gains of the passive errors in units of the innovation, ``S_y^T K^T``, (M, p); ``width`` is M."""
        gains: Array = blas.dtrsm(1.0, triangle[:width, :width], observed, trans_a=1)
        return gains

    def change_gain(self, active: Array, passive: Array, shares: Array) -> None:
        """Follow a change of the gains, ``unscented_transform.change_of_gain``: (a, k), (p, k) and (k, M)."""
        along = shares @ shares.T @ passive.T
        self.cross = self.cross + active @ along
        self.own = self.own + passive @ along

    def scale_active(self, errors: slice, scales: Array) -> None:
        """Scale some active errors (k,)."""
        self.cross[errors] *= scales[:, None]

    def scale(self, errors: slice, scales: Array) -> None:
        """Scale some passive errors (k,), counted from the first passive one."""
        self.cross[:, errors] *= scales
        self.own[errors] *= scales[:, None]
        self.own[:, errors] *= scales

    def joint_factor(self, factor: Array) -> Array:
        """Lower factor (L, L) of all errors, from that of the active ones (a, a).

        Active errors without uncertainty are left out meanwhile: a factor with zeros on its diagonal has no inverse.
        """
        active, length = len(factor), len(factor) + len(self)
        uncertain = np.flatnonzero(np.abs(factor).max(axis=1))
        reduced = lower_factor(np.ascontiguousarray(factor[uncertain].T))
        explained = blas.dtrsm(1.0, reduced, self.cross[uncertain], lower=1)  # (k, p)
        joint = np.zeros((length, length))
        joint[np.ix_(uncertain, uncertain)] = reduced
        joint[active:, uncertain] = explained.T
        joint[active:, active:] = lower_factor(_root(self.own - explained.T @ explained))
        return joint

    def _whitened(self, factor: Array) -> Array:
        """``L^-1 C``, (a, p): covariance of the passive errors with the active ones in units of their factor."""
        if (np.abs(factor.diagonal()) > _SINGULAR * np.linalg.norm(factor, axis=1)).all():
            whitened: Array = blas.dtrsm(1.0, factor.T, self.cross, trans_a=1)
            return whitened
        uncertain = np.flatnonzero(np.abs(factor).max(axis=1))  # of all solutions the least one
        reduced = lower_factor(np.ascontiguousarray(factor[uncertain].T))
        units = blas.dtrsm(1.0, reduced, self.cross[uncertain], lower=1)
        least: Array = factor[uncertain].T @ blas.dtrsm(1.0, reduced, units, lower=1, trans_a=1)
        return least


def _root(covariance: Array) -> Array:
    """Rows ``N`` with ``N^T N`` the covariance (k, k), negative eigenvalues by rounding taken as zero."""
    values, vectors = np.linalg.eigh(0.5 * (covariance + covariance.T))
    root: Array = np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T
    return root
