# SPDX-License-Identifier: BSD-3-Clause
"""Estimates as they come out, by the clock of the truth, also where the clock of all streams has stepped."""

from collections import defaultdict

import numpy as np

from coclo_vio.values.arrays import Array
from coclo_vio.values.outputs import Estimate, Output
from coclo_vio.values.trajectory import Trajectory
from coclo_vio.values.units import NS_PER_S


class EstimatesTaken:
    """Collects the estimates of a run by trajectory."""

    def __init__(self, first_ns: int, last_ns: int, step_s: float = 0.0) -> None:
        """Take the times.

        Args:
            first_ns: beginning of the truth.
            last_ns: its end.
            step_s: the clock of all streams steps by this on the way, s, by more than twice the duration; 0: it does
                not.
        """
        self._step_ns = round(step_s * NS_PER_S)
        self._earliest_ns, self._latest_ns = first_ns - abs(self._step_ns) // 2, last_ns + abs(self._step_ns) // 2
        self._rows: dict[str, dict[int, tuple[Array, Array, Array]]] = defaultdict(dict)

    def take(self, output: Output) -> None:
        """An output has come; the last estimate of a stamp counts."""
        if isinstance(output, Estimate):
            nav = output.state.nav
            row = (nav.T_world_body, nav.velocity_world, output.state.covariance[:6, :6])
            self._rows[output.name][self._on_clock_of_truth(output.state.stamp_ns)] = row

    def trajectory(self, name: str) -> Trajectory | None:
        """The estimates of a trajectory in the order of their stamps; None without any."""
        rows = self._rows.get(name)
        if not rows:
            return None
        stamps = sorted(rows)
        poses, velocities, covariances = (np.stack(part) for part in zip(*(rows[at] for at in stamps), strict=True))
        return Trajectory(np.array(stamps, dtype=np.int64), poses, velocities, covariances)

    def _on_clock_of_truth(self, stamp_ns: int) -> int:
        is_stepped = self._step_ns and not self._earliest_ns <= stamp_ns <= self._latest_ns
        return stamp_ns - self._step_ns if is_stepped else stamp_ns
