# SPDX-License-Identifier: BSD-3-Clause
"""The timing of a trot: which legs are to stand and which to swing, with jitter, and the state of each leg."""

from dataclasses import dataclass, field
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from coclo_vio.values.arrays import Array
from coclo_vio.values.config import StageConfig

LegPhase = Literal["stance", "swing", "reach"]  # reach: the swing is over and the foot has found no ground


class TrotGaitConfig(StageConfig):
    """The trot. Diagonal legs swing together; the other pair follows half a period later."""

    speed_mps: Annotated[float, Field(gt=0, le=2, description="along the path, m/s")] = 0.6
    distance_m: Annotated[float, Field(gt=0.5, le=1000, description="length of the path, m")] = 50.0
    period_s: Annotated[float, Field(ge=0.25, le=1, description="of a stride, s")] = 0.45
    duty: Annotated[
        float | None,
        Field(ge=0.4, le=0.7, description="share of a stride in stance; null: 0.58 at rest, 0.07 less per m/s"),
    ] = None
    height_m: Annotated[
        float | None, Field(gt=0.1, le=0.8, description="of the body over the ground, m; null: the robot's")
    ] = None
    clearance_m: Annotated[float, Field(gt=0, le=0.2, description="of a swing foot over the highest ground, m")] = 0.07
    touch_speed_mps: Annotated[float, Field(gt=0, le=1, description="of the foot at touch-down, m/s")] = 0.8
    turn_rate_radps: Annotated[float, Field(gt=0, le=2, description="largest, in corners, rad/s")] = 0.8
    acceleration_mps2: Annotated[float, Field(gt=0, le=3, description="at the start and before the end")] = 0.5
    speed_jitter: Annotated[float, Field(ge=0, le=0.3, description="slow, standard deviation, relative")] = 0.06
    period_jitter: Annotated[float, Field(ge=0, le=0.2, description="standard deviation, a stride, relative")] = 0.03
    duty_jitter: Annotated[float, Field(ge=0, le=0.1, description="standard deviation, each swing")] = 0.012
    foothold_jitter_m: Annotated[float, Field(ge=0, le=0.05, description="standard deviation, each axis, m")] = 0.01
    clearance_jitter_m: Annotated[float, Field(ge=0, le=0.05, description="standard deviation, m")] = 0.01

    @property
    def stance_share(self) -> float:
        """Share of a stride in stance."""
        return self.duty if self.duty is not None else 0.58 - 0.07 * self.speed_mps


@dataclass(slots=True)
class LegState:
    """A leg in its stride.

    Attributes:
        offset: of its phase, strides.
        duty: share of this stride in stance.
        phase: what it does.
        since_s: when it began to.
        lifted_stride: number of the stride in which it has swung last.
        start: of its foot at lift-off, world, m, (3,).
        goal: of its foot, world, m, (3,).
        jitter: of this swing's foothold and clearance, standard normal, (3,).
    """

    offset: float
    duty: float
    phase: LegPhase = "stance"
    since_s: float = -1.0
    lifted_stride: int = -1
    start: Array = field(default_factory=lambda: np.zeros(3))
    goal: Array = field(default_factory=lambda: np.zeros(3))
    jitter: Array = field(default_factory=lambda: np.zeros(3))


class TrotGait:
    """The phases of all legs.

    Args:
        config: of the gait.
        hips: positions of the legs' first joints, body frame, (legs, 3): diagonal legs share a phase.
        generator: of the jitter.
    """

    def __init__(self, config: TrotGaitConfig, hips: Array, generator: np.random.Generator) -> None:
        self._config = config
        self._generator = generator
        self._strides = 0.0
        self._rate = 1.0
        self.period_s = config.period_s
        self.legs = [LegState(0.0 if x * y > 0.0 else 0.5, config.stance_share) for x, y, _ in hips]

    @property
    def swing_s(self) -> float:
        """Duration of a swing."""
        return (1.0 - self._config.stance_share) * self.period_s

    @property
    def stance_s(self) -> float:
        """Duration of a stance."""
        return self._config.stance_share * self.period_s

    def advance(self, dt_s: float) -> None:
        """Let the time of a control period pass; every stride has another duration."""
        before = int(self._strides)
        self._strides += dt_s / self.period_s
        if int(self._strides) > before:
            spread = np.clip(self._generator.standard_normal(), -2.0, 2.0)
            self.period_s = self._config.period_s * (1.0 + self._config.period_jitter * float(spread))

    def swing_share(self, leg: LegState) -> float:
        """Elapsed share of a leg's planned swing, 0 to 1; below 0 while it is to stand."""
        phase = (self._strides + leg.offset) % 1.0
        return (phase - leg.duty) / (1.0 - leg.duty) if phase >= leg.duty else -1.0

    def to_lift_s(self, leg: LegState) -> float:
        """Time to the leg's planned lift-off, s."""
        return ((leg.duty - self._strides - leg.offset) % 1.0) * self.period_s

    def may_lift(self, leg: LegState) -> bool:
        """Whether a standing leg's swing is to begin."""
        return leg.phase == "stance" and 0.0 <= self.swing_share(leg) < 0.4 and leg.lifted_stride != self._stride(leg)

    def lift(self, leg: LegState, foot: Array, time_s: float) -> None:
        """Begin the swing of a leg whose foot is at ``foot``, world, m, (3,)."""
        leg.phase, leg.since_s, leg.lifted_stride = "swing", time_s, self._stride(leg)
        leg.start, leg.goal = foot.copy(), foot.copy()
        leg.jitter = np.clip(self._generator.standard_normal(3), -2.0, 2.0)

    def land(self, leg: LegState, time_s: float) -> None:
        """The foot of a leg has found the ground; its next stance has another duration."""
        leg.phase, leg.since_s = "stance", time_s
        spread = float(np.clip(self._generator.standard_normal(), -2.0, 2.0))
        if self.swing_share(leg) < 0.0:
            leg.duty = self._config.stance_share + self._config.duty_jitter * spread

    def _stride(self, leg: LegState) -> int:
        return int(self._strides + leg.offset)
