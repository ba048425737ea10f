# SPDX-License-Identifier: BSD-3-Clause
"""Extensions from outside the package: modes, contact estimators, feedback policies, formats of recordings.

A plugin is a Python module that registers what it has when it is imported. Installed packages name theirs as entry
points of the group ``coclo_vio.plugins``; a single file or module is named by the environment variable
``COCLO_VIO_PLUGINS``, several separated by the system's path separator.
"""

import importlib
import importlib.util
import os
import sys
from collections.abc import Callable, Iterator
from functools import cache, partial
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path

from coclo_vio.values.errors import ConfigError

VARIABLE = "COCLO_VIO_PLUGINS"
_GROUP = "coclo_vio.plugins"
_being_loaded: list[str] = []
_loaded: dict[str, Exception | None] = {}  # by name, and why it cannot be imported


def load_plugins() -> None:
    """Import every plugin that is not imported yet.

    Raises:
        ConfigError: a plugin cannot be imported; names it, the reason and the next step, at every call.
    """
    if _being_loaded:  # a plugin that uses the package asks for plugins too
        return
    for name, load, remedy in _named():
        if name not in _loaded:
            _being_loaded.append(name)
            try:
                _loaded[name] = _error_of(load)
            finally:
                _being_loaded.pop()
        error = _loaded[name]
        if error is not None:
            reason = f"{type(error).__name__}: {error}"
            raise ConfigError(f"the plugin {name!r} cannot be loaded ({reason}); mend it, or {remedy}") from error


def _named() -> Iterator[tuple[str, Callable[[], object], str]]:
    """Name, import and way to do without of each plugin."""
    for point in _entry_points():
        yield point.value, point.load, "uninstall the package that names it as an entry point"
    for name in filter(None, os.environ.get(VARIABLE, "").split(os.pathsep)):
        key = str(Path(name).resolve()) if name.endswith(".py") else name
        yield key, partial(_module, key), f"take it out of {VARIABLE}"


@cache
def _entry_points() -> tuple[EntryPoint, ...]:
    return tuple(entry_points(group=_GROUP))


def _module(name: str) -> object:
    if not name.endswith(".py"):
        return importlib.import_module(name)
    path = Path(name)
    specification = importlib.util.spec_from_file_location(f"coclo_vio_plugin_{path.stem}_{abs(hash(name)):x}", path)
    if specification is None or specification.loader is None or not path.is_file():
        raise ImportError(f"there is no file {path}")
    module = importlib.util.module_from_spec(specification)
    sys.modules[specification.name] = module
    specification.loader.exec_module(module)
    return module


def _error_of(load: Callable[[], object]) -> Exception | None:
    try:
        load()
    except Exception as error:
        return error
    return None
