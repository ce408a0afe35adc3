"""Three transports of robots on Zenoh: ROS 2 by rmw_zenoh, ROS 2 behind zenoh-bridge-ros2dds, and without ROS."""

from dataclasses import dataclass
from typing import Literal, Protocol

from readygo.apps.drive import ros_keys
from readygo.apps.drive.messages import Codec
from readygo.apps.drive.plain_codec import PlainCodec
from readygo.apps.drive.ros_codec import COMPRESSED_TYPE, IMAGE_TYPE, STAMPED_TWIST_TYPE, TWIST_TYPE, RosCodec
from readygo.apps.drive.ros_keys import Endpoint
from readygo.common.bus.foreign import ForeignSession

WireName = Literal["ros2", "bridge", "plain"]
"""Names of the transports: rmw_zenoh, zenoh-bridge-ros2dds, MessagePack with topic names as keys."""
COMPRESSED_SUFFIX, COMPRESSED_DEPTH_SUFFIX = "/compressed", "/compressedDepth"
"""Suffixes of topics with compressed images, for transports whose keys do not name the message type."""


@dataclass(frozen=True, kw_only=True)
class TopicKey:
    """Key and type of a topic's messages."""

    key: str
    type_name: str


class Wire(Protocol):
    """Transport of a robot: keys of topics, encoding of messages."""

    @property
    def codec(self) -> Codec:
        """Codec of the messages."""
        ...

    def heard_key(self, topic: str) -> str:
        """The key expression to subscribe to for a topic."""
        ...

    def type_of(self, key: str, default: str) -> str:
        """The type of a received message.

        Args:
            key: Key of the message.
            default: Expected type, for transports whose keys do not name one.
        """
        ...

    def address(self, session: ForeignSession, topic: str, type_names: tuple[str, ...], kind: str) -> TopicKey:
        """Key and type with which this program publishes or subscribes to a topic.

        Args:
            session: Session on the robot's network.
            topic: Name of the topic.
            type_names: Possible types; the first one if the other side announces none.
            kind: Role of this program: publisher or subscriber.
        """
        ...

    def announce(self, session: ForeignSession, topic: str, address: TopicKey, kind: str, number: int) -> str:
        """Announce that this program publishes or subscribes to a topic; returns the announcement's token.

        Args:
            session: Session on the robot's network.
            topic: Name of the topic.
            address: Key and type of the topic.
            kind: Role of this program: publisher or subscriber.
            number: Number of the topic within this program, from 1 on.
        """
        ...

    def attachment(self, number: int, time_ns: int, token: str) -> bytes:
        """Attachment of a message; empty for transports without attachments."""
        ...

    def topics(self, session: ForeignSession, kind: str) -> list[Endpoint]:
        """Publishers or subscribers on the network; empty if the transport does not announce them."""
        ...


class RosWire:
    """Keys and tokens of rmw_zenoh, messages in CDR."""

    def __init__(self, domain: int, node: str) -> None:
        """Prepare a ROS node.

        Args:
            domain: `ROS_DOMAIN_ID`.
            node: Name of the node.

        Raises:
            ConfigError: If rosbags is not installed.
        """
        self._domain, self._node = domain, node
        self.codec: RosCodec = RosCodec()

    def heard_key(self, topic: str) -> str:
        """The key expression of a topic with any type, so that a message of a wrong type can be reported."""
        return ros_keys.topic_key(self._domain, topic, "*", "*")

    def type_of(self, key: str, default: str) -> str:
        """The type that the key names."""
        return ros_keys.type_of_key(key)

    def address(self, session: ForeignSession, topic: str, type_names: tuple[str, ...], kind: str) -> TopicKey:
        """Key with the type and the type hash of the other side; arguments as in `Wire.address`."""
        name = "/" + topic.strip("/")
        other = ros_keys.PUBLISHER if kind == ros_keys.SUBSCRIBER else ros_keys.SUBSCRIBER
        type_name, type_hash = type_names[0], self.codec.type_hash(type_names[0])
        for each in self.topics(session, other):
            if each.topic == name and each.type_name in type_names:
                type_name, type_hash = each.type_name, each.type_hash
        return TopicKey(key=ros_keys.topic_key(self._domain, name, type_name, type_hash), type_name=type_name)

    def announce(self, session: ForeignSession, topic: str, address: TopicKey, kind: str, number: int) -> str:
        """Declare liveliness tokens of node and topic, and return the topic's; arguments as in `Wire.announce`."""
        if number == 1:
            session.announce(ros_keys.node_token(self._domain, session.name, self._node))
        type_hash = address.key.rsplit("/", 1)[-1]
        endpoint = Endpoint(kind=kind, topic=topic, type_name=address.type_name, type_hash=type_hash)
        token = ros_keys.endpoint_token(self._domain, session.name, number, self._node, endpoint)
        session.announce(token)
        return token

    def attachment(self, number: int, time_ns: int, token: str) -> bytes:
        """ROS's attachment: message number, time [ns since 1970], and the publisher's id from its token."""
        return ros_keys.attachment(number, time_ns, ros_keys.publisher_id(token))

    def topics(self, session: ForeignSession, kind: str) -> list[Endpoint]:
        """Publishers or subscribers of the domain, from their liveliness tokens."""
        tokens = session.present(ros_keys.all_tokens(self._domain))
        return [each for each in ros_keys.endpoints(tokens) if each.kind == kind]


class TopicWire:
    """Transport whose keys are the topics' names, below an optional prefix; keys do not name the message type."""

    def __init__(self, codec: Codec, prefix: str = "", *, stamped: bool = False) -> None:
        """Prepare the transport.

        Args:
            codec: Codec of the messages.
            prefix: Prefix of every key: the bridge's namespace, or the robot's name.
            stamped: True to send TwistStamped.
        """
        self.codec, self._prefix, self._stamped = codec, prefix.strip("/"), stamped

    def heard_key(self, topic: str) -> str:
        """The key of a topic, with the prefix."""
        return "/".join(filter(None, (self._prefix, topic.strip("/"))))

    def type_of(self, key: str, default: str) -> str:
        """The type of a received message: the expected one, or its compressed or stamped variant."""
        if default == IMAGE_TYPE and key.endswith((COMPRESSED_SUFFIX, COMPRESSED_DEPTH_SUFFIX)):
            return COMPRESSED_TYPE
        return STAMPED_TWIST_TYPE if self._stamped and default == TWIST_TYPE else default

    def address(self, session: ForeignSession, topic: str, type_names: tuple[str, ...], kind: str) -> TopicKey:
        """The topic's key, with the first type or TwistStamped; arguments as in `Wire.address`."""
        stamped = self._stamped and STAMPED_TWIST_TYPE in type_names
        return TopicKey(key=self.heard_key(topic), type_name=STAMPED_TWIST_TYPE if stamped else type_names[0])

    def announce(self, session: ForeignSession, topic: str, address: TopicKey, kind: str, number: int) -> str:
        """Return an empty token: this transport has no announcements."""
        return ""

    def attachment(self, number: int, time_ns: int, token: str) -> bytes:
        """Empty bytes: messages of this transport have no attachment."""
        return b""

    def topics(self, session: ForeignSession, kind: str) -> list[Endpoint]:
        """Empty list: nodes of this transport are not announced."""
        return []


def make_wire(name: WireName, *, domain: int, prefix: str, stamped: bool, node: str) -> Wire:
    """Make a transport by name.

    Raises:
        ConfigError: If the transport needs rosbags, which is not installed.
    """
    if name == "ros2":
        return RosWire(domain, node)
    if name == "bridge":
        return TopicWire(RosCodec(), prefix, stamped=stamped)
    return TopicWire(PlainCodec(), prefix)
