# SPDX-License-Identifier: BSD-3-Clause
"""Modules that import a library which is not installed unless somebody asks for it."""

import importlib
from typing import Any

from coclo_vio.values.errors import ConfigError


def with_library(module: str, library: str, extra: str) -> Any:
    """A module of this package that imports an optional library.

    Args:
        module: its full name.
        library: that it imports.
        extra: that brings the library.

    Raises:
        ConfigError: the library is not installed.
    """
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError as error:
        if error.name is None or error.name.partition(".")[0] != library:
            raise
        raise ConfigError(f"this wire needs {library}, which is an extra: pip install 'coclo-vio[{extra}]'") from error
