# SPDX-License-Identifier: BSD-3-Clause
"""Frames between the rows of a ground truth without stamps, from the smoothness of its own motion.

A tracker measures at an even rate, and a program that logs its poses misses some of them. Without stamps the rows look
even, and the motion seems to change its speed by a factor of two or three from row to row. The steps are whole numbers
of frames. With the step ``d_i`` over ``n_i`` frames the velocity is ``d_i / n_i``, and from step to step it changes by
noise and acceleration:

    d_i / n_i - d_j / n_j ~ N(0, 2 s^2 (1 / n_i^2 + 1 / n_j^2) + a^2 (n_i + n_j) / 2),   j = i - 1,

for positions and for rotations, each with a noise ``s`` of the poses and an acceleration ``a``. The numbers of largest
likelihood are found exactly (Viterbi, 1967), with the ``s``, the ``a`` and the shares of the numbers by maximising it
over them too. Only the ground truth is looked at. Where its rows are even, or it does not tell, nothing is found.
"""

from functools import lru_cache

import numpy as np
from scipy.ndimage import median_filter
from scipy.spatial.transform import Rotation

from coclo_vio.values.arrays import Array, BoolArray, IntArray
from coclo_vio.values.trajectory import Trajectory

_MOST = 12  # frames between two rows
_LEAST_ROWS, _MOST_ROWS = 100, 400  # that move, and that noises are found by
_ROUNDS = 3  # of numbers and their shares in turn
_SHARES = (0.05, 0.05, 0.1, 0.1)  # of a typical step, from which noises are sought
_OCTAVES = (2.0, 1.0, 0.5)  # by which they are changed
_QUIET_SHARE, _QUIET_STEP = 0.15, 0.02  # of the rows, and most of a typical step
_MOVES = 25.0  # square of a step over its variance by noise, in the median of so many rows
_MEDIAN_ROWS = 11
_EVEN_SHARE = 0.95  # of the rows with the same number: they are even
_LEAST_GAIN = 1.0  # logarithm of the likelihood a row, over that of even rows
_CHUNK = 4096  # rows whose costs are in memory at a time


@lru_cache(maxsize=8)  # a trajectory is compared with several estimates, and equal to itself only
def frame_numbers(trajectory: Trajectory) -> IntArray | None:
    """The number of the frame of each row, (N,), from 0 on; None where rows are even or their motion does not tell.

    While the body rests the frames between rows are unknown, and taken to be as many as in the mean of the others.
    """
    steps = _steps(trajectory)
    if len(steps) < _LEAST_ROWS:
        return None
    chosen, quiet = _busiest(steps), _quiet(steps)
    noise, cost = _fitted(chosen, quiet, _MOST)
    moves = _moving(steps, quiet)
    if np.count_nonzero(moves) < _LEAST_ROWS or _fitted(chosen, quiet, 1)[1] - cost < _LEAST_GAIN * len(chosen):
        return None
    counts, _ = _most_likely(steps, noise, _MOST)
    of_moving = np.bincount(counts[moves])
    if of_moving.max() > _EVEN_SHARE * of_moving.sum():
        return None
    frames = np.where(moves, counts, counts[moves].mean())
    return np.append(0, np.floor(np.cumsum(frames) + 0.5).astype(np.int64))  # halves upwards: never the same twice


def _steps(trajectory: Trajectory) -> Array:
    """Translation, m, and rotation vector, rad, from each pose to the next, world axes, (N - 1, 6)."""
    rotations = Rotation.from_matrix(trajectory.rotations)
    turns = rotations[:-1].apply((rotations[:-1].inv() * rotations[1:]).as_rotvec())
    return np.concatenate((np.diff(trajectory.T_world_body[:, :3, 3], axis=0), turns), axis=1)


def _typical(steps: Array) -> Array:
    """Medians of the sizes of translation and rotation, m and rad, (2,), never 0."""
    sizes = np.linalg.norm(steps.reshape(-1, 2, 3), axis=2)
    return np.asarray(np.maximum(np.median(sizes, axis=0), 1e-6))


def _quiet(steps: Array) -> Array:
    """The least noise of a pose, m and rad, (2,): by the smallest steps, which are noise alone where the body rests."""
    sizes = np.linalg.norm(steps.reshape(-1, 2, 3), axis=2)
    smallest = np.quantile(sizes, _QUIET_SHARE, axis=0) / np.sqrt(6.0)  # three axes, the noise of two poses
    return np.asarray(np.minimum(smallest, _QUIET_STEP * _typical(steps)))


def _busiest(steps: Array) -> Array:
    """The stretch of at most ``_MOST_ROWS`` rows in which the body moves most."""
    sizes = np.minimum(np.linalg.norm(steps.reshape(-1, 2, 3), axis=2) / _typical(steps), 3.0).sum(axis=1)
    sums = np.append(0.0, np.cumsum(sizes))
    width = min(_MOST_ROWS, len(steps))
    start = int(np.argmax(sums[width:] - sums[:-width]))
    return np.asarray(steps[start : start + width])


def _moving(steps: Array, quiet: Array) -> BoolArray:
    """Rows (N,) at which the body moves by much more than the noise of its poses, by translation or by rotation."""
    squares = np.square(steps.reshape(-1, 2, 3) / np.maximum(quiet, 1e-12)[:, None]).sum(axis=2) / 6.0
    return np.asarray(median_filter(squares.max(axis=1), _MEDIAN_ROWS) > _MOVES)


def _fitted(steps: Array, quiet: Array, most: int) -> tuple[Array, float]:
    """Noises of pose, m and rad, and accelerations, m and rad a frame, (4,), of the largest likelihood, and the cost.

    One after the other is multiplied and divided while that helps, by less and less. Noise of poses is no less than
    ``quiet`` (2,): beside accelerations it is hardly seen, and rows at rest would be counted by it.
    """
    least = np.append(np.maximum(quiet, 1e-9), (1e-9, 1e-9))
    noise = np.maximum(np.tile(_typical(steps), 2) * _SHARES, least)
    cost = _most_likely(steps, noise, most)[1]
    for octave in _OCTAVES:
        helps = True
        while helps:
            helps = False
            for index in range(len(noise)):
                for factor in (2.0**octave, 0.5**octave):
                    changed = noise.copy()
                    changed[index] = max(factor * changed[index], least[index])
                    its_cost = _most_likely(steps, changed, most)[1]
                    if its_cost < cost - 1e-6:
                        noise, cost, helps = changed, its_cost, True
                        break
    return noise, cost


def _most_likely(steps: Array, noise: Array, most: int) -> tuple[IntArray, float]:
    """The most likely numbers of frames of the steps, (N,), from 1 to ``most``, and the cost: minus log likelihood."""
    log_shares = np.full(most, -np.log(most))
    for _ in range(_ROUNDS if most > 1 else 1):
        numbers, cost = _viterbi(steps, noise, log_shares)
        shares = np.bincount(numbers, minlength=most + 1)[1:] + 1.0
        log_shares = np.log(shares / shares.sum())
    return numbers, cost


def _viterbi(steps: Array, noise: Array, log_shares: Array) -> tuple[IntArray, float]:
    most = len(log_shares)
    every = np.arange(most)
    total, before = -log_shares, np.empty((len(steps) - 1, most), dtype=np.int64)
    for first in range(0, len(steps) - 1, _CHUNK):
        for row, costs in enumerate(_pair_costs(steps[first : first + _CHUNK + 1], noise, most), start=first):
            through = costs + total
            before[row] = through.argmin(axis=1)
            total = through[every, before[row]] - log_shares
    path = np.empty(len(steps), dtype=np.int64)
    path[-1] = total.argmin()
    for row in range(len(steps) - 2, -1, -1):
        path[row] = before[row, path[row + 1]]
    return path + 1, float(total.min())


def _pair_costs(steps: Array, noise: Array, most: int) -> Array:
    """Costs (N - 1, most, most) of each step, over as many frames as the row, after the one over those of the column.

    A density of steps, so that of velocities is divided by the number of frames for each of the six numbers.
    """
    frames = np.arange(1.0, most + 1.0)
    by_noise = 1.0 / frames[:, None] ** 2 + 1.0 / frames**2
    by_acceleration = 0.5 * (frames[:, None] + frames)
    costs = np.tile(6.0 * np.log(frames)[:, None], (len(steps) - 1, 1, most))
    for axis in range(6):
        pose, acceleration = noise[axis // 3], noise[2 + axis // 3]
        variance = 2.0 * pose**2 * by_noise + acceleration**2 * by_acceleration
        velocity = steps[:, axis, None] / frames
        changes = velocity[1:, :, None] - velocity[:-1, None, :]
        costs += 0.5 * (changes**2 / variance + np.log(variance))
    return costs
