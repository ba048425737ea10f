# SPDX-License-Identifier: BSD-3-Clause
"""The fields of any object, by slots and attributes, and the classes that may be made from a file by name."""

import sys
from collections.abc import Iterable, Mapping
from importlib import import_module
from typing import Any

from coclo_vio.values.errors import CocloError, DatasetError

PACKAGE = "coclo_vio"


class CheckpointUnsupported(CocloError):  # noqa: N818 -- a condition
    """An estimator holds something that no checkpoint can keep."""


class CheckpointPostponed(CheckpointUnsupported):
    """An estimator is in a state that no checkpoint can keep; a later one can be kept."""


def fields_of(thing: object) -> dict[str, Any]:
    """The values in its slots and attributes, by name."""
    values = {name: getattr(thing, name) for name in _slots(type(thing)) if hasattr(thing, name)}
    return {**values, **getattr(thing, "__dict__", {})}


def set_fields(thing: object, values: Mapping[str, Any]) -> None:
    """Give it exactly these fields, frozen or not."""
    for name in fields_of(thing).keys() - values.keys():
        object.__delattr__(thing, name)
    for name, value in values.items():
        object.__setattr__(thing, name, value)


def _slots(kind: type) -> Iterable[str]:
    for each in kind.__mro__:
        declared = each.__dict__.get("__slots__", ())
        for name in (declared,) if isinstance(declared, str) else declared:
            if name not in ("__dict__", "__weakref__"):
                yield f"_{each.__name__.lstrip('_')}{name}" if name.startswith("__") and name[-2:] != "__" else name


def name_of(thing: Any) -> str:
    """``module:qualified.name`` of a class or of a function of a module.

    Raises:
        CheckpointUnsupported: it is local to a function.
    """
    if "<" in thing.__qualname__:
        raise CheckpointUnsupported(f"{thing.__qualname__} of {thing.__module__} has no name of its own")
    return f"{thing.__module__}:{thing.__qualname__}"


def named(name: str, known: Mapping[str, Any]) -> Any:
    """The class or function of a name: of this package, or one of ``known``; nothing else is imported.

    Raises:
        DatasetError: it is neither.
    """
    if name in known:
        return known[name]
    module, _, path = name.partition(":")
    if module != PACKAGE and not module.startswith(f"{PACKAGE}."):
        raise DatasetError(f"a checkpoint names {name}, which is no part of this package; begin anew with --overwrite")
    try:
        found: Any = sys.modules.get(module) or import_module(module)
        for part in path.split("."):
            found = getattr(found, part)
    except (ImportError, AttributeError) as error:
        raise DatasetError(
            f"a checkpoint names {name}, which this version does not have; begin anew with --overwrite"
        ) from error
    return found
