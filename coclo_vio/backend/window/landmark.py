# SPDX-License-Identifier: BSD-3-Clause
"""A landmark: where it is, and which keyframes observe it."""

from dataclasses import dataclass, field

import numpy as np

from coclo_vio.values.arrays import Array


@dataclass(slots=True, eq=False)
class Landmark:
    """A point of the world.

    Attributes:
        track_id: the track that observes it.
        point_world: its position, m, (3,); None until it can be placed.
        covariance: of the position, the observing poses taken as known, m^2, (3, 3); None until it is placed.
        observations: by the number of the keyframe: left column, row, right column (NaN: no match), px, (3,).
        depth_keyframe: the keyframe whose disparity placed it; None as long as there is none.
        is_in_prior: whether the marginal prior contains it.
        is_retired: whether it was found wrong: it gets no more observations, and leaves at the next marginalisation.
    """

    track_id: int
    point_world: Array | None = None
    covariance: Array | None = None
    observations: dict[int, Array] = field(default_factory=dict)
    depth_keyframe: int | None = None
    is_in_prior: bool = False
    is_retired: bool = False

    @property
    def is_solvable(self) -> bool:
        """Whether it connects keyframes: it is placed, and observed by more than one of them or in the prior."""
        return self.is_in_prior or (self.point_world is not None and len(self.observations) > 1)

    def observe(self, number: int, observation: Array) -> None:
        """Add the observation (3,) by keyframe ``number``; the first disparity is the one that places it."""
        self.observations[number] = observation
        if self.depth_keyframe is None and not np.isnan(observation[2]):
            self.depth_keyframe = number
