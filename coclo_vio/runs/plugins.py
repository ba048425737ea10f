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
from collections.abc import Callable
from functools import partial
from importlib.metadata import entry_points
from pathlib import Path

from coclo_vio.values.errors import CocloError, ConfigError

VARIABLE = "COCLO_VIO_PLUGINS"
_GROUP = "coclo_vio.plugins"
_loaded: set[str] = set()


def load_plugins() -> None:
    """Import every plugin that is not imported yet.

    Raises:
        ConfigError: a plugin cannot be imported; names it and the reason.
    """
    for point in entry_points(group=_GROUP):
        if point.value not in _loaded:
            _loaded.add(point.value)
            _import(point.value, point.load)
    for name in filter(None, os.environ.get(VARIABLE, "").split(os.pathsep)):
        if name not in _loaded:
            _loaded.add(name)
            _import(name, partial(_module, name))


def _module(name: str) -> object:
    if not name.endswith(".py"):
        return importlib.import_module(name)
    path = Path(name)
    specification = importlib.util.spec_from_file_location(f"coclo_vio_plugin_{path.stem}", path)
    if specification is None or specification.loader is None or not path.is_file():
        raise ImportError(f"there is no file {path}")
    module = importlib.util.module_from_spec(specification)
    sys.modules[specification.name] = module
    specification.loader.exec_module(module)
    return module


def _import(name: str, load: Callable[[], object]) -> None:
    try:
        load()
    except CocloError:
        raise
    except Exception as error:
        raise ConfigError(
            f"the plugin {name!r} cannot be imported ({type(error).__name__}: {error}); mend it, or take it out of "
            f"{VARIABLE}"
        ) from error
