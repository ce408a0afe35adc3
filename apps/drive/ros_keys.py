"""Names of ROS 2 on Zenoh: keys of topics, attachments of messages, liveliness tokens of nodes and topics.

Source: rmw_zenoh, docs/design.md (topics, publishers, graph cache).
"""

import hashlib
import struct
from collections.abc import Iterable
from dataclasses import dataclass

_ATTACHMENT = struct.Struct("<qqB16s")
"""Sequence number, time [ns since 1970], length of the publisher's id, the id."""
_QOS = "::,10:,:,:,,"
"""ROS's default quality of service: reliable, volatile, history of 10."""
PUBLISHER, SUBSCRIBER = "MP", "MS"


@dataclass(frozen=True, kw_only=True)
class Endpoint:
    """A publisher or a subscriber of a topic."""

    kind: str
    """`PUBLISHER` or `SUBSCRIBER`."""
    topic: str
    """Name of the topic with its leading slash."""
    type_name: str
    """Message type, such as geometry_msgs/msg/Twist."""
    type_hash: str


def topic_key(domain: int, topic: str, type_name: str, type_hash: str) -> str:
    """The key on which a topic's messages are published.

    Args:
        domain: `ROS_DOMAIN_ID`.
        topic: Name, with or without a leading slash.
        type_name: Message type, such as geometry_msgs/msg/Twist, or "*" for any.
        type_hash: Hash of the type, RIHS01_..., or "*" for any.
    """
    return f"{domain}/{topic.strip('/')}/{_dds_name(type_name)}/{type_hash}"


def type_of_key(key: str) -> str:
    """The type of a topic's key, such as geometry_msgs/msg/Twist."""
    return _ros_name(key.rsplit("/", 2)[1])


def attachment(sequence: int, time_ns: int, publisher_id: bytes) -> bytes:
    """The attachment that ROS sends with a message.

    Args:
        sequence: Number of the publisher's message, from 1 on.
        time_ns: Time of sending [ns since 1970].
        publisher_id: Id of the publisher, 16 bytes.
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
        number: Number of the endpoint within the node.
        node: Name of the node.
        endpoint: The publisher or subscriber.
    """
    topic = "%" + endpoint.topic.strip("/").replace("/", "%")
    place = f"@ros2_lv/{domain}/{session}/0/{number}/{endpoint.kind}/%/%/{node}"
    return f"{place}/{topic}/{_dds_name(endpoint.type_name)}/{endpoint.type_hash}/{_QOS}"


def all_tokens(domain: int) -> str:
    """The key expression for all tokens of a domain."""
    return f"@ros2_lv/{domain}/**"


def endpoints(tokens: Iterable[str]) -> list[Endpoint]:
    """Publishers and subscribers among tokens; other tokens are ignored."""
    found = []
    for token in tokens:
        parts = token.split("/")
        if len(parts) == 13 and parts[5] in (PUBLISHER, SUBSCRIBER):
            topic = parts[9].replace("%", "/")
            found.append(Endpoint(kind=parts[5], topic=topic, type_name=_ros_name(parts[10]), type_hash=parts[11]))
    return found


def publisher_id(token: str) -> bytes:
    """A unique id of a publisher, 16 bytes.

    ROS uses a different hash of the token; the id only has to differ from those of other publishers.
    """
    return hashlib.blake2b(token.encode(), digest_size=16).digest()


def _dds_name(type_name: str) -> str:
    package, _, name = type_name.partition("/msg/")
    return f"{package}::msg::dds_::{name}_" if name else type_name


def _ros_name(dds_name: str) -> str:
    return dds_name.replace("::dds_::", "/").replace("::", "/").removesuffix("_")
