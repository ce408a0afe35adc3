"""A robot on the network: its newest images and odometry, and the commands to it."""

import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from readygo.apps.drive.messages import (
    GoalMessage,
    ImageMessage,
    OdometryMessage,
    PeopleMessage,
    ScanMessage,
    VelocityMessage,
)
from readygo.apps.drive.ros_codec import (
    COMPRESSED_TYPE,
    GOAL_TYPE,
    IMAGE_TYPE,
    OUTCOME_TYPE,
    PEOPLE_TYPE,
    SCAN_TYPE,
    STAMPED_TWIST_TYPE,
    TWIST_TYPE,
)
from readygo.apps.drive.ros_keys import PUBLISHER, SUBSCRIBER
from readygo.apps.drive.wires import RosWire, TopicKey, Wire
from readygo.apps.robot_logs.reader import INFO_TYPE, ODOMETRY_TYPE, LogCamera
from readygo.common.bus.foreign import ForeignPublisher, ForeignSession
from readygo.common.errors import BusError
from readygo.common.images.names import RGB, image_name

BESIDE_MAX = 8
"""Largest number of waiting images for the pilot, of each image besides the first camera's."""
ODOMETRY_MAX = 256
"""Largest number of waiting odometry messages for the pilot."""
DEADMAN_S = 0.3
"""Time without a command after which the watchdog thread stops the robot [s]."""
FOUND_S = 2.0
"""Time within which the robot's base must subscribe to commands [s]."""
LAST_ZEROS, ZERO_EVERY_S = 3, 0.03
"""Number of stop commands on leaving a robot, and their period [s]: a single one may be lost."""
Listen = Callable[[str, str, Any, int], None]
"""Called with every message: topic, type, value, time of arrival or sending [ns since 1970]."""


@dataclass(frozen=True, kw_only=True)
class Topics:
    """Topics of a robot's messages; empty ones are not used."""

    image: str
    odometry: str
    command: str
    camera_info: str = ""
    goal: str = ""
    outcome: str = ""
    beside: Mapping[str, str] = field(default_factory=dict)
    """Topics of the images besides the first camera's, by their names (`readygo.common.images.names`)."""
    infos: Mapping[str, str] = field(default_factory=dict)
    """CameraInfo topics of the cameras besides the first one, by name."""
    people: str = ""
    """Topic that people are published on."""
    scan: str = ""
    """Topic that free distances are published on."""

    def heard(self) -> list[tuple[str, tuple[str, ...]]]:
        """Topics to subscribe to, each with its possible types."""
        wanted = [
            (self.image, (IMAGE_TYPE, COMPRESSED_TYPE)),
            (self.odometry, (ODOMETRY_TYPE,)),
            (self.camera_info, (INFO_TYPE,)),
            (self.goal, (GOAL_TYPE,)),
            (self.outcome, (OUTCOME_TYPE,)),
            *((topic, (IMAGE_TYPE, COMPRESSED_TYPE)) for topic in self.beside.values()),
            *((topic, (INFO_TYPE,)) for topic in self.infos.values()),
        ]
        return [(topic, types) for topic, types in wanted if topic]


class Robot:
    """Connection to a robot: its newest messages, and its commands; `close` stops the robot."""

    def __init__(self, session: ForeignSession, wire: Wire, topics: Topics, *, dry: bool = False) -> None:
        """Subscribe to the robot's topics, and announce the commands.

        Args:
            session: Session on the robot's network.
            wire: Transport of the robot.
            topics: Topics of its messages.
            dry: True sends no commands.
        """
        self._session, self._wire, self._topics = session, wire, topics
        self._changed = threading.Condition()
        self._picture: tuple[ImageMessage, int] | None = None
        self._named = {topic: name for name, topic in topics.beside.items()}
        self._beside: deque[tuple[str, ImageMessage, int]] = deque(maxlen=BESIDE_MAX * max(len(self._named), 1))
        self._odometry: deque[tuple[OdometryMessage, int]] = deque(maxlen=ODOMETRY_MAX)
        self._cameras = {topic: camera for camera, topic in topics.infos.items()}
        self.cameras: dict[str, LogCamera] = {}
        """The camera of each camera's images by name, by its newest CameraInfo; the first one is called ""."""
        self.frame: str | None = None
        """Frame of the odometry, empty where it names none; None before the first one."""
        self.goal: GoalMessage | None = None
        """The newest goal; None before one arrives."""
        self.outcome = ""
        """The newest outcome on the outcome topic; empty before one arrives."""
        self.broken = ""
        """Reason why the newest invalid message could not be used; empty if there was none."""
        self.listen: Listen = lambda topic, type_name, value, time_ns: None
        for number, (topic, types) in enumerate(topics.heard(), start=1):
            self._hear(topic, types, number)
        self._commands: _Commands | None = None
        if not dry:
            number = len(topics.heard()) + 1
            types = (TWIST_TYPE, STAMPED_TWIST_TYPE)
            self._commands = _Commands(TopicPublisher(session, wire, topics.command, types, number))
        self._perceived: dict[str, TopicPublisher] = {}
        """Publishers of what is perceived, by their types."""
        perceived = ((PEOPLE_TYPE, topics.people), (SCAN_TYPE, topics.scan))
        for number, (kind, topic) in enumerate(perceived, start=len(topics.heard()) + 2):
            if topic:
                self._perceived[kind] = TopicPublisher(session, wire, topic, (kind,), number)

    def check_topics(self) -> str:
        """Empty if the robot's base subscribes to commands; else an error text with the topics that exist."""
        if self._commands is None or self._commands.heard(FOUND_S):
            return ""
        return f"No subscriber listens to {self._topics.command}{self._listeners()}."

    def next_picture(self, until_s: float) -> tuple[ImageMessage, int] | None:
        """Wait for a new image of the first camera or of another one, and take the first camera's newest.

        Args:
            until_s: End of the wait, by `time.monotonic` [s].

        Returns:
            The image and its arrival [ns]; None if it was taken before or has not arrived.
        """
        with self._changed:
            while self._picture is None and not self._beside and (left_s := until_s - time.monotonic()) > 0:
                self._changed.wait(left_s)
            picture, self._picture = self._picture, None
            return picture

    def beside(self) -> list[tuple[str, ImageMessage, int]]:
        """Images of further cameras since the last call: name, image, and arrival [ns]."""
        with self._changed:
            found = list(self._beside)
            self._beside.clear()
            return found

    def odometry(self) -> list[tuple[OdometryMessage, int]]:
        """Odometry messages since the last call, with their arrivals [ns]."""
        with self._changed:
            found = list(self._odometry)
            self._odometry.clear()
            return found

    def send(self, command: VelocityMessage) -> None:
        """Send a command to the robot and to `listen`; in a dry run to `listen` only."""
        if self._commands is not None:
            self._commands.send(command)
        self.listen(self._topics.command, TWIST_TYPE, command, time.time_ns())

    def tell(self, people: PeopleMessage, scan: ScanMessage) -> None:
        """Publish what is perceived, also in a dry run; `listen` gets it as well."""
        told = ((PEOPLE_TYPE, self._topics.people, people), (SCAN_TYPE, self._topics.scan, scan))
        for kind, topic, message in told:
            if (publisher := self._perceived.get(kind)) is not None:
                publisher.put(publisher.write(message, message.stamp_ns))
                self.listen(topic, kind, message, time.time_ns())

    def close(self) -> None:
        """Stop the robot, and close the session."""
        if self._commands is not None:
            self._commands.close()
        self._session.close()

    def absent(self) -> str:
        """Topics that the robot does not publish, with those that exist instead, in words."""
        there = self._wire.topics(self._session, PUBLISHER)
        named = {each.topic for each in there}
        words = []
        for topic, types in self._topics.heard():
            fitting = sorted({each.topic for each in there if each.type_name in types})
            if "/" + topic.strip("/") not in named and there:
                words.append(f"no node publishes {topic} (topics of that kind: {', '.join(fitting) or 'none'})")
        if not there and isinstance(self._wire, RosWire):
            return "no ROS 2 node is there: start it with RMW_IMPLEMENTATION=rmw_zenoh_cpp, or choose another --domain"
        return "; ".join(words)

    def _listeners(self) -> str:
        there = self._wire.topics(self._session, SUBSCRIBER)
        fitting = sorted({each.topic for each in there if each.type_name in (TWIST_TYPE, STAMPED_TWIST_TYPE)})
        return f"; topics on which robots hear velocities: {', '.join(fitting)}" if fitting else ""

    def _hear(self, topic: str, types: tuple[str, ...], number: int) -> None:
        address = self._wire.address(self._session, topic, types, SUBSCRIBER)
        self._wire.announce(self._session, topic, address, SUBSCRIBER, number)

        def on_message(key: str, payload: bytes, attachment: bytes) -> None:
            arrived_ns, wall_ns = time.monotonic_ns(), time.time_ns()
            type_name = self._wire.type_of(key, types[0])
            if type_name not in types:
                self.broken = f"{topic} carries {type_name}; it must be {' or '.join(types)}"
                return
            try:
                value = self._wire.codec.read(type_name, payload)
            except ValueError as error:
                self.broken = f"{topic}: {error}"
                return
            self._keep(topic, value, arrived_ns)
            self.listen(topic, type_name, value, wall_ns)

        self._session.hear(self._wire.heard_key(topic), on_message)

    def _keep(self, topic: str, value: Any, arrived_ns: int) -> None:
        with self._changed:
            if isinstance(value, ImageMessage) and topic in self._named:
                self._beside.append((self._named[topic], value, arrived_ns))
                self._changed.notify()
            elif isinstance(value, ImageMessage):
                self._picture = value, arrived_ns
                self._changed.notify()
            elif isinstance(value, OdometryMessage):
                self.frame = value.frame
                self._odometry.append((value, arrived_ns))
            elif isinstance(value, LogCamera):
                camera = self._cameras.get(topic, "")
                image = self._topics.beside.get(image_name(camera, RGB), "") if camera else self._topics.image
                self.cameras[camera] = value.of_images(image)
            elif isinstance(value, GoalMessage):
                self.goal = value
            elif isinstance(value, str):
                self.outcome = value


class TopicPublisher:
    """Publisher of one of a robot's topics."""

    def __init__(
        self,
        session: ForeignSession,
        wire: Wire,
        topic: str,
        types: tuple[str, ...],
        number: int,
        *,
        block: bool = False,
    ) -> None:
        """Announce the publisher.

        Args:
            session: Session on the robot's network.
            wire: Transport of the robot.
            topic: Name of the topic.
            types: Possible message types, the default first.
            number: Number of the topic within this program, from 1 on.
            block: True waits instead of dropping messages when the network is congested.
        """
        self._wire = wire
        address: TopicKey = wire.address(session, topic, types, PUBLISHER)
        self._type_name = address.type_name
        self._publisher: ForeignPublisher = session.publisher(address.key, block=block)
        self._token = wire.announce(session, topic, address, PUBLISHER, number)
        self._number = 0

    def heard(self, timeout_s: float) -> bool:
        """Wait up to `timeout_s` [s] for a subscriber; True if there is one."""
        return self._publisher.heard(timeout_s)

    def write(self, value: Any, stamp_ns: int) -> bytes:
        """Encode a message; `value` and `stamp_ns` as in `Codec.write`."""
        return self._wire.codec.write(self._type_name, value, stamp_ns)

    def put(self, payload: bytes) -> None:
        """Publish an encoded message from `write`."""
        self._number += 1
        self._publisher.put(payload, self._wire.attachment(self._number, time.time_ns(), self._token))


class _Commands:
    """Publisher of commands, with a watchdog thread that sends zero velocity if the program hangs."""

    def __init__(self, publisher: TopicPublisher) -> None:
        self._publisher = publisher
        self._lock = threading.Lock()
        self._sent_s = time.monotonic()
        self._over = threading.Event()
        threading.Thread(target=self._stand_by, name="deadman", daemon=True).start()

    def heard(self, timeout_s: float) -> bool:
        """Wait up to `timeout_s` [s] for a subscriber; True if there is one."""
        return self._publisher.heard(timeout_s)

    def send(self, command: VelocityMessage) -> None:
        """Publish a command."""
        with self._lock:
            if not self._over.is_set():
                self._sent_s = time.monotonic()
                self._publisher.put(self._publisher.write(command, time.time_ns()))

    def close(self) -> None:
        """Stop the robot with several zero commands."""
        for _ in range(LAST_ZEROS):
            self.send(VelocityMessage())
            time.sleep(ZERO_EVERY_S)
        self._over.set()

    def _stand_by(self) -> None:
        while not self._over.wait(DEADMAN_S / 3):
            if time.monotonic() - self._sent_s > DEADMAN_S:
                self.send(VelocityMessage())


def connect_robot(connect: str, wire: Wire, topics: Topics, *, dry: bool) -> Robot:
    """Connect to a robot behind a router.

    Raises:
        BusError: If there is no router, or no subscriber for the commands.
    """
    robot = Robot(ForeignSession(connect), wire, topics, dry=dry)
    no_listener = robot.check_topics()
    if no_listener:
        robot.close()
        raise BusError(f"{no_listener} Start the robot's base, or name its topic with --cmd-vel.")
    return robot
