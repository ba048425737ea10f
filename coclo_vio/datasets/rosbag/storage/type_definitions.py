# SPDX-License-Identifier: BSD-3-Clause
"""The message types of a ROS 2 distribution, as a wire needs them: bytes, type hashes, and the fields of each type."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from coclo_vio.values.errors import DatasetError, shortened

Distribution = Literal["humble", "iron", "jazzy", "kilted"]
_STORES = {
    "humble": Stores.ROS2_HUMBLE,
    "iron": Stores.ROS2_IRON,
    "jazzy": Stores.ROS2_JAZZY,
    "kilted": Stores.ROS2_KILTED,
}


@dataclass(frozen=True, slots=True)
class FieldType:
    """The type of a field of a message.

    Attributes:
        name: of a basic type such as ``float64``, or of a message type such as ``std_msgs/msg/Header``.
        is_message: whether it is a message type.
        is_sequence: whether it is a list of any length.
        count: length of a fixed list, None where it is none.
    """

    name: str
    is_message: bool
    is_sequence: bool
    count: int | None


class TypeDefinitions:
    """The message types of a distribution and further ones.

    Attributes:
        types: the message classes by name, such as ``sensor_msgs/msg/Imu``.
        ros: the version of ROS.
    """

    ros: Literal[2] = 2

    def __init__(self, distribution: Distribution = "jazzy", further: Mapping[str, str] | None = None) -> None:
        """Take the types.

        Args:
            distribution: of ROS 2.
            further: text of the ``.msg`` definition by type, with those of nested types below it as bags have them.

        Raises:
            DatasetError: a definition cannot be parsed.
        """
        self._store = get_typestore(_STORES[distribution])
        for msgtype, text in (further or {}).items():
            try:
                self._store.register(get_types_from_msg(text, msgtype))
                self._store.hash_rihs01(msgtype)
            except Exception as error:  # the grammar's own errors, and a KeyError for a nested type that is not there
                raise DatasetError(
                    f"the definition of {msgtype} cannot be read ({shortened(error)}); give the text of its .msg file, "
                    "with those of nested types below it"
                ) from error
        self.types: dict[str, Any] = dict(self._store.types)
        self._hashes: dict[str, str] = {}

    def typed(self, msgtype: str) -> tuple[str, Typestore]:
        """A type with the definitions that decode it."""
        return msgtype, self._store

    def serialized(self, message: Any) -> bytes:
        """A message as CDR with its four bytes of header."""
        return bytes(self._store.serialize_cdr(message, message.__msgtype__))

    def hash_of(self, msgtype: str) -> str:
        """The hash of a type (RIHS01, REP 2016).

        Raises:
            DatasetError: the type is not known.
        """
        if msgtype not in self._hashes:
            self._check(msgtype)
            self._hashes[msgtype] = self._store.hash_rihs01(msgtype)
        return self._hashes[msgtype]

    def definition_of(self, msgtype: str) -> str:
        """The text of a type's definition with those of nested types, as bags hold it.

        Raises:
            DatasetError: the type is not known.
        """
        self._check(msgtype)
        return self._store.generate_msgdef(msgtype, ros_version=2)[0]

    def fields_of(self, msgtype: str) -> dict[str, FieldType]:
        """The fields of a type by name, in order.

        Raises:
            DatasetError: the type is not known.
        """
        self._check(msgtype)
        return {name: _field_type(node) for name, node in self._store.fielddefs[msgtype][1]}

    def has_header(self, msgtype: str) -> bool:
        """Whether messages of a type begin with a header, so that they have a stamp."""
        if msgtype not in self:
            return False
        first = next(iter(self.fields_of(msgtype).values()), None)
        return first == FieldType("std_msgs/msg/Header", True, False, None)

    def __contains__(self, msgtype: str) -> bool:
        return msgtype in self._store.fielddefs

    def _check(self, msgtype: str) -> None:
        if msgtype not in self:
            raise DatasetError(
                f"there is no definition of the message type {msgtype}; give its .msg file in live.definitions"
            )


def _field_type(node: Any) -> FieldType:
    kind, value = node
    if kind == Nodetype.NAME:
        return FieldType(str(value), True, False, None)
    if kind == Nodetype.BASE:
        return FieldType(str(value[0]), False, False, None)
    inner = _field_type(value[0])
    if kind == Nodetype.SEQUENCE:
        return FieldType(inner.name, inner.is_message, True, None)
    return FieldType(inner.name, inner.is_message, False, int(value[1]))
