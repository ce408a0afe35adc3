"""Three ways that robots speak on Zenoh: ROS 2 by rmw_zenoh, ROS 2 behind zenoh-bridge-ros2dds, and none of ROS."""

from dataclasses import dataclass
from typing import Literal, Protocol

from readygo.apps.drive import ros_keys
from readygo.apps.drive.messages import Codec
from readygo.apps.drive.plain_codec import PlainCodec
from readygo.apps.drive.ros_codec import COMPRESSED_TYPE, IMAGE_TYPE, STAMPED_TWIST_TYPE, TWIST_TYPE, RosCodec
from readygo.apps.drive.ros_keys import Endpoint
from readygo.common.bus.foreign import ForeignSession

WireName = Literal["ros2", "bridge", "plain"]
"""rmw_zenoh, zenoh-bridge-ros2dds, or MessagePack on keys that are the topics' names."""
COMPRESSED_SUFFIX, COMPRESSED_DEPTH_SUFFIX = "/compressed", "/compressedDepth"
"""Topics of compressed images end like this, where keys do not say what they carry."""


@dataclass(frozen=True, kw_only=True)
class Address:
    """What is published where."""

    key: str
    type_name: str


class Wire(Protocol):
    """Names of topics and bytes of messages."""

    @property
    def codec(self) -> Codec:
        """Of the messages."""
        ...

    def heard_key(self, topic: str) -> str:
        """The expression to subscribe to."""
        ...

    def type_of(self, key: str, default: str) -> str:
        """The type of the messages of a key that was heard.

        Args:
            key: Of a message.
            default: What is meant to be there.
        """
        ...

    def address(self, session: ForeignSession, topic: str, type_names: tuple[str, ...], kind: str) -> Address:
        """Where this program publishes or hears a topic.

        Args:
            session: On the robot's network.
            topic: Name of the topic.
            type_names: Types that will do; the first one where the other side does not say which it has.
            kind: What this program is: publisher or subscriber.
        """
        ...

    def announce(self, session: ForeignSession, topic: str, address: Address, kind: str, number: int) -> str:
        """Say that this program publishes or hears a topic, and return the token that says so.

        Args:
            session: On the robot's network.
            topic: Name of the topic.
            address: Of it.
            kind: What this program is.
            number: Of the topic within this program, from 1 on.
        """
        ...

    def attachment(self, number: int, time_ns: int, token: str) -> bytes:
        """What goes beside a message."""
        ...

    def topics(self, session: ForeignSession, kind: str) -> list[Endpoint]:
        """Publishers or subscribers that are there; empty where the wire does not say."""
        ...


class RosWire:
    """Keys and tokens of rmw_zenoh, messages in CDR."""

    def __init__(self, domain: int, node: str) -> None:
        """Take part as a node.

        Args:
            domain: `ROS_DOMAIN_ID`.
            node: Its name.

        Raises:
            ConfigError: If rosbags is not installed.
        """
        self._domain, self._node = domain, node
        self.codec: RosCodec = RosCodec()

    def heard_key(self, topic: str) -> str:
        """See `Wire.heard_key`; whatever the type, so that another one can be told."""
        return ros_keys.topic_key(self._domain, topic, "*", "*")

    def type_of(self, key: str, default: str) -> str:
        """See `Wire.type_of`."""
        return ros_keys.type_of_key(key)

    def address(self, session: ForeignSession, topic: str, type_names: tuple[str, ...], kind: str) -> Address:
        """See `Wire.address`: in the type and under the hash of the other side."""
        name = "/" + topic.strip("/")
        other = ros_keys.PUBLISHER if kind == ros_keys.SUBSCRIBER else ros_keys.SUBSCRIBER
        type_name, type_hash = type_names[0], self.codec.type_hash(type_names[0])
        for each in self.topics(session, other):
            if each.topic == name and each.type_name in type_names:
                type_name, type_hash = each.type_name, each.type_hash
        return Address(key=ros_keys.topic_key(self._domain, name, type_name, type_hash), type_name=type_name)

    def announce(self, session: ForeignSession, topic: str, address: Address, kind: str, number: int) -> str:
        """See `Wire.announce`."""
        if number == 1:
            session.announce(ros_keys.node_token(self._domain, session.name, self._node))
        type_hash = address.key.rsplit("/", 1)[-1]
        endpoint = Endpoint(kind=kind, topic=topic, type_name=address.type_name, type_hash=type_hash)
        token = ros_keys.endpoint_token(self._domain, session.name, number, self._node, endpoint)
        session.announce(token)
        return token

    def attachment(self, number: int, time_ns: int, token: str) -> bytes:
        """See `Wire.attachment`."""
        return ros_keys.attachment(number, time_ns, ros_keys.publisher_id(token))

    def topics(self, session: ForeignSession, kind: str) -> list[Endpoint]:
        """See `Wire.topics`."""
        tokens = session.present(ros_keys.all_tokens(self._domain))
        return [each for each in ros_keys.endpoints(tokens) if each.kind == kind]


class TopicWire:
    """Keys are the topics' names, below a prefix if there is one; nobody says what they carry."""

    def __init__(self, codec: Codec, prefix: str = "", *, stamped: bool = False) -> None:
        """Agree on the messages.

        Args:
            codec: Of the messages.
            prefix: Before every key: the bridge's namespace, or the robot's name.
            stamped: True to send TwistStamped.
        """
        self.codec, self._prefix, self._stamped = codec, prefix.strip("/"), stamped

    def heard_key(self, topic: str) -> str:
        """See `Wire.heard_key`."""
        return "/".join(filter(None, (self._prefix, topic.strip("/"))))

    def type_of(self, key: str, default: str) -> str:
        """See `Wire.type_of`."""
        if default == IMAGE_TYPE and key.endswith((COMPRESSED_SUFFIX, COMPRESSED_DEPTH_SUFFIX)):
            return COMPRESSED_TYPE
        return STAMPED_TWIST_TYPE if self._stamped and default == TWIST_TYPE else default

    def address(self, session: ForeignSession, topic: str, type_names: tuple[str, ...], kind: str) -> Address:
        """See `Wire.address`."""
        stamped = self._stamped and STAMPED_TWIST_TYPE in type_names
        return Address(key=self.heard_key(topic), type_name=STAMPED_TWIST_TYPE if stamped else type_names[0])

    def announce(self, session: ForeignSession, topic: str, address: Address, kind: str, number: int) -> str:
        """Nobody asks."""
        return ""

    def attachment(self, number: int, time_ns: int, token: str) -> bytes:
        """None."""
        return b""

    def topics(self, session: ForeignSession, kind: str) -> list[Endpoint]:
        """Nobody says."""
        return []


def make_wire(name: WireName, *, domain: int, prefix: str, stamped: bool, node: str) -> Wire:
    """The wire of a name.

    Raises:
        ConfigError: If it needs rosbags, and that is not installed.
    """
    if name == "ros2":
        return RosWire(domain, node)
    if name == "bridge":
        return TopicWire(RosCodec(), prefix, stamped=stamped)
    return TopicWire(PlainCodec(), prefix)
