# SPDX-License-Identifier: BSD-3-Clause
"""Message types of ROS 2 as types of Cyclone DDS, made from their definitions instead of written by hand.

A topic of DDS needs the type for its name and for the check of what is written; bytes are passed on as they are.
"""

from typing import Any

from cyclonedds import idl

from coclo_vio.datasets.rosbag.storage.type_definitions import FieldType, TypeDefinitions
from coclo_vio.live.ros_names import dds_name

_BASIC = {
    "bool": "bool",
    "byte": "uint8",
    "octet": "uint8",
    "char": "uint8",
    "string": "str",
    "float32": "float32",
    "float64": "float64",
} | {f"{sign}int{bits}": f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)}


class DdsTypes:
    """Makes the types, each once."""

    def __init__(self, types: TypeDefinitions) -> None:
        """Take the definitions."""
        self._types = types
        self._made: dict[str, Any] = {}

    def of(self, msgtype: str) -> Any:
        """The type of Cyclone DDS for a type of ROS.

        Raises:
            DatasetError: the type, or one of its fields, is not known.
        """
        if msgtype not in self._made:
            fields = {name: self._field(field) for name, field in self._types.fields_of(msgtype).items()}
            name = dds_name(msgtype)
            made = idl.make_idl_struct(name.rpartition("::")[2], name.replace("::", "."), fields)
            self._made[msgtype] = made
        return self._made[msgtype]

    def _field(self, field: FieldType) -> Any:
        types = idl.types
        inner: Any
        if field.is_message:
            inner = self.of(field.name)
        else:
            name = _BASIC[field.name]
            inner = {"str": str, "bool": bool}.get(name) or getattr(types, name)
        if field.is_sequence:
            return types.sequence[inner]
        return inner if field.count is None else types.array[inner, field.count]
