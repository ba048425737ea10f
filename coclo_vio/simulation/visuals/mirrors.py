# SPDX-License-Identifier: BSD-3-Clause
"""Specular patches on the ground, as of wet or polished floors: what they show moves unlike the ground."""

from collections.abc import Sequence

import mujoco
import numpy as np

from coclo_vio.simulation.visuals.config import SceneConfig
from coclo_vio.simulation.visuals.room import Face, RoomBounds, ground_at

_HALF_M = (0.5, 0.3, 0.002)
_GREY = 0.45
_INSIDE_M = 0.5  # of the walked area


def add_mirrors(
    spec: mujoco.MjSpec, ground: Sequence[Face], walked: RoomBounds, config: SceneConfig, rng: np.random.Generator
) -> None:
    """Add the patches; MuJoCo reflects the scene in the upper faces of boxes.

    Args:
        spec: the model, changed in place.
        ground: faces of the terrain above the floor.
        walked: the walked area.
        config: how many, and how much light they reflect.
        rng: decides where they are.
    """
    if config.mirrors == 0:
        return
    spec.add_material(name="mirror", rgba=[_GREY, _GREY, _GREY, 1.0], reflectance=config.mirror_share, specular=0.0)
    low = np.array([walked.xmin, walked.ymin]) + _INSIDE_M
    high = np.array([walked.xmax, walked.ymax]) - _INSIDE_M
    for number in range(config.mirrors):
        x, y = rng.uniform(low, high)
        z, normal = ground_at(ground, x, y)
        quat = np.empty(4)
        mujoco.mju_quatZ2Vec(quat, normal)
        spec.worldbody.add_geom(
            name=f"mirror_{number}",
            type=mujoco.mjtGeom.mjGEOM_BOX,
            pos=[x, y, z],
            quat=quat,
            size=_HALF_M,
            material="mirror",
            contype=0,
            conaffinity=0,
            mass=0.0,
            group=1,
        )
