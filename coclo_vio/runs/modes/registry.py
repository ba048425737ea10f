# SPDX-License-Identifier: BSD-3-Clause
"""All modes by name: those in this folder, and those that plugins register.

A file in this folder declares its modes as ``MODES``; nothing else has to know of it.
"""

import importlib
import pkgutil
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from types import MappingProxyType

from coclo_vio.runs.modes.mode import Mode
from coclo_vio.runs.plugins import load_plugins
from coclo_vio.values.errors import ConfigError, listing
from coclo_vio.values.trajectory_kind import register_trajectory_kind, unregister_trajectory_kind

_MODES: dict[str, Mode] = {}
_NOT_MODES = ("mode", "registry")


def modes() -> Mapping[str, Mode]:
    """All modes by name, in the order of their ranks.

    Raises:
        ConfigError: a plugin cannot be imported.
    """
    _register_own()
    load_plugins()
    return MappingProxyType({mode.name: mode for mode in sorted(_MODES.values(), key=lambda mode: mode.rank)})


def mode_of(name: str) -> Mode:
    """The mode of this name.

    Raises:
        ConfigError: there is none; lists those there are.
    """
    found = modes().get(name)
    if found is None:
        raise ConfigError(f"there is no mode {name!r}; the modes are: {listing(modes())}")
    return found


def register_mode(mode: Mode) -> None:
    """Make a mode available to every command and function.

    Raises:
        ConfigError: another mode has its name, or gives a trajectory of the same name.
    """
    _register_own()
    _register(mode)


def unregister_mode(name: str) -> None:
    """Forget a mode and the kinds of its trajectories, if there is one of this name."""
    mode = _MODES.pop(name, None)
    for kind in () if mode is None else mode.trajectories:
        unregister_trajectory_kind(kind.name)


def _register(mode: Mode) -> None:
    if mode.name in _MODES:
        raise ConfigError(f"there is a mode {mode.name!r} already; register yours under another name")
    for other in _MODES.values():
        shared = set(mode.trajectory_names) & set(other.trajectory_names)
        if shared:
            raise ConfigError(
                f"the modes {other.name!r} and {mode.name!r} both give a trajectory named {min(shared)!r}; give yours "
                "another name"
            )
    for kind in mode.trajectories:
        register_trajectory_kind(kind, mode.rank)
    _MODES[mode.name] = mode


@cache
def _register_own() -> None:
    """Register the modes of this folder; once."""
    found: list[Mode] = []
    for name in sorted(module.name for module in pkgutil.iter_modules([str(Path(__file__).parent)])):
        if name not in _NOT_MODES:
            found += importlib.import_module(f"coclo_vio.runs.modes.{name}").MODES
    for mode in sorted(found, key=lambda mode: mode.rank):
        _register(mode)
