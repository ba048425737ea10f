# SPDX-License-Identifier: BSD-3-Clause
"""The motion of the body from the last joint sample to a camera frame, forward or back.

Forward, a frame between joint samples, rate and velocity are constant. Back, a frame that came late, the motion is what
the filter went through since then; right-invariant errors of a pose stay as they are along a known motion, and the
error of that motion is taken as that of rate and velocity, constant over it, which is conservative.
"""

from collections import deque
from dataclasses import dataclass

import numpy as np

from coclo_vio.filter.config import FilterConfig
from coclo_vio.filter.square_root_filter import SquareRootFilter
from coclo_vio.filter.state import POSITION, RATE, VELOCITY, State
from coclo_vio.geometry import se3, so3
from coclo_vio.values.arrays import Array
from coclo_vio.values.units import NS_PER_S


@dataclass(frozen=True, slots=True, eq=False)
class FrameMotion:
    """From the present to a frame.

    Attributes:
        dt_s: for which rate and velocity are constant, s; 0 for a frame in the past.
        noise: one sigma of rotation (rad) and motion (m) beyond that, each axis.
        T_now_frame: (4, 4), of a frame in the past; None of others.
    """

    dt_s: float
    noise: tuple[float, float] = (0.0, 0.0)
    T_now_frame: Array | None = None

    def pose(self, mean: State) -> Array:
        """``T_world_body`` at the frame, (4, 4)."""
        rotation, position, dt_s = mean.rotation, mean.vector[POSITION], self.dt_s
        if self.T_now_frame is not None:
            return np.asarray(se3.transform(rotation, position) @ self.T_now_frame)
        return se3.transform(rotation @ so3.exp(mean.vector[RATE] * dt_s), position + mean.vector[VELOCITY] * dt_s)

    def now(self, mean: State, T_world_body: Array) -> tuple[Array, Array]:
        """Rotation (3, 3) and position (3,) now, of a body with this pose at the frame; inverse of ``pose``."""
        if self.T_now_frame is not None:
            here = T_world_body @ se3.inverse(self.T_now_frame)
            return here[:3, :3], here[:3, 3]
        turn = so3.exp(-mean.vector[RATE] * self.dt_s)
        return T_world_body[:3, :3] @ turn, T_world_body[:3, 3] - mean.vector[VELOCITY] * self.dt_s


@dataclass(frozen=True, slots=True, eq=False)
class _Step:
    """Motion of the body over one step: in axes of the body at its start."""

    start_ns: int
    end_ns: int
    rotation: Array
    motion: Array


class BodyTrail:
    """The last motions of the body, step by step; corrections between steps are no motion."""

    def __init__(self, config: FilterConfig) -> None:
        """Take the filter's configuration."""
        self._config = config
        self._deflection_s = 0.0 if config.profile == "paper" else config.robust.step_deflection_s
        self._steps: deque[_Step] = deque()

    def add(self, before: State, start_ns: int, after: State, end_ns: int) -> None:
        """Remember a step, by the means at its ends."""
        to_body = before.rotation.T
        motion = to_body @ (after.vector[POSITION] - before.vector[POSITION])
        self._steps.append(_Step(start_ns, end_ns, to_body @ after.rotation, motion))
        while end_ns - self._steps[0].end_ns > self._config.max_frame_delay_s * NS_PER_S:
            self._steps.popleft()

    def reaches(self, stamp_ns: int, now_ns: int) -> bool:
        """Whether the motion back to a stamp is known."""
        if stamp_ns >= now_ns:
            return True
        is_near = now_ns - stamp_ns <= self._config.max_frame_delay_s * NS_PER_S
        return is_near and bool(self._steps) and self._steps[0].start_ns <= stamp_ns

    def motion_to(self, stamp_ns: int, now_ns: int, core: SquareRootFilter) -> FrameMotion:
        """The motion from the present to a stamp; beyond constant velocity only across a gap, or back."""
        dt_s = (stamp_ns - now_ns) / NS_PER_S
        deflection_m = self._deflection_s * float(np.linalg.norm(core.mean.vector[VELOCITY]))
        if dt_s < 0.0 and self.reaches(stamp_ns, now_ns):
            sigmas = [float(np.sqrt(core.variance(errors).mean())) for errors in (RATE, VELOCITY)]
            motion_m = float(np.hypot(sigmas[1] * dt_s, deflection_m))
            return FrameMotion(0.0, (-sigmas[0] * dt_s, motion_m), self._back_to(stamp_ns))
        if abs(dt_s) <= self._config.max_gap_s:
            return FrameMotion(dt_s, (0.0, deflection_m))
        robust, reach = self._config.robust, float(np.sqrt(abs(dt_s) ** 3 / 3.0))
        return FrameMotion(dt_s, (robust.angular_acceleration_density * reach, robust.acceleration_density * reach))

    def _back_to(self, stamp_ns: int) -> Array:
        """``T_now_frame``, (4, 4); within a step rate and velocity are constant."""
        back = np.eye(4)
        for step in reversed(self._steps):
            if step.end_ns <= stamp_ns:
                break
            rotation, motion = step.rotation, step.motion
            if step.start_ns < stamp_ns:
                share = (step.end_ns - stamp_ns) / (step.end_ns - step.start_ns)
                rotation, motion = so3.exp(share * so3.log_below_pi(rotation)), share * motion
            back = back @ se3.inverse(se3.transform(rotation, motion))
        left, _, right = np.linalg.svd(back[:3, :3])  # rounding would add up from one restart of a filter to the next
        back[:3, :3] = left @ right
        return np.asarray(back)
