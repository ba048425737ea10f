# SPDX-License-Identifier: BSD-3-Clause
"""How the camera should have moved since the frame that points are followed from."""

import numpy as np

from coclo_vio.geometry import se3
from coclo_vio.values.arrays import Array, checked

_LONGEST_GAP_S = 1.0  # beyond it nothing goes on as before


class ExpectedMotion:
    """Adds up what is known of each step: what others predict, or else the last motion that was seen, going on.

    Attributes:
        T_reference_current: maps current camera coordinates to those of the reference frame, (4, 4); None: unknown.
    """

    def __init__(self) -> None:
        self.T_reference_current: Array | None = None
        self._stamp_ns: int | None = None
        self._reference_ns = 0
        self._twist_rate: Array | None = None  # [rotation rad/s, translation m/s] in the camera's frame

    def advance(self, stamp_ns: int, T_previous_current: Array | None) -> None:
        """A frame later, with the predicted step (4, 4) or None.

        Raises:
            ValueError: the step is no finite (4, 4) matrix.
        """
        dt_s = 0.0 if self._stamp_ns is None else (stamp_ns - self._stamp_ns) * 1e-9
        self._stamp_ns = stamp_ns
        step: Array | None = None
        if T_previous_current is not None:
            step = checked("T_previous_current", T_previous_current, (4, 4))
        elif self._twist_rate is not None and 0.0 < dt_s < _LONGEST_GAP_S:
            step = se3.exp(self._twist_rate * dt_s)
        before = self.T_reference_current
        self.T_reference_current = None if before is None or step is None else before @ step

    def settle(self, T_reference_current: Array | None) -> None:
        """The last frame is the reference from now on; this motion (4, 4) was seen up to it, None if none was."""
        now_ns = self._stamp_ns if self._stamp_ns is not None else 0
        dt_s = (now_ns - self._reference_ns) * 1e-9
        if T_reference_current is None or dt_s <= 0.0:
            self._twist_rate = None
        else:
            self._twist_rate = se3.log(T_reference_current) / dt_s
        self.T_reference_current, self._reference_ns = np.eye(4), now_ns

    def forget(self) -> None:
        """There is no reference any more."""
        self.T_reference_current, self._twist_rate = None, None
