# SPDX-License-Identifier: BSD-3-Clause
"""The base of everything that is written as JSON and read back: frozen, checked, and with the version of its schema.

A file of another schema version is refused with a sentence that gives the version found, the version needed and the
next step, instead of failing later at a key that is missing.
"""

import json
from pathlib import Path
from typing import Any, ClassVar, Generic, Self, TypeVar

from pydantic import BaseModel, ConfigDict, RootModel, ValidationError, ValidationInfo, model_validator

from coclo_vio.values.config import first_problem
from coclo_vio.values.errors import DatasetError
from coclo_vio.values.whole_files import write_whole


class JsonModel(BaseModel):
    """A model with a JSON file of its own.

    Attributes:
        next_step: what to do with a file that cannot be read, for the error message.
    """

    next_step: ClassVar[str] = "run again"

    @classmethod
    def parse(cls, values: object, source: str) -> Self:
        """The model of plain values, as ``json`` reads them.

        Raises:
            DatasetError: another schema version, a key missing or unknown, or a value of another type; names
                ``source`` and the next step.
        """
        try:
            return cls.model_validate(values, context={"is_read": True})
        except ValidationError as error:
            raise DatasetError(f"{source}: {first_problem(cls, error)}; {cls.next_step}") from error

    @classmethod
    def read(cls, path: Path) -> Self:
        """The model in a JSON file.

        Raises:
            DatasetError: the file cannot be read, is not JSON, or holds no such model.
        """
        return cls.parse(read_json(path, cls.next_step), str(path))

    def to_json(self) -> dict[str, Any]:
        """The model in plain values that ``json`` writes."""
        return self.model_dump(mode="json")

    def write(self, path: Path) -> None:
        """Write the model as JSON.

        Raises:
            OSError: the file cannot be written.
        """
        write_json(path, self.to_json())


class Record(JsonModel):
    """A frozen set of results: unknown keys refused, no NaN and no infinity.

    A subclass declares its version as ``schema_version: Literal[1] = 1`` and raises it with every change of its keys.

    Attributes:
        schema_version: of the keys.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    schema_version: int

    @model_validator(mode="before")
    @classmethod
    def _check_version(cls, values: Any, info: ValidationInfo) -> Any:
        """Of values that were read, records inside records too; what is made here has its class's own version."""
        if info.context and info.context.get("is_read") and isinstance(values, dict):
            found, current = values.get("schema_version"), cls.model_fields["schema_version"].default
            if found != current:
                version = "no schema version" if found is None else f"schema version {found}"
                raise ValueError(f"it has {version}, this release reads version {current}")
        return values


Content = TypeVar("Content", bound=JsonModel)


class RecordMapping(JsonModel, RootModel[dict[str, Content]], Generic[Content]):
    """Records by name: a JSON object whose values hold their own schema versions."""

    model_config = ConfigDict(frozen=True)

    def __getitem__(self, name: str) -> Content:
        return self.root[name]


def read_json(path: Path, next_step: str) -> object:
    """What a JSON file holds, unchecked.

    Args:
        path: of the file.
        next_step: for the error message.

    Raises:
        DatasetError: the file cannot be read or is not JSON.
    """
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise DatasetError(f"cannot read {path}: {error.strerror}; {next_step}") from error
    except ValueError as error:
        raise DatasetError(f"{path} is not JSON ({error}); {next_step}") from error


def write_json(path: Path, values: object) -> None:
    """Write plain values as readable JSON; the file is whole at any moment, the earlier one or the new one.

    Raises:
        OSError: the file cannot be written.
        ValueError: a number is NaN or infinite.
    """
    write_whole(path, json.dumps(values, indent=2, allow_nan=False) + "\n")
