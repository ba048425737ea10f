# SPDX-License-Identifier: BSD-3-Clause
"""What tables and figures have to know of a trajectory besides its poses: label, line, and what it is compared with.

Modes register the kinds of trajectories that they give (``runs.modes``); everything that shows trajectories asks here.
An unregistered trajectory, such as another program's TUM file, has a kind made from its name.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

from coclo_vio.values.errors import ConfigError

# Okabe and Ito, "Color universal design", 2008: distinguishable with any colour vision.
_UNREGISTERED_COLOURS = ("#d55e00", "#56b4e9", "#8c5a2b", "#5a5a5a")


@dataclass(frozen=True, slots=True)
class TrajectoryKind:
    """How one kind of trajectory is named, drawn and compared.

    Attributes:
        name: of its files and its key in JSON, such as ``combined_coclo``.
        label: in sentences and table heads, such as ``combined COCLO``.
        colour: of its line in all figures, ``#rrggbb``; a colour made from the name if empty.
        line_width: points.
        line_style: as in matplotlib, ``-``, ``--``, ``:`` or ``-.``.
        layer: lines of a higher layer are drawn above others.
        standalone: the trajectory of the same estimator without fusion, which this one is to be better than; None where
            the estimator runs alone.
        is_featured: whether it leads tables and sets the scale of figures; baselines do not.
        paper_drift_percent: by trial, the paper's Table I for this estimator on its own robot, percent of the net
            displacement.
    """

    name: str
    label: str = ""
    colour: str = ""
    line_width: float = 1.2
    line_style: str = "-"
    layer: int = 4
    standalone: str | None = None
    is_featured: bool = False
    paper_drift_percent: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not self.label:
            object.__setattr__(self, "label", self.name)
        if not self.colour:
            index = sum(self.name.encode()) % len(_UNREGISTERED_COLOURS)
            object.__setattr__(self, "colour", _UNREGISTERED_COLOURS[index])


_REGISTERED: dict[str, TrajectoryKind] = {}
_RANKS: dict[str, int] = {}


def register_trajectory_kind(kind: TrajectoryKind, rank: int = 100) -> None:
    """Make a kind known under its name.

    Args:
        kind: what is registered.
        rank: its place in listings, the lowest first.

    Raises:
        ConfigError: another kind has this name.
    """
    known = _REGISTERED.setdefault(kind.name, kind)
    if known != kind:
        raise ConfigError(f"two modes give a trajectory named {kind.name!r}; give one of them another name")
    _RANKS.setdefault(kind.name, rank)


def unregister_trajectory_kind(name: str) -> None:
    """Forget a kind, if there is one of this name."""
    _REGISTERED.pop(name, None)
    _RANKS.pop(name, None)


def trajectory_kind(name: str) -> TrajectoryKind:
    """The kind of this name; one made from the name where none is registered."""
    return _REGISTERED.get(name) or TrajectoryKind(name)


def registered_trajectory_kinds() -> Mapping[str, TrajectoryKind]:
    """All registered kinds by name, in the order of their ranks, those of one rank as they were registered."""
    return MappingProxyType(dict(sorted(_REGISTERED.items(), key=lambda item: _RANKS[item[0]])))
