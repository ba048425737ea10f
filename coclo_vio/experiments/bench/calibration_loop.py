# SPDX-License-Identifier: BSD-3-Clause
"""A fixed piece of work whose processor time is the unit of every cost, so that figures of two machines compare.

It does what the package does: interpreted Python, many calls of NumPy on small arrays, a dense triangularisation, and
one pass over an image. Nothing of the package runs in it, so that it costs the same in every commit.
"""

from time import process_time

import numpy as np

_TRIALS = 5
_PYTHON_STEPS = 60_000
_SMALL_CALLS = 2_000
_TRIANGULARISATIONS = 60
_IMAGE_PASSES = 4


def calibration_s(trials: int = _TRIALS) -> float:
    """Processor time of the calibration loop, s: the least of some trials, for other work only slows it down."""
    return min(_timed() for _ in range(trials))


def _timed() -> float:
    random = np.random.default_rng(0)
    small, tall = random.normal(size=(3, 3)), random.normal(size=(110, 50))
    image = random.normal(size=(480, 640))
    started_s = process_time()
    total = 0
    for step in range(_PYTHON_STEPS):
        total += step * step % 7
    for _ in range(_SMALL_CALLS):
        small = small @ small
        small = small / np.linalg.norm(small)
    for _ in range(_TRIANGULARISATIONS):
        np.linalg.qr(tall, mode="r")
    for _ in range(_IMAGE_PASSES):
        np.abs(np.diff(image, axis=1)).sum()
    return process_time() - started_s
