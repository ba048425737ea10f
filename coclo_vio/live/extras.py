# SPDX-License-Identifier: BSD-3-Clause
"""Libraries that are not installed unless somebody asks for them."""

import importlib
from typing import Any

from coclo_vio.values.errors import ConfigError


def imported(module: str, wanting: str, extra: str) -> Any:
    """A module of an extra.

    Args:
        module: its name.
        wanting: what needs it.
        extra: that brings it.

    Raises:
        ConfigError: it is not installed.
    """
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError as error:
        if error.name is None or error.name.partition(".")[0] != module.partition(".")[0]:
            raise
        raise ConfigError(
            f"{wanting} needs {module.partition('.')[0]}, which is an extra: pip install 'coclo-vio[{extra}]'"
        ) from error
