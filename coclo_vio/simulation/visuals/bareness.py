# SPDX-License-Identifier: BSD-3-Clause
"""Surfaces that lose their texture on the last part of the way.

The model holds each textured surface a second time in one grey; the renderer mixes both images. So corners of steps and
boxes stay, what is drawn on surfaces goes.
"""

from collections.abc import Sequence
from typing import Final

import mujoco
import numpy as np

from coclo_vio.simulation.visuals.textures import RECIPES
from coclo_vio.values.arrays import Array, IntArray

BARE_GROUP: Final = 5  # not visible by default
TEXTURED_GROUP: Final = 2
_NUMERIC = "bare_from"
_FADING = 0.05  # share of the way over which the texture fades
_BAREST = 0.97


def add_bare_surfaces(spec: mujoco.MjSpec, textures: Sequence[str], bare_from: float) -> None:
    """Add a bare surface to each textured one.

    Args:
        spec: the model with its textured surfaces, changed in place.
        textures: names of their recipes.
        bare_from: share of the way from which they are bare.
    """
    for texture in textures:
        textured = spec.geom(f"visual_{texture}")
        textured.group = TEXTURED_GROUP
        grey = RECIPES[texture].mean
        spec.add_material(name=f"bare_{texture}", rgba=[grey, grey, grey, 1.0], specular=0.0, shininess=0.0)
        spec.worldbody.add_geom(
            name=f"bare_{texture}",
            type=mujoco.mjtGeom.mjGEOM_MESH,
            meshname=f"visual_{texture}",
            material=f"bare_{texture}",
            contype=0,
            conaffinity=0,
            mass=0.0,
            group=BARE_GROUP,
        )
    spec.add_numeric(name=_NUMERIC, size=1, data=[bare_from])


def bareness(model: mujoco.MjModel, qpos: Array, stamps_ns: IntArray) -> Array:
    """How bare surfaces are at each frame, 0 to 1, (N,); zero in a model without bare surfaces.

    Args:
        model: of the scene.
        qpos: configuration of the robot at each frame, (N, nq).
        stamps_ns: of the frames, (N,).
    """
    index = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_NUMERIC, _NUMERIC)
    if index < 0:
        return np.zeros(len(qpos))
    bare_from = float(model.numeric(_NUMERIC).data[0])
    share = _share_of_way(qpos[:, :3], stamps_ns)
    return np.asarray(_BAREST * np.clip((share - bare_from) / _FADING + 1.0, 0.0, 1.0))


def _share_of_way(positions: Array, stamps_ns: IntArray) -> Array:
    """Share of the way walked at each frame (N,), in steps of a second: sway within a second does not count."""
    seconds = (stamps_ns - stamps_ns[0]) * 1e-9
    knots = np.arange(0.0, seconds[-1] + 1.0, 1.0)
    places = np.stack([np.interp(knots, seconds, column) for column in positions.T], axis=1)
    walked = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(places, axis=0), axis=1)))
    return np.asarray(np.interp(seconds, knots, walked / max(walked[-1], 1e-9)))
