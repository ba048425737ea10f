# SPDX-License-Identifier: BSD-3-Clause
"""All stereo frames of a trial: rendered in parallel processes, returned in order, few in memory at a time."""

import multiprocessing
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path

import numpy as np

from coclo_vio.simulation.process_environment import environment
from coclo_vio.simulation.visuals import render_worker
from coclo_vio.simulation.visuals.config import CameraConfig
from coclo_vio.simulation.visuals.opengl import RenderingError, choose_backend, settings
from coclo_vio.simulation.visuals.render_worker import RenderJob
from coclo_vio.values.arrays import Array, IntArray, checked
from coclo_vio.values.measurements import EncodedStereoFrame

_CHUNK_FRAMES = 4
_CHUNKS_AHEAD = 3  # for each process: enough to keep it busy, few enough to keep memory small


def render_stereo(
    model_path: Path,
    frames: Array,
    stamps_ns: IntArray,
    config: CameraConfig,
    seed: int,
    workers: int = 2,
    progress: Callable[[int], None] | None = None,
    velocities: Array | None = None,
) -> Iterator[EncodedStereoFrame]:
    """Render the images of both cameras, in time order. Same seed, same bytes, with any number of processes.

    Args:
        model_path: a MuJoCo model (.mjb or XML) with the cameras of ``add_cameras``.
        frames: ``qpos`` of the model at the middle of each exposure, (N, nq).
        stamps_ns: the times of these, (N,), ascending.
        config: of the imagers.
        seed: decides noise and exposure drift.
        workers: number of rendering processes.
        progress: called with the number of finished frames.
        velocities: ``qvel`` at the same times, (N, nv), for the motion blur; by default from the neighbouring frames,
            which at 15 Hz misses the shocks of a touch-down.

    Raises:
        RenderingError: no OpenGL without a screen, a model without cameras, rows that do not fit it, or a process died.
        ValueError: stamps that do not ascend, or positions that are not finite.
    """
    stamps_ns = np.asarray(stamps_ns, dtype=np.int64)
    qvel = None if velocities is None else checked("velocities", velocities, (None, None))
    job = RenderJob(model_path, checked("frames", frames, (None, None)), qvel, stamps_ns, config, seed)
    if (np.diff(stamps_ns) <= 0).any():
        raise ValueError("stamps_ns must ascend from frame to frame")
    if workers < 1:
        raise ValueError(f"workers = {workers} must be at least 1")
    return _rendered(job, choose_backend(), workers, progress)


def _rendered(
    job: RenderJob, backend: str, workers: int, progress: Callable[[int], None] | None
) -> Iterator[EncodedStereoFrame]:
    starts = deque(range(0, len(job.stamps_ns), _CHUNK_FRAMES))
    pending: deque[Future[list[EncodedStereoFrame]]] = deque()
    spawn = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(workers, spawn, initializer=render_worker.prepare, initargs=(job,))
    done = 0
    try:
        while starts or pending:
            with environment(settings(backend)):  # inherited by processes, which start when jobs are submitted
                while starts and len(pending) < workers * _CHUNKS_AHEAD:
                    start = starts.popleft()
                    stop = min(start + _CHUNK_FRAMES, len(job.stamps_ns))
                    pending.append(pool.submit(render_worker.draw, start, stop))
            for frame in pending.popleft().result():
                yield frame
                done += 1
                if progress is not None:
                    progress(done)
    except BrokenProcessPool as error:
        raise RenderingError(
            f"a rendering process ({backend}) died after {done} of {len(job.stamps_ns)} frames; "
            "if standard error shows no reason, it lacked memory: try fewer workers"
        ) from error
    finally:
        pool.shutdown(cancel_futures=True)
