# SPDX-License-Identifier: BSD-3-Clause
"""The OpenGL backend that renders without a screen. MuJoCo selects it on import, so each is tried in a process."""

import functools
import os
import subprocess
import sys
from typing import Final

from coclo_vio.values.errors import ConfigError, SimulationError

VARIABLE: Final = "MUJOCO_GL"
BACKENDS: Final = ("egl", "osmesa")
_PROBE = "import mujoco; context = mujoco.GLContext(16, 16); context.make_current(); context.free()"
_PROBE_TIMEOUT_S = 60.0


class RenderingError(SimulationError):
    """Images cannot be rendered on this machine, or of this model."""


def choose_backend() -> str:
    """The value for ``MUJOCO_GL``: that of the environment, else the first of ``BACKENDS`` that works here.

    Raises:
        ConfigError: the environment names a backend that renders to a screen or that MuJoCo does not have.
        RenderingError: none works; the message names the Debian packages.
    """
    variable = os.environ.get(VARIABLE, "").strip().lower()
    if variable and variable not in BACKENDS:
        raise ConfigError(f"{VARIABLE}={variable} cannot render without a screen; set it to {' or '.join(BACKENDS)}")
    for backend in (variable,) if variable else BACKENDS:
        if works(backend):
            return backend
    note = f" ({VARIABLE}={variable} is set)" if variable else ""
    raise RenderingError(
        f"no OpenGL that renders without a screen was found{note}: install the Debian packages libegl1 libgles2 "
        "libgl1-mesa-dri, or libosmesa6, or leave the images out with --no-images"
    )


@functools.cache
def works(backend: str) -> bool:
    """Whether MuJoCo can make an off-screen context with this backend, tried once in a process of its own."""
    environment = {**os.environ, **settings(backend)}
    try:
        probe = subprocess.run(
            [sys.executable, "-c", _PROBE],
            env=environment,
            capture_output=True,
            timeout=_PROBE_TIMEOUT_S,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return False
    return probe.returncode == 0


def settings(backend: str) -> dict[str, str]:
    """Environment of a process that renders with this backend in one thread.

    Without it Mesa's software rasteriser starts a thread for each core, and so do NumPy's linear algebra and OpenCV.
    """
    threads = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "OPENCV_FOR_THREADS_NUM"), "1")
    return {VARIABLE: backend, "PYOPENGL_PLATFORM": backend, "LP_NUM_THREADS": "0", **threads}
