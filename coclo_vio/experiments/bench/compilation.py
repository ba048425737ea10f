# SPDX-License-Identifier: BSD-3-Clause
"""What compiling all kernels adds to the first run on a machine."""

import os
import resource
import subprocess
import sys
from tempfile import TemporaryDirectory

from coclo_vio.experiments.bench.costs import combined_realtime_factor, keyframe_ms, quadruped_with_stereo
from coclo_vio.geometry.compiled import IS_COMPILED
from coclo_vio.values.errors import CocloError


def compile_s() -> float | None:
    """Processor time of a first run less that of a second one, s; None where nothing is compiled.

    Raises:
        CocloError: the run fails.
    """
    if not IS_COMPILED:
        return None
    with TemporaryDirectory() as cache:
        first, second = (_processor_s(cache) for _ in range(2))
    return first - second


def run_all_kernels() -> None:
    """A short walk through leg odometry, front end and window: every kernel is needed once."""
    combined_realtime_factor(quadruped_with_stereo(joint_hz=100.0, frame_hz=5.0, walk_s=3.0))
    keyframe_ms(frames=10)


def _processor_s(cache: str) -> float:
    began = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run(
        [sys.executable, "-c", f"from {__name__} import run_all_kernels; run_all_kernels()"],
        env={**os.environ, "NUMBA_CACHE_DIR": cache},
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode:
        raise CocloError(f"a run of all kernels ended with status {done.returncode}: {done.stderr[-400:]}")
    ended = resource.getrusage(resource.RUSAGE_CHILDREN)
    return ended.ru_utime + ended.ru_stime - began.ru_utime - began.ru_stime
