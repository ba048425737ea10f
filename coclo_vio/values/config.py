# SPDX-License-Identifier: BSD-3-Clause
"""The base of every stage's configuration, and reading and writing of YAML.

Each stage's configuration is in the package of the stage; presets hold only differences; an unknown key is an error
that names the known ones.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Self, get_args

import yaml
from pydantic import BaseModel, ConfigDict, ValidationError

from coclo_vio.values.errors import ConfigError, listing, shortened
from coclo_vio.values.whole_files import write_whole
from coclo_vio.values.yaml_text import DEEPEST, MOST_CHARACTERS, parse_yaml


class StageConfig(BaseModel):
    """A frozen set of parameters: unknown keys refused, bounds checked, every field with a usable default."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    @classmethod
    def parse(cls, values: Mapping[str, Any], source: str) -> Self:
        """Check ``values`` against the fields.

        Raises:
            ConfigError: an unknown key, or a value out of bounds; the message names ``source`` and the choices.
        """
        try:
            return cls.model_validate(dict(values))
        except ValidationError as error:
            raise ConfigError(f"{source}: {first_problem(cls, error)}") from error


def first_problem(model: type[BaseModel], error: ValidationError) -> str:
    """The first thing wrong with the values of a model, in a sentence: key, value, and the limit or the choices."""
    problem = error.errors()[0]
    where = shortened(".".join(str(part) for part in problem["loc"]))
    if problem["type"] == "extra_forbidden":
        choices = listing(_model_at(model, problem["loc"][:-1]).model_fields)
        return f"there is no {where}; the keys there are: {choices}"
    message = " ".join(problem["msg"].removeprefix("Value error, ").split())
    if isinstance(problem["input"], Mapping | BaseModel):  # of a whole section, not of one value
        return f"{where}: {message}" if where else message
    return f"{where} = {shortened(repr(problem['input']))}: {message}"


def _model_at(model: type[BaseModel], location: Sequence[int | str]) -> type[BaseModel]:
    """The model at a location such as ``("legs", 0)`` below ``model``."""
    for part in location:
        field = model.model_fields.get(str(part), model.model_fields.get("root"))  # a mapping has its values in "root"
        model = model if field is None else _first_model(field.annotation) or model
    return model


def _first_model(annotation: Any) -> type[BaseModel] | None:
    """The first model inside an annotation: ``Leg`` of ``tuple[Leg, ...]`` or of ``Leg | None``."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    return next((model for inner in get_args(annotation) if (model := _first_model(inner)) is not None), None)


def read_yaml(path: Path) -> dict[str, Any]:
    """The mapping in a YAML file.

    Raises:
        ConfigError: no such file, not YAML, or not a mapping.
    """
    try:
        with path.open(encoding="utf-8") as file:
            text = file.read(MOST_CHARACTERS + 1)
    except OSError as error:
        raise ConfigError(f"cannot read the configuration {shortened(path)}: {error.strerror}") from error
    except ValueError as error:  # bytes that are no UTF-8, or a path with a zero byte
        raise ConfigError(f"cannot read the configuration {shortened(path)!r} as text: {error}") from error
    try:
        values = parse_yaml(text)
    except ConfigError as error:
        raise ConfigError(f"{path} {error}") from error
    if values is None:
        return {}
    if not isinstance(values, dict):
        raise ConfigError(f"{path} must hold a mapping of keys to values, it holds a {type(values).__name__}")
    return values


def write_yaml(config: BaseModel, path: Path) -> None:
    """Write every field with its value, defaults included, so that a run can be repeated from the file."""
    write_whole(path, yaml.safe_dump(config.model_dump(mode="json"), sort_keys=False))


def merged(base: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """``base`` updated with ``changes``, nested mappings key by key."""
    result = dict(base)
    for key, value in changes.items():
        current = result.get(key)
        are_mappings = isinstance(current, Mapping) and isinstance(value, Mapping)
        result[key] = merged(current, value) if are_mappings else value  # type: ignore[arg-type]
    return result


def parse_settings(settings: Sequence[str]) -> dict[str, Any]:
    """The nested mapping of ``a.b=value`` strings; values are read as YAML.

    Raises:
        ConfigError: a setting without ``=``, or a value that is not YAML.
    """
    result: dict[str, Any] = {}
    for setting in settings:
        path, equals, text = setting.partition("=")
        if not equals or not path:
            raise ConfigError(f"--set takes key.subkey=value, got {shortened(setting)!r}")
        try:
            value: Any = parse_yaml(text)
        except ConfigError as error:
            raise ConfigError(f"--set {shortened(path)}: {shortened(text)!r} {error}") from error
        keys = path.split(".")
        if len(keys) > DEEPEST:
            raise ConfigError(f"--set takes key.subkey=value, got {len(keys)} keys, {shortened(path)!r}")
        for key in reversed(keys):
            value = {key: value}
        result = merged(result, value)
    return result
