# SPDX-License-Identifier: BSD-3-Clause
"""One rendering process: renders, degrades and encodes some frames of the trial.

A process keeps its renderer from call to call. A frame does not depend on the process that renders it.
"""

import atexit
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import cv2
import mujoco
import numpy as np

from coclo_vio.simulation.visuals.bareness import bareness
from coclo_vio.simulation.visuals.camera_model import CameraModel
from coclo_vio.simulation.visuals.cameras import focal_px, image_size
from coclo_vio.simulation.visuals.config import CameraConfig
from coclo_vio.simulation.visuals.exposure import Exposure, exposures
from coclo_vio.simulation.visuals.illumination import FloatImage, Illumination, View
from coclo_vio.simulation.visuals.opengl import RenderingError
from coclo_vio.simulation.visuals.renderer import SceneRenderer, load_model
from coclo_vio.values.arrays import Array, ByteImage, IntArray
from coclo_vio.values.measurements import EncodedStereoFrame


@dataclass(frozen=True, slots=True, eq=False)
class RenderJob:
    """All frames to render, the same for each process.

    Attributes:
        model_path: the MuJoCo model.
        qpos: configuration of the robot at each frame, (N, nq).
        qvel: its velocity, (N, nv), or None for differences of the neighbouring frames.
        stamps_ns: middle of each exposure, (N,), ascending.
        config: the camera.
        seed: decides noise and drift.
    """

    model_path: Path
    qpos: Array
    qvel: Array | None
    stamps_ns: IntArray
    config: CameraConfig
    seed: int


class RenderWorker:
    """Renders any frames of a job."""

    def __init__(self, job: RenderJob) -> None:
        cv2.setNumThreads(1)
        model = load_model(job.model_path)
        self._job = job
        self._qvel = job.qvel if job.qvel is not None else neighbour_velocities(model, job.qpos, job.stamps_ns)
        for name, rows, width in (("frames", job.qpos, model.nq), ("velocities", self._qvel, model.nv)):
            if rows.shape != (len(job.stamps_ns), width):
                raise RenderingError(
                    f"{name} must have a row of {width} for each of {len(job.stamps_ns)} stamps, got {rows.shape}"
                )
        self._exposures: list[Exposure] = exposures(job.stamps_ns, job.config, job.seed)
        self._cameras = [
            CameraModel(job.config, side, *image_size(model, side), focal_px(model, side), job.seed) for side in (0, 1)
        ]
        self._focal_px = [focal_px(model, side) for side in (0, 1)]
        self._bareness = bareness(model, job.qpos, job.stamps_ns)
        self._illumination = Illumination(job.config.lighting, job.seed)
        self._renderer = SceneRenderer(model)

    def close(self) -> None:
        """Free the OpenGL context."""
        self._renderer.close()

    def frame(self, number: int) -> EncodedStereoFrame:
        """Render, degrade and encode one frame."""
        time_s = float(self._job.stamps_ns[number] - self._job.stamps_ns[0]) * 1e-9
        self._renderer.place(self._job.qpos[number], self._qvel[number], time_s)
        left, right = (self._image(side, number) for side in (0, 1))
        return EncodedStereoFrame(int(self._job.stamps_ns[number]), left, right, self._job.config.encoding)

    def _image(self, side: int, number: int) -> bytes:
        view, camera = self._renderer.draw(side, float(self._bareness[number])), self._cameras[side]
        image: ByteImage | FloatImage = view.image
        if not self._illumination.is_even:
            seen = View(view.T_world_camera, view.T_world_body, view.inverse_depth, self._focal_px[side])
            image = np.asarray(view.image * self._illumination.on(seen), dtype=np.float32)
        exposure = self._exposures[number]
        return camera.encode(camera.record(image, view.inverse_depth, view.twist, exposure, number))


def neighbour_velocities(model: mujoco.MjModel, qpos: Array, stamps_ns: IntArray) -> Array:
    """Velocities (N, nv) by central differences of positions (N, nq), one-sided at the ends; zero for one frame."""
    last = len(qpos) - 1
    velocities = np.zeros((len(qpos), model.nv))
    for number in range(len(qpos) if last > 0 else 0):
        before, after = max(number - 1, 0), min(number + 1, last)
        dt_s = float(stamps_ns[after] - stamps_ns[before]) * 1e-9
        mujoco.mj_differentiatePos(model, velocities[number], dt_s, qpos[before], qpos[after])
    return velocities


def prepare(job: RenderJob) -> None:
    """Set the job of this process; the worker is made with the first frame, whose call raises its errors."""
    _JOB.clear()
    _JOB.append(job)


def draw(start: int, stop: int) -> list[EncodedStereoFrame]:
    """The frames ``start`` to ``stop`` (not included) of this process's job."""
    worker = _worker()
    return [worker.frame(number) for number in range(start, stop)]


_JOB: list[RenderJob] = []  # at most one: the job of this process


@cache
def _worker() -> RenderWorker:
    worker = RenderWorker(_JOB[0])
    atexit.register(worker.close)  # before the interpreter unloads OpenGL
    return worker
