# SPDX-License-Identifier: BSD-3-Clause
"""Which trajectories lead, stand alone or are fused: what follows from the kinds that modes register.

Tables, figures and the ranking use these, and hold no name of a mode.
"""

from collections.abc import Iterable

from coclo_vio.values.trajectory_kind import registered_trajectory_kinds, trajectory_kind


def in_order(names: Iterable[str]) -> list[str]:
    """Names as tables and legends list them: featured ones first, then as registered, then as given."""
    given = list(dict.fromkeys(names))
    registered = list(registered_trajectory_kinds())

    def place(name: str) -> tuple[bool, int]:
        return not trajectory_kind(name).is_featured, registered.index(name) if name in registered else len(registered)

    return sorted(given, key=place)


def featured(names: Iterable[str]) -> list[str]:
    """Those of the names that lead, in order; all names where none does."""
    given = list(names)
    return [name for name in in_order(given) if trajectory_kind(name).is_featured] or given


def is_fused(name: str) -> bool:
    """Whether the trajectory comes out of a fusion, so that it has a standalone counterpart."""
    return trajectory_kind(name).standalone is not None


def fused_pairs(names: Iterable[str] | None = None) -> list[tuple[str, str]]:
    """Fused trajectories with their standalone counterparts, in the order of registration.

    Args:
        names: pairs of which both are among these; all registered pairs where None.
    """
    pairs = [(kind.name, kind.standalone) for kind in registered_trajectory_kinds().values() if kind.standalone]
    among = None if names is None else set(names)
    return [pair for pair in pairs if among is None or set(pair) <= among]


def standalone_names() -> list[str]:
    """The standalone counterparts of all registered kinds, each once, in the order in which their pairs are."""
    return list(dict.fromkeys(standalone for _, standalone in fused_pairs()))
