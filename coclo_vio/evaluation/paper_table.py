# SPDX-License-Identifier: BSD-3-Clause
"""What the paper reports of its own robot: Table I, to stand beside ours and never among ours.

Source: "State Estimation for Legged Robots Using Contact-Centric Leg Odometry", Table I and section V. A real Daisy,
one recording a trial, stereo with a 50 mm base line at 15 Hz. The figure is the position error over the ground truth's
net displacement, ``Evaluation.paper_drift_percent`` here; for the flat square taken after the first metre. Each mode
declares the figures of its own trajectories.
"""

from collections.abc import Iterable

from coclo_vio.values.trajectory_kind import registered_trajectory_kinds, trajectory_kind

PAPER_MARK = "paper, another robot's data"
"""How figures of the paper are marked wherever they are shown."""


def paper_table() -> dict[str, dict[str, float]]:
    """Drift, percent of net displacement, by trial and trajectory."""
    table: dict[str, dict[str, float]] = {}
    for name, kind in registered_trajectory_kinds().items():
        for trial, drift_percent in kind.paper_drift_percent.items():
            table.setdefault(trial, {})[name] = drift_percent
    return table


def is_in_paper(names: Iterable[str]) -> bool:
    """Whether the paper has a figure for any of these trajectories."""
    return any(trajectory_kind(name).paper_drift_percent for name in names)
