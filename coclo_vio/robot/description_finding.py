# SPDX-License-Identifier: BSD-3-Clause
"""One contradiction between a robot's description and its URDF, as a sentence with its remedy."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class DescriptionFinding:
    """What the check of a description found.

    Attributes:
        kind: of finding, such as ``joint_in_no_leg``.
        is_error: whether estimates are wrong until it is corrected; otherwise it is to be looked at.
        sentence: names the value, what the URDF says, and the next step.
        remedy: settings of the robot's YAML that correct it, such as ``legs[FL].foot_frame: FL_foot``; empty where
            none does.
    """

    kind: str
    is_error: bool
    sentence: str
    remedy: tuple[str, ...] = ()
