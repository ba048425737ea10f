# SPDX-License-Identifier: BSD-3-Clause
"""From clock and world of the estimator to those of the outputs.

The clock of the estimator never steps; outputs are stamped by the clock of the samples. The world of the estimator
begins at its first estimate; that of the outputs can be chosen.
"""

from bisect import bisect_right
from dataclasses import replace

import numpy as np

from coclo_vio.online.world_anchor import WorldAnchor
from coclo_vio.values.arrays import Array
from coclo_vio.values.estimates import StateEstimate
from coclo_vio.values.outputs import Estimate, Output, WindowSnapshot

PoseGiven = tuple[Array, Array]
"""``T_world_body``, (4, 4), and the covariance of its right/local error, (6, 6)."""


class OutputFrame:
    """Moves outputs; as they are until a clock steps or a world is chosen."""

    def __init__(self, *, is_levelled: bool) -> None:
        """Args: whether the estimator has roll and pitch from gravity."""
        self._is_levelled = is_levelled
        self._anchor = WorldAnchor(is_levelled=is_levelled)
        self._next: PoseGiven | None = None  # of the next estimate
        self._name: str | None = None  # of the trajectory whose estimates count for anchors
        self._last: StateEstimate | None = None  # of it, in the world of the estimator
        self._last_moved: StateEstimate | None = None
        self._from_ns: list[int] = []
        self._shifts_ns: list[int] = [0]

    @property
    def last_pose(self) -> PoseGiven | None:
        """The last pose given out and its covariance; None before the first."""
        last = self._last_moved
        return None if last is None else (last.nav.T_world_body, last.covariance[:6, :6])

    def stamp_ns(self, inner_ns: int) -> int:
        """A stamp of the estimator by the clock of the samples."""
        return inner_ns + self._shifts_ns[bisect_right(self._from_ns, inner_ns)]

    def step(self, from_ns: int, step_ns: int) -> None:
        """The clock of the samples steps.

        Args:
            from_ns: from there on, by the clock of the estimator.
            step_ns: new clock less old one.
        """
        self._from_ns.append(from_ns)
        self._shifts_ns.append(self._shifts_ns[-1] + step_ns)

    def anchor_next(self, pose: PoseGiven | None) -> None:
        """A fresh estimator comes, whose first estimate has this pose; None: as it gives it."""
        self._anchor = WorldAnchor(is_levelled=self._is_levelled)
        self._next, self._last = pose, None

    def anchor_now(self, pose: PoseGiven) -> None:
        """The last estimate has this pose, or the first one to come."""
        if self._last is None:
            self._next = pose
            return
        self._anchor.anchor(self._last, *pose)
        self._last_moved = self._anchor.moved(self._last)

    def widen(self, gap_sigma_s: float) -> None:
        """The body has moved on for an unknown time, one sigma of it in s, which the estimator does not allow for."""
        last = self._last_moved
        if last is None or gap_sigma_s <= 0.0:
            return
        speed = np.sqrt(last.nav.velocity_world @ last.nav.velocity_world + np.trace(last.covariance[6:, 6:]))
        rate = np.linalg.norm(last.nav.angular_velocity_body)
        sigmas = np.repeat((rate * gap_sigma_s, speed * gap_sigma_s), 3)
        self._anchor.widen(last.nav.T_world_body, np.diag(sigmas**2))

    def moved(self, output: Output) -> Output:
        """An output by the clock of the samples and in the world that was chosen."""
        if isinstance(output, WindowSnapshot) and self._anchor.is_moved:
            output = output.moved(self._anchor.T_output_world)
        if not isinstance(output, Estimate):
            stamp_ns = self.stamp_ns(output.stamp_ns)
            return output if stamp_ns == output.stamp_ns else replace(output, stamp_ns=stamp_ns)
        state = output.state
        if self._name is None:
            self._name = output.name
        if self._next is not None:
            self._anchor.anchor(state, *self._next)
            self._next = None
        moved = self._anchor.moved(state)
        if output.name == self._name:
            self._last, self._last_moved = state, moved
        stamp_ns = self.stamp_ns(state.stamp_ns)
        if moved is state and stamp_ns == state.stamp_ns:
            return output
        return Estimate(output.name, replace(moved, stamp_ns=stamp_ns))
