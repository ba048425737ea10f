# SPDX-License-Identifier: BSD-3-Clause
"""Expected motion of the camera since the reference frame, from which points are tracked."""

import numpy as np

from coclo_vio.geometry import se3
from coclo_vio.values.arrays import Array, checked

_MAX_EXTRAPOLATION_S = 1.0


class ExpectedMotion:
    """Chains the steps since the reference frame: predicted from outside, or else at constant velocity.

    Attributes:
        T_reference_current: maps current camera coordinates to those of the reference frame, (4, 4); None if unknown.
    """

    def __init__(self) -> None:
        self.T_reference_current: Array | None = None
        self._stamp_ns: int | None = None
        self._reference_ns = 0
        self._twist_rate: Array | None = None  # [rotation rad/s, translation m/s] in the camera's frame

    def advance(self, stamp_ns: int, T_previous_current: Array | None) -> None:
        """Add the step to the next frame: the prediction (4, 4), or the last motion extrapolated where it is None.

        Raises:
            ValueError: the prediction is not a finite (4, 4) matrix.
        """
        dt_s = 0.0 if self._stamp_ns is None else (stamp_ns - self._stamp_ns) * 1e-9
        self._stamp_ns = stamp_ns
        step: Array | None = None
        if T_previous_current is not None:
            step = checked("T_previous_current", T_previous_current, (4, 4))
        elif self._twist_rate is not None and 0.0 < dt_s < _MAX_EXTRAPOLATION_S:
            step = se3.exp(self._twist_rate * dt_s)
        before = self.T_reference_current
        self.T_reference_current = None if before is None or step is None else before @ step

    def set_reference(self, T_reference_current: Array | None) -> None:
        """Make the current frame the reference, after an estimate of the motion (4, 4) to it, or None without one."""
        now_ns = self._stamp_ns if self._stamp_ns is not None else 0
        dt_s = (now_ns - self._reference_ns) * 1e-9
        if T_reference_current is None or dt_s <= 0.0:
            self._twist_rate = None
        else:
            self._twist_rate = se3.log(T_reference_current) / dt_s
        self.T_reference_current, self._reference_ns = np.eye(4), now_ns

    def reset(self) -> None:
        """Drop the reference: the motion is unknown until the next one."""
        self.T_reference_current, self._twist_rate = None, None
