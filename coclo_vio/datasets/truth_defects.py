# SPDX-License-Identifier: BSD-3-Clause
"""Poses of a tracking system that are no poses of the body: zeros while it is lost, and jumps."""

import numpy as np

from coclo_vio.values.arrays import Array, BoolArray, IntArray
from coclo_vio.values.units import NS_PER_S

FASTEST_MPS = 10.0
"""No legged robot is faster."""
_LEAST_JUMP_M = 0.1  # noise and outliers of a marker below this are left alone


def lost_poses(positions: Array) -> BoolArray:
    """Which poses are the zeros that a tracker writes while it does not see the body, (N,).

    A run of positions (N, 3) that are exactly zero, more than 0.1 m from the pose before or after it. A first pose
    alone at the origin is not lost: many trajectories start there.
    """
    is_zero = ~positions.any(axis=1)
    is_lost: BoolArray = np.zeros(len(positions), dtype=np.bool_)
    edges = np.flatnonzero(np.diff(np.concatenate(([False], is_zero, [False])).astype(np.int8)))
    for first, end in edges.reshape(-1, 2).tolist():
        beside = [row for row in (first - 1, end) if 0 <= row < len(positions)]
        is_far = any(float(np.linalg.norm(positions[row])) > _LEAST_JUMP_M for row in beside)
        is_start = first == 0 and end == 1
        is_lost[first:end] = is_far and not is_start
    return is_lost


def jumping_poses(stamps_ns: IntArray, positions: Array) -> BoolArray:
    """Which poses (N,) no body reaches at ``FASTEST_MPS`` from the longest stretch without a jump."""
    starts = np.flatnonzero(np.append(True, is_jump(stamps_ns, positions)))
    ends = np.append(starts[1:], len(positions))
    longest = int(np.argmax(ends - starts))
    is_kept: BoolArray = np.zeros(len(positions), dtype=np.bool_)
    is_kept[starts[longest] : ends[longest]] = True
    last = ends[longest] - 1
    for start, end in zip(starts[longest + 1 :], ends[longest + 1 :], strict=True):
        if not is_jump(stamps_ns[[last, start]], positions[[last, start]])[0]:
            is_kept[start:end], last = True, end - 1
    first = starts[longest]
    for start, end in zip(starts[:longest][::-1], ends[:longest][::-1], strict=True):
        if not is_jump(stamps_ns[[end - 1, first]], positions[[end - 1, first]])[0]:
            is_kept[start:end], first = True, start
    return ~is_kept


def is_jump(stamps_ns: IntArray, positions: Array) -> BoolArray:
    """Which steps from pose to pose are longer than ``FASTEST_MPS`` allows, and than 0.1 m, (N - 1,)."""
    steps_m = np.linalg.norm(np.diff(positions, axis=0), axis=1)
    return np.asarray(steps_m > np.maximum(_LEAST_JUMP_M, FASTEST_MPS * np.diff(stamps_ns) / NS_PER_S))
