# SPDX-License-Identifier: BSD-3-Clause
"""The two trajectories of legs and vision together, with errors of vision that last in their covariance.

Filter and window take each motion between keyframes for independent of the one before. Errors that are the same all
along change no estimate, as nothing shows them, and stay out of what the two exchange. Stereo scale and mounting are
states of the filter, and not among them.
"""

from dataclasses import replace

import numpy as np

from coclo_vio.backend.window.config import SmootherConfig
from coclo_vio.backend.window.lasting_errors import LastingErrors
from coclo_vio.values.arrays import Array
from coclo_vio.values.estimates import StateEstimate
from coclo_vio.values.outputs import Estimate


class FusedEstimates:
    """Makes the outputs of an estimator at its frames and at its joint samples."""

    def __init__(self, joint_name: str, frame_name: str, config: SmootherConfig | None = None) -> None:
        """Name them.

        Args:
            joint_name: of the trajectory at the joint rate.
            frame_name: of that at the rate of the frames.
            config: how wrong the direction and the heading by vision may be; not at all if None.
        """
        self._joint_name, self._frame_name = joint_name, frame_name
        self._errors = LastingErrors(
            direction_sigma_rad=0.0 if config is None else config.direction_sigma_rad,
            heading_sigma=0.0 if config is None else config.heading_sigma,
        )
        self._added: Array | None = None  # covariance that they add at the last frame, all of it in world axes, (9, 9)

    def of_frame(self, estimate: StateEstimate) -> Estimate:
        """The estimate of the next frame."""
        T_world_body = estimate.nav.T_world_body
        self._errors.follow(T_world_body)
        to_world = _to_world(T_world_body)
        self._added = to_world @ self._errors.covariance(T_world_body, estimate.nav.velocity_world) @ to_world.T
        return Estimate(self._frame_name, self._with_errors(estimate))

    def of_joints(self, estimate: StateEstimate) -> Estimate:
        """An estimate after the last frame."""
        return Estimate(self._joint_name, self._with_errors(estimate))

    def _with_errors(self, estimate: StateEstimate) -> StateEstimate:
        if self._added is None:
            return estimate
        to_world = _to_world(estimate.nav.T_world_body)
        return replace(estimate, covariance=estimate.covariance + to_world.T @ self._added @ to_world)


def _to_world(T_world_body: Array) -> Array:
    """From the axes of the covariance of ``StateEstimate`` to those of the world, (9, 9)."""
    to_world = np.eye(9)
    to_world[:3, :3] = to_world[3:6, 3:6] = T_world_body[:3, :3]
    return to_world
