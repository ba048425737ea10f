# SPDX-License-Identifier: BSD-3-Clause
"""Rotations of the body over an interval by single sensors: a gyroscope, standing feet."""

import numpy as np

from coclo_vio.geometry import so3
from coclo_vio.values.arrays import Array, BoolArray, IntArray
from coclo_vio.values.units import NS_PER_S

_KEPT_S = 4.0  # how far back an interval may begin
_ROOM = 4096  # rows, at first
_FEWEST_FEET = 3
_LEAST_SPREAD_M = 0.1  # root mean square of feet about their middle, second axis
_LONGEST_GAP_S = 0.1


class _LatestRows:
    """Rows of numbers with their stamps over the last seconds, in order, in one piece of memory."""

    def __init__(self, width: int) -> None:
        self._stamps_ns, self._rows = np.zeros(_ROOM, dtype=np.int64), np.zeros((_ROOM, width))
        self._first = self._end = 0

    @property
    def stamps_ns(self) -> IntArray:
        """Nanoseconds, (n,)."""
        return self._stamps_ns[self._first : self._end]

    @property
    def rows(self) -> Array:
        """Of those stamps, (n, width)."""
        return self._rows[self._first : self._end]

    def push(self, stamp_ns: int, row: Array) -> None:
        """Add a row; those too old are dropped."""
        if self._end == len(self._stamps_ns):
            self._make_room()
        self._stamps_ns[self._end], self._rows[self._end] = stamp_ns, row
        self._end += 1
        while stamp_ns - self._stamps_ns[self._first] > _KEPT_S * NS_PER_S:
            self._first += 1

    def _make_room(self) -> None:
        """Move the rows to the begin, of twice the memory where they fill more than half of it."""
        stamps, rows = self.stamps_ns, self.rows
        size = len(self._stamps_ns) * (2 if 2 * len(stamps) > len(self._stamps_ns) else 1)
        self._stamps_ns, self._rows = np.zeros(size, dtype=np.int64), np.zeros((size, rows.shape[1]))
        self._stamps_ns[: len(stamps)], self._rows[: len(rows)] = stamps, rows
        self._first, self._end = 0, len(stamps)


class GyroscopeRotation:
    """Integrates a gyroscope from one time to another.

    Args:
        rotation_body_imu: ``R_body_imu``, (3, 3).
    """

    def __init__(self, rotation_body_imu: Array) -> None:
        self._rotation = rotation_body_imu
        self._rates = _LatestRows(3)

    @property
    def is_empty(self) -> bool:
        """Whether there has been no reading."""
        return not len(self._rates.stamps_ns)

    def push(self, stamp_ns: int, rate: Array) -> None:
        """Take a reading in order, imu frame, rad/s, (3,); others are left out."""
        if self.is_empty or stamp_ns > self._rates.stamps_ns[-1]:
            self._rates.push(stamp_ns, rate)

    def between(self, start_ns: int, end_ns: int, bias: Array) -> tuple[Array, Array] | None:
        """Rotation vector (3,), rad, and rate at the end less rate at the start (3,), body axes; None without readings.

        Args:
            start_ns: of the interval.
            end_ns: of the interval; the last reading holds on up to 0.1 s.
            bias: is subtracted, body axes, rad/s, (3,).
        """
        stamps = self._rates.stamps_ns
        first = int(np.searchsorted(stamps, start_ns, "right")) - 1
        last = int(np.searchsorted(stamps, end_ns, "right"))
        if first < 0 or last - first < 2:
            return None
        last = min(last + 1, len(stamps))
        times_s = (stamps[first:last] - start_ns) / NS_PER_S
        end_s = (end_ns - start_ns) / NS_PER_S
        if np.diff(np.append(times_s, max(end_s, times_s[-1]))).max() > _LONGEST_GAP_S:
            return None
        rates = self._rates.rows[first:last] @ self._rotation.T - bias
        inner = times_s[(times_s > 0.0) & (times_s < end_s)]
        at_s = np.concatenate(([0.0], inner, [end_s]))
        at = np.column_stack([np.interp(at_s, times_s, rates[:, axis]) for axis in range(3)])
        turns = so3.exp(0.5 * (at[1:] + at[:-1]) * np.diff(at_s)[:, None])
        while len(turns) > 1:  # neighbours at once: as many steps as the number has digits
            odd = turns[len(turns) & ~1 :]
            turns = np.concatenate((turns[: len(turns) & ~1 : 2] @ turns[1::2], odd))
        return np.asarray(so3.log(turns[0])), np.asarray(at[-1] - at[0])

    def mean_rates(self, starts_ns: IntArray, ends_ns: IntArray) -> Array | None:
        """Mean rates over intervals, body axes, rad/s, (n, 3); None where readings do not reach over all of them.

        Nor do they where they pause for more than 0.1 s.
        """
        stamps = self._rates.stamps_ns
        if len(stamps) < 2 or stamps[0] > starts_ns.min() or stamps[-1] < ends_ns.max():
            return None
        first, last = np.searchsorted(stamps, starts_ns.min(), "right") - 1, np.searchsorted(stamps, ends_ns.max())
        if np.diff(stamps[first : last + 1]).max(initial=0) > _LONGEST_GAP_S * NS_PER_S:
            return None
        times_s = (stamps - stamps[0]) / NS_PER_S
        rates = self._rates.rows @ self._rotation.T
        turned = np.zeros((len(stamps), 3))
        np.cumsum(0.5 * (rates[1:] + rates[:-1]) * np.diff(times_s)[:, None], axis=0, out=turned[1:])
        start_s, end_s = ((each - stamps[0]) / NS_PER_S for each in (starts_ns, ends_ns))
        turns = [np.interp(end_s, times_s, each) - np.interp(start_s, times_s, each) for each in turned.T]
        return np.asarray(np.column_stack(turns) / (end_s - start_s)[:, None])


class FeetRotation:
    """The rotation of the body against feet that stand from one time to another."""

    def __init__(self) -> None:
        self._feet: _LatestRows | None = None  # x, y, z of each, and whether it stands

    def push(self, stamp_ns: int, feet: Array, is_stance: BoolArray) -> None:
        """Take positions of the feet, body frame, m, (n, 3), and which of them stand, (n,)."""
        if self._feet is None:
            self._feet = _LatestRows(4 * len(feet))
        row: Array = np.concatenate((feet, is_stance[:, None]), axis=1)
        self._feet.push(stamp_ns, row.ravel())

    def between(self, start_ns: int, end_ns: int) -> Array | None:
        """Rotation vector, body axes at the start, rad, (3,); None where fewer than three feet stand all the time.

        The feet are those of the samples next to both times. Source: Kabsch 1976.
        """
        if self._feet is None:
            return None
        stamps, known = self._feet.stamps_ns, self._feet.rows.reshape(len(self._feet.stamps_ns), -1, 4)
        first, last = (int(np.abs(stamps - stamp_ns).argmin()) for stamp_ns in (start_ns, end_ns))
        if max(abs(stamps[first] - start_ns), abs(stamps[last] - end_ns)) > _LONGEST_GAP_S * NS_PER_S or last <= first:
            return None
        stands = known[first : last + 1, :, 3].all(axis=0)
        if np.count_nonzero(stands) < _FEWEST_FEET:
            return None
        before, after = (known[index, stands, :3] for index in (first, last))
        before, after = before - before.mean(axis=0), after - after.mean(axis=0)
        left, sizes, right = np.linalg.svd(after.T @ before)
        if np.sqrt(sizes[1] / len(before)) < _LEAST_SPREAD_M:
            return None
        turn = np.diag([1.0, 1.0, np.sign(np.linalg.det(right.T @ left.T))])
        share = (end_ns - start_ns) / float(stamps[last] - stamps[first])  # the samples' interval is not quite this one
        return np.asarray(so3.log(right.T @ turn @ left.T) * share)
