"""How ROS 2 names things on Zenoh: keys of topics, attachments of messages, tokens of nodes and topics.

Source: rmw_zenoh, docs/design.md (topics, publishers, graph cache).
"""

import hashlib
import struct
from collections.abc import Iterable
from dataclasses import dataclass

_ATTACHMENT = struct.Struct("<qqB16s")
"""Sequence number, time [ns since 1970], length of the publisher's id, the id."""
NO_HASH = "TypeHashNotSupported"
"""In place of a type's hash where ROS knows none yet (Humble)."""
_QOS = "::,10:,:,:,,"
"""Reliable, volatile, the last 10 kept: ROS's defaults for a topic."""
PUBLISHER, SUBSCRIBER = "MP", "MS"


@dataclass(frozen=True, kw_only=True)
class Endpoint:
    """A publisher or a subscriber of a topic."""

    kind: str
    """`PUBLISHER` or `SUBSCRIBER`."""
    topic: str
    """With its leading slash."""
    type_name: str
    """Such as geometry_msgs/msg/Twist."""
    type_hash: str


def topic_key(domain: int, topic: str, type_name: str, type_hash: str) -> str:
    """The key on which a topic's messages are published.

    Args:
        domain: `ROS_DOMAIN_ID`.
        topic: Name, with or without a leading slash.
        type_name: Such as geometry_msgs/msg/Twist, or "*" for any.
        type_hash: RIHS01_..., or "*" for any.
    """
    return f"{domain}/{topic.strip('/')}/{_dds_name(type_name)}/{type_hash}"


def type_of_key(key: str) -> str:
    """The type of a topic's key, such as geometry_msgs/msg/Twist."""
    return _ros_name(key.rsplit("/", 2)[1])


def attachment(sequence: int, time_ns: int, publisher_id: bytes) -> bytes:
    """What ROS sends beside a message.

    Args:
        sequence: Number of the publisher's message, from 1 on.
        time_ns: When it was sent [ns since 1970].
        publisher_id: 16 bytes.
    """
    return _ATTACHMENT.pack(sequence, time_ns, 16, publisher_id)


def node_token(domain: int, session: str, node: str) -> str:
    """The liveliness token of a node."""
    return f"@ros2_lv/{domain}/{session}/0/0/NN/%/%/{node}"


def endpoint_token(domain: int, session: str, number: int, node: str, endpoint: Endpoint) -> str:
    """The liveliness token of a publisher or subscriber.

    Args:
        domain: `ROS_DOMAIN_ID`.
        session: Id of the Zenoh session.
        number: Of the endpoint within the node.
        node: Name of the node.
        endpoint: What it is.
    """
    topic = "%" + endpoint.topic.strip("/").replace("/", "%")
    place = f"@ros2_lv/{domain}/{session}/0/{number}/{endpoint.kind}/%/%/{node}"
    return f"{place}/{topic}/{_dds_name(endpoint.type_name)}/{endpoint.type_hash}/{_QOS}"


def all_tokens(domain: int) -> str:
    """The expression for all tokens of a domain."""
    return f"@ros2_lv/{domain}/**"


def endpoints(tokens: Iterable[str]) -> list[Endpoint]:
    """Publishers and subscribers among tokens; the others are left out."""
    found = []
    for token in tokens:
        parts = token.split("/")
        if len(parts) == 13 and parts[5] in (PUBLISHER, SUBSCRIBER):
            topic = parts[9].replace("%", "/")
            found.append(Endpoint(kind=parts[5], topic=topic, type_name=_ros_name(parts[10]), type_hash=parts[11]))
    return found


def publisher_id(token: str) -> bytes:
    """16 bytes that nobody else has.

    ROS takes another hash of the token; all that is asked of the id is that it differs from those of others.
    """
    return hashlib.blake2b(token.encode(), digest_size=16).digest()


def _dds_name(type_name: str) -> str:
    package, _, name = type_name.partition("/msg/")
    return f"{package}::msg::dds_::{name}_" if name else type_name


def _ros_name(dds_name: str) -> str:
    return dds_name.replace("::dds_::", "/").replace("::", "/").removesuffix("_")
