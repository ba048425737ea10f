# SPDX-License-Identifier: BSD-3-Clause
"""Parameters of the bridge between leg odometry and vision."""

from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, field_validator

from coclo_vio.fusion.feedback import PolicyParameters, feedback_policies
from coclo_vio.values.config import StageConfig


def _policy_name(value: Any) -> Any:
    return "off" if value is False else value  # YAML reads a plain off as false


class BridgeConfig(StageConfig):
    """What goes from the smoother back to the filter, and when."""

    feedback: Annotated[
        str,
        BeforeValidator(_policy_name),
        Field(description="name of a feedback policy, such as off, paper, ci, decorrelated, or one of a plugin"),
    ] = "decorrelated"
    vision_latency_s: Annotated[
        float, Field(ge=0, le=5, description="a frame's result reaches the filter this long after its stamp, s")
    ] = 0.05
    frame_threads: Annotated[
        int,
        Field(ge=0, le=1, description="threads beside the filter's that process frames until their results are due"),
    ] = 0
    vision: Annotated[
        Literal["auto", "in_turn", "beside"],
        Field(
            description="in_turn: outputs depend on the measurements alone; beside: frames are processed by another "
            "process and results taken as they come, so that joint samples never wait; auto: beside in play and "
            "live, else in_turn"
        ),
    ] = "auto"
    vision_timeout_s: Annotated[
        float, Field(gt=0, le=600, description="beside: a frame in process for longer starts that process anew, s")
    ] = 5.0
    min_novel_share: Annotated[
        float,
        Field(ge=0, lt=0.5, description="directions in which a smaller share of a marginal is novel count as known"),
    ] = 1e-4
    floor_m: Annotated[
        float, Field(gt=0, le=0.1, description="smallest sigma of the filter's motion between keyframes, m and rad")
    ] = 1e-4

    @field_validator("feedback")
    @classmethod
    def _is_registered(cls, name: str) -> str:
        if name not in feedback_policies():
            raise ValueError(f"{name!r} is no feedback policy; there are: {', '.join(feedback_policies())}")
        return name

    @property
    def policy_parameters(self) -> PolicyParameters:
        """What a policy gets of this."""
        return PolicyParameters(self.min_novel_share, self.floor_m)
