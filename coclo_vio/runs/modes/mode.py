# SPDX-License-Identifier: BSD-3-Clause
"""What a mode declares: the one place from which listings, choices, tables, figures and help are derived."""

from collections.abc import Callable
from dataclasses import dataclass, field
from enum import Enum
from typing import TYPE_CHECKING

from coclo_vio.values.measurements import IMAGE_SENSORS, IMU_SENSORS, LEG_SENSORS, BodyTwistSample
from coclo_vio.values.outputs import Estimator
from coclo_vio.values.trajectory_kind import TrajectoryKind

if TYPE_CHECKING:
    from coclo_vio.runs.equipment import Equipment
    from coclo_vio.runs.run_config import RunConfig


class Need(Enum):
    """What a mode cannot do without."""

    LEGS = "legs"
    """A robot, its joint samples, its contact sensing and the body's IMU."""
    CAMERAS = "cameras"
    """Stereo images or tracks, and the cameras' calibration."""
    IMU = "imu"
    """An IMU that goes with the cameras, and its calibration."""
    BODY_TWIST = "body_twist"
    """Body twists of another source."""


_SENSORS: dict[Need, frozenset[type]] = {
    Need.LEGS: LEG_SENSORS,
    Need.CAMERAS: IMAGE_SENSORS,
    Need.IMU: IMU_SENSORS,
    Need.BODY_TWIST: frozenset({BodyTwistSample}),
}


class Compared(Enum):
    """Whether ``compare`` runs a mode by default."""

    ALWAYS = "always"
    WITHOUT_LEGS = "without legs"
    ON_REQUEST = "on request"


@dataclass(frozen=True, slots=True)
class Mode:
    """One way to estimate.

    Attributes:
        name: on the command line, such as ``combined``.
        summary: what it is, in a line.
        needs: what it cannot do without.
        make: from what a recording has and a configuration to a fresh estimator.
        trajectories: the kinds of trajectories that it gives, that of the highest rate first; one of the mode's own
            name if none is given.
        uses: what it uses where a recording has it, besides its needs.
        rank: place in listings, the lowest first.
        default_rank: of the modes that a recording is enough for ``run`` takes the one with the lowest; None: never.
        compared: whether ``compare`` runs it by default.
        table: whether ``table`` runs it by default.
        has_feedback: whether ``bridge.feedback`` acts in it, so that ``table`` can compare policies.
    """

    name: str
    summary: str
    needs: frozenset[Need]
    make: Callable[["Equipment", "RunConfig"], Estimator]
    trajectories: tuple[TrajectoryKind, ...] = ()
    uses: frozenset[Need] = frozenset()
    rank: int = 100
    default_rank: int | None = None
    compared: Compared = Compared.ALWAYS
    table: bool = False
    has_feedback: bool = False
    sensors: frozenset[type] = field(init=False)

    def __post_init__(self) -> None:
        if not self.trajectories:
            object.__setattr__(self, "trajectories", (TrajectoryKind(self.name),))
        sensors: frozenset[type] = frozenset().union(*(_SENSORS[need] for need in self.needs | self.uses))
        object.__setattr__(self, "sensors", sensors)

    @property
    def has_legs(self) -> bool:
        """Whether it needs a robot."""
        return Need.LEGS in self.needs

    @property
    def has_cameras(self) -> bool:
        """Whether it needs cameras."""
        return Need.CAMERAS in self.needs

    @property
    def trajectory_names(self) -> tuple[str, ...]:
        """Of the trajectories that it gives."""
        return tuple(kind.name for kind in self.trajectories)

    def sensors_of(self, equipment: "Equipment") -> frozenset[type]:
        """The sensors that it reads of this equipment; of two IMUs a visual mode reads the one with the cameras."""
        if self.has_legs:
            return self.sensors & (LEG_SENSORS | equipment.sensors)
        return self.sensors & equipment.sensors - (IMU_SENSORS - {equipment.vision_imu})
