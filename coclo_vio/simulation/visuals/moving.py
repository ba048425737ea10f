# SPDX-License-Identifier: BSD-3-Clause
"""Persons that walk to and fro beside the way: textured boxes on bodies that the renderer moves.

The model carries how they walk, so that any process can place them at any time.
"""

import mujoco
import numpy as np

from coclo_vio.simulation.visuals.room import RoomBounds

_PREFIX = "moving_"
_INSIDE_M = 0.55  # of the line they walk from the edge of the walked area
_SPEED_MPS = (0.3, 0.9)


def add_walker(spec: mujoco.MjSpec, number: int, walked: RoomBounds, rng: np.random.Generator) -> mujoco.MjsBody:
    """A body without shape that walks along one side of the walked area.

    Args:
        spec: the model, changed in place.
        number: of the body.
        walked: the walked area.
        rng: decides where, how fast and from where it walks.
    """
    low = np.array([walked.xmin, walked.ymin]) + _INSIDE_M
    high = np.array([walked.xmax, walked.ymax]) - _INSIDE_M
    first, last = low.copy(), high.copy()
    along = 0 if high[0] - low[0] > high[1] - low[1] else int(rng.integers(2))
    first[1 - along] = last[1 - along] = (low, high)[int(rng.integers(2))][1 - along]
    speed_mps, phase = rng.uniform(*_SPEED_MPS), rng.uniform(0.0, 2.0)
    spec.add_numeric(name=f"{_PREFIX}{number}", size=6, data=[*first, *last, speed_mps, phase])
    return spec.worldbody.add_body(name=f"{_PREFIX}{number}", mocap=True)


def place_walkers(model: mujoco.MjModel, data: mujoco.MjData, time_s: float) -> None:
    """Set the poses of all walkers at a time since the first frame, s."""
    for index in range(model.nnumeric):
        name = model.numeric(index).name
        if name.startswith(_PREFIX):
            x0, y0, x1, y1, speed_mps, phase = model.numeric(index).data
            length_m = float(np.hypot(x1 - x0, y1 - y0))
            turns = (phase + speed_mps * time_s / length_m) % 2.0
            share, heading = (turns, 0.0) if turns < 1.0 else (2.0 - turns, np.pi)
            yaw = np.arctan2(y1 - y0, x1 - x0) + heading
            mocap = model.body(name).mocapid[0]
            data.mocap_pos[mocap] = [x0 + share * (x1 - x0), y0 + share * (y1 - y0), 0.0]
            data.mocap_quat[mocap] = [np.cos(0.5 * yaw), 0.0, 0.0, np.sin(0.5 * yaw)]
