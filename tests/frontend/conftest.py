# SPDX-License-Identifier: BSD-3-Clause
import numpy as np
import pytest
from textured_room import Room, rig, walk

from coclo_vio.values.measurements import StereoFrame

FRAMES = 10


@pytest.fixture(scope="session")
def room() -> Room:
    return Room(rig())


@pytest.fixture(scope="session")
def walked(room: Room) -> tuple[list[StereoFrame], np.ndarray]:
    """A short walk: frames, and T_world_camera of the left camera in each."""
    return walk(room, FRAMES)
