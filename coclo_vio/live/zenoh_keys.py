# SPDX-License-Identifier: BSD-3-Clause
"""The wire format of rmw_zenoh: key expressions, liveliness tokens and attachments, as text and bytes.

Source: ros2/rmw_zenoh, docs/design.md ("Topic and Service name mapping", "Graph Cache"), ``attachment_helpers.cpp`` and
``liveliness_utils.cpp``.

=================== ==========================================================================================
key of a topic      ``<domain>/<name without its first slash>/<type as in DDS>/<hash of the type>``
token of a node     ``@ros2_lv/<domain>/<session>/<node>/<node>/NN/<enclave>/<namespace>/<node name>``
token of an entity  ``@ros2_lv/<domain>/<session>/<node>/<entity>/<MP or MS>/<enclave>/<namespace>/<node name>/
                    <topic>/<type>/<hash>/<quality of service>``, where ``/`` within a part is ``%``
attachment          number (int64), time of sending in ns (int64), little endian; 16, and 16 bytes of the sender
=================== ==========================================================================================
"""

import hashlib
import struct
from dataclasses import dataclass
from typing import Literal, NamedTuple

from coclo_vio.live.ros_names import dds_name, ros_name

_SPACE = "@ros2_lv"
_ATTACHMENT = struct.Struct("<qqB16s")
_NAMED_ATTACHMENT = struct.Struct("<B15sqB16sqB10sB16s")  # of Jazzy's rmw_zenoh before 0.2.4
_SENDER_BYTES = 16
_NO_HASH = "TypeHashNotSupported"  # Humble
_KEEP_LAST_10 = "::,10:,:,:,,"  # reliable, volatile: the defaults of rmw_zenoh but the depth
_TRANSIENT_LOCAL = ":1:,1:,:,:,,"
_PUBLISHER_PARTS = 13


class Attachment(NamedTuple):
    """What rmw_zenoh sends with each message."""

    sequence: int
    sent_ns: int
    sender: bytes

    def packed(self) -> bytes:
        """As bytes."""
        return _ATTACHMENT.pack(self.sequence, self.sent_ns, _SENDER_BYTES, self.sender)


def attachment_of(data: bytes) -> Attachment | None:
    """The attachment in some bytes; None where they hold none."""
    if len(data) == _ATTACHMENT.size:
        sequence, sent_ns, length, sender = _ATTACHMENT.unpack(data)
        return Attachment(sequence, sent_ns, sender) if length == _SENDER_BYTES else None
    if len(data) == _NAMED_ATTACHMENT.size:
        _, first, sequence, _, second, sent_ns, _, third, _, sender = _NAMED_ATTACHMENT.unpack(data)
        if (first, second, third) == (b"sequence_number", b"source_timestamp", b"source_gid"):
            return Attachment(sequence, sent_ns, sender)
    return None


@dataclass(frozen=True, slots=True)
class ZenohTopic:
    """A topic as its key names it.

    Attributes:
        name: with its first slash.
        msgtype: such as ``sensor_msgs/msg/Imu``.
        type_hash: such as ``RIHS01_...``; ``*`` for any.
    """

    name: str
    msgtype: str
    type_hash: str

    def key(self, domain: int) -> str:
        """The key expression of its messages."""
        return f"{domain}/{self.name.strip('/')}/{dds_name(self.msgtype)}/{self.type_hash}"

    def fits(self, type_hash: str) -> bool:
        """Whether messages of this key are of a type with a hash; ROS 2 Humble sends none."""
        return self.type_hash in (type_hash, _NO_HASH)


def topic_of_key(key: str) -> ZenohTopic | None:
    """The topic of a key; None where the key is not one of rmw_zenoh."""
    parts = key.split("/")
    if len(parts) < 4:
        return None
    msgtype = ros_name(parts[-2])
    return None if msgtype is None else ZenohTopic("/" + "/".join(parts[1:-2]), msgtype, parts[-1])


class Advertised(NamedTuple):
    """A publisher by its token."""

    topic: ZenohTopic
    is_transient_local: bool


def advertised_by(token: str) -> Advertised | None:
    """The publisher that a token announces; None for another entity, or a token of another form."""
    parts = token.split("/")
    if len(parts) != _PUBLISHER_PARTS or parts[0] != _SPACE or parts[5] != "MP":
        return None
    name, dds_type, type_hash, quality = (part.replace("%", "/") for part in parts[9:])
    msgtype = ros_name(dds_type)
    durability = quality.split(":")[1] if quality.count(":") > 1 else ""
    return None if msgtype is None else Advertised(ZenohTopic(name, msgtype, type_hash), durability == "1")


def tokens_key(domain: int) -> str:
    """The key expression of all tokens of a domain."""
    return f"{_SPACE}/{domain}/**"


class NodeTokens:
    """Makes the tokens of one node, the only one of its session."""

    def __init__(self, domain: int, session: str, name: str) -> None:
        """Set domain, identity of the session and name of the node."""
        self._domain, self._session, self._name = domain, session, name
        self._entities = 0

    def node(self) -> str:
        """The token of the node."""
        return f"{_SPACE}/{self._domain}/{self._session}/0/0/NN/%/%/{self._name}"

    def entity(self, kind: Literal["MP", "MS"], topic: ZenohTopic, *, is_transient_local: bool = False) -> str:
        """The token of a publisher (MP) or a subscription (MS), with a number of its own."""
        self._entities += 1
        name = topic.name.replace("/", "%")
        quality = _TRANSIENT_LOCAL if is_transient_local else _KEEP_LAST_10
        return (
            f"{_SPACE}/{self._domain}/{self._session}/0/{self._entities}/{kind}/%/%/{self._name}/{name}/"
            f"{dds_name(topic.msgtype)}/{topic.type_hash}/{quality}"
        )


def sender_of(token: str) -> bytes:
    """Sixteen bytes that identify a publisher: a hash of its token."""
    return hashlib.blake2b(token.encode(), digest_size=_SENDER_BYTES).digest()
