# SPDX-License-Identifier: BSD-3-Clause
"""What the paper reports of its own robot: Table I, to stand beside ours and never among ours.

Source: "State Estimation for Legged Robots Using Contact-Centric Leg Odometry", Table I and section V. A real Daisy,
one recording a trial, stereo with a 50 mm base line at 15 Hz. The figure is the position error over the ground truth's
net displacement, ``Evaluation.paper_drift_percent`` here; for the flat square taken after the first metre.
"""

from collections.abc import Mapping
from types import MappingProxyType

PAPER_MARK = "paper, another robot's data"
"""How figures of the paper are marked wherever they are shown."""

PAPER_TABLE_I: Mapping[str, Mapping[str, float]] = MappingProxyType(
    {
        "flat": MappingProxyType({"coclo": 1.01, "vins": 1.65, "combined_coclo": 1.57, "combined_vins": 1.46}),
        "ramp": MappingProxyType({"coclo": 6.51, "vins": 22.04}),
        "stairs": MappingProxyType({"coclo": 7.28, "vins": 8.55, "combined_coclo": 2.61, "combined_vins": 5.28}),
    }
)
"""Drift, percent of net displacement, by trial and estimator; the paper combined nothing on the ramp."""

PAPER_COLUMNS: Mapping[str, str] = MappingProxyType(
    {"coclo": "COCLO", "vins": "VINS", "combined_coclo": "combined COCLO", "combined_vins": "combined VINS"}
)
"""The estimators of Table I by ours, in its order."""
