"""A simulated robot on the network: drives in an episode of a scene, with the latency and losses of real robots."""

import heapq
import threading
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from readygo.apps.drive.messages import GoalMessage, OdometryMessage
from readygo.apps.drive.messages import VelocityMessage as RobotCommand
from readygo.apps.drive.robot import TopicPublisher, Topics
from readygo.apps.drive.ros_codec import (
    COMPRESSED_TYPE,
    GOAL_TYPE,
    IMAGE_TYPE,
    OUTCOME_TYPE,
    STAMPED_TWIST_TYPE,
    TWIST_TYPE,
)
from readygo.apps.drive.ros_keys import SUBSCRIBER
from readygo.apps.drive.wires import Wire
from readygo.apps.robot_logs.reader import INFO_TYPE, ODOMETRY_TYPE, LogCamera
from readygo.common.arrays import AnyArray
from readygo.common.bus.foreign import ForeignSession
from readygo.common.episode import EpisodeSimulation
from readygo.common.episode.loop import Command, DriverFailure, run_episode
from readygo.common.images.names import RGB
from readygo.common.messages import Outcome
from readygo.common.robot import Clock
from readygo.services.driver import DriverConfig

COMMAND_STALE_S = 0.5
"""Time without a command after which the robot stops, as bases of real robots do [s]."""
BEHIND_S = 0.5
"""Delay of the real-time steps after which their schedule is reset [s]."""
CONSTANT_EVERY_S = 0.5
"""Period of the messages with goal and CameraInfo [s]."""
LEFT_S = 1.0
"""Time without a command after which the client counts as gone [s]."""
Look = Callable[[EpisodeSimulation], dict[str, AnyArray]]
"""Returns the robot's current images by name (`readygo.common.images.names`): sRGB, shape (H, W, 3), and depths [m],
inf where nothing is measured, shape (H, W)."""


@dataclass(frozen=True, kw_only=True)
class Manners:
    """Latency, losses and format of a simulated robot's images."""

    latency_s: float = 0.05
    """Mean time between capture and sending of an image [s]."""
    jitter_s: float = 0.01
    """Standard deviation of the latency [s]."""
    drop_share: float = 0.02
    """Share of images that are lost, 0..1."""
    camera_hz: float | None = None
    """Image rate, the robot's camera rate divided by an integer [Hz]; None for the full rate."""
    compressed: bool = False
    """True sends JPEG instead of raw images."""

    def __post_init__(self) -> None:
        if self.latency_s < 0 or self.jitter_s < 0 or not 0 <= self.drop_share < 1:
            raise ValueError("latency and jitter must not be negative, and the share of lost images 0..1.")

    def image_every(self, clock: Clock) -> int:
        """Number of simulation steps from image to image.

        Raises:
            ConfigError: If the rate is not the camera's divided by an integer.
        """
        return DriverConfig(camera_hz=self.camera_hz).image_every(clock)

    def draw_latencies(self, names: Iterable[str], rng: np.random.Generator) -> dict[str, float]:
        """The images of one time that are not lost, with the latency of each [s].

        Args:
            names: Names of the images.
            rng: Random generator of latency and losses.
        """
        return {name: self._late_s(rng) for name in names if rng.random() >= self.drop_share}

    def _late_s(self, rng: np.random.Generator) -> float:
        return max(self.latency_s + self.jitter_s * float(rng.standard_normal()), 0.0)


def odometry_of(simulation: EpisodeSimulation, stamp_ns: int) -> OdometryMessage:
    """Odometry message of an episode's robot at the current step."""
    return OdometryMessage(
        stamp_ns=stamp_ns,
        x_m=simulation.x_m,
        y_m=simulation.y_m,
        yaw_rad=simulation.yaw_rad,
        v_mps=simulation.v_mps,
        w_radps=simulation.w_radps,
    )


def to_message_order(image: AnyArray) -> AnyArray:
    """An image in the channel order of messages (BGR); depths are unchanged."""
    return np.ascontiguousarray(image[..., ::-1]) if image.ndim == 3 else image


class SimulatedRobot:
    """Driver of `run_episode` that follows a client's commands over the network, one episode after the other."""

    looks = True

    def __init__(
        self,
        session: ForeignSession,
        wire: Wire,
        topics: Topics,
        cameras: Mapping[str, LogCamera],
        look: Look,
        manners: Manners,
        rng: np.random.Generator,
    ) -> None:
        """Announce the robot on a network.

        Args:
            session: Session on the network.
            wire: Transport.
            topics: Topics of its messages.
            cameras: CameraInfo of each camera by name; the first one is called "".
            look: Returns the images that `topics` names.
            manners: Latency, losses and format of its images.
            rng: Random generator of latency and losses.
        """
        self._look, self._manners, self._rng, self._cameras = look, manners, rng, cameras
        image_type = COMPRESSED_TYPE if manners.compressed else IMAGE_TYPE
        kinds = [
            (topics.image, image_type),
            (topics.odometry, ODOMETRY_TYPE),
            (topics.camera_info, INFO_TYPE),
            (topics.goal, GOAL_TYPE),
            (topics.outcome, OUTCOME_TYPE),
        ]
        self._publishers = {
            kind: TopicPublisher(session, wire, topic, (kind,), number, block=True)
            for number, (topic, kind) in enumerate(kinds, start=1)
        }
        # The subscription to commands takes the number after these.
        further = enumerate(topics.beside.items(), start=len(kinds) + 2)
        self._images = {RGB: self._publishers[image_type]} | {
            name: TopicPublisher(session, wire, topic, (image_type,), number, block=True)
            for number, (name, topic) in further
        }
        infos = enumerate(topics.infos.items(), start=len(kinds) + 2 + len(topics.beside))
        self._infos = {"": self._publishers[INFO_TYPE]} | {
            camera: TopicPublisher(session, wire, topic, (INFO_TYPE,), number, block=True)
            for number, (camera, topic) in infos
        }
        self._lock = threading.Lock()
        self._command, self._heard_s = RobotCommand(), 0.0
        self._due: list[tuple[float, int, str, bytes]] = []
        self._taken, self._constant_s = 0, 0.0
        self._last_due_s = dict.fromkeys(self._images, 0.0)
        self._step, self._next_s = 0, 0.0
        self.behind = 0
        """Number of resets of the real-time schedule because the steps were too late."""
        self._listen(session, wire, topics.command, len(kinds) + 1)

    def drive(self, simulation: EpisodeSimulation) -> Outcome:
        """Wait for a client, follow its commands until the episode ends, publish the outcome, wait for its end."""
        run_episode(simulation, self)
        outcome = simulation.outcome
        assert outcome is not None
        self._stand(simulation, lambda: self._quiet(outcome))
        return outcome

    def start(self, simulation: EpisodeSimulation) -> None:
        """Stand still until a client sends a command."""
        self._stand(simulation, lambda: self._current_command() != RobotCommand())
        self._step, self._next_s = 0, time.monotonic()

    def act(self, running: Sequence[tuple[EpisodeSimulation, None]]) -> list[Command | DriverFailure]:
        """The client's command after one step of real time.

        A command within a step holds for the whole step, as a decision does in an evaluation.
        """
        ((simulation, _),) = running
        self._live(simulation)
        command = self._current_command()
        return [(command.v_mps, command.w_radps)]

    def _stand(self, simulation: EpisodeSimulation, over: Callable[[], bool]) -> None:
        """Publish images and odometry without moving, until `over`."""
        self._step, self._next_s = 0, time.monotonic()
        while not over():
            self._live(simulation)

    def _live(self, simulation: EpisodeSimulation) -> None:
        """Publish for one step of real time."""
        self._show(simulation, self._step)
        self._step, self._next_s = self._step + 1, self._next_s + simulation.clock.dt_s
        if time.monotonic() - self._next_s > BEHIND_S:
            self.behind, self._next_s = self.behind + 1, time.monotonic()
        self._send_until(self._next_s)

    def _show(self, simulation: EpisodeSimulation, step: int) -> None:
        """Publish the odometry, and capture an image if one is due."""
        stamp_ns, now_s = time.time_ns(), time.monotonic()
        self._put(ODOMETRY_TYPE, odometry_of(simulation, stamp_ns), stamp_ns)
        if now_s - self._constant_s > CONSTANT_EVERY_S:
            self._constant_s = now_s
            goal_x, goal_y = simulation.scenario.goal_xy_m.tolist()
            self._put(GOAL_TYPE, GoalMessage(x_m=goal_x, y_m=goal_y, frame="odom"), stamp_ns)
            for camera, publisher in self._infos.items():
                publisher.put(publisher.write(self._cameras[camera], stamp_ns))
        if step % self._manners.image_every(simulation.clock):
            return
        late_s = self._manners.draw_latencies(self._images, self._rng)
        if not late_s:
            return
        images = self._look(simulation)
        for name, late in late_s.items():
            payload = self._images[name].write(to_message_order(images[name]), stamp_ns)
            # Images keep their order.
            self._last_due_s[name] = max(now_s + late, self._last_due_s[name])
            self._taken += 1
            heapq.heappush(self._due, (self._last_due_s[name], self._taken, name, payload))

    def _send_until(self, until_s: float) -> None:
        """Send images as they become due, until a time."""
        while True:
            due_s = self._due[0][0] if self._due else until_s
            time.sleep(max(min(due_s, until_s) - time.monotonic(), 0.0))
            if not self._due or due_s > until_s:
                return
            _, _, name, payload = heapq.heappop(self._due)
            self._images[name].put(payload)

    def _put(self, kind: str, value: object, stamp_ns: int) -> None:
        publisher = self._publishers[kind]
        publisher.put(publisher.write(value, stamp_ns))

    def _current_command(self) -> RobotCommand:
        with self._lock:
            return self._command if time.monotonic() - self._heard_s < COMMAND_STALE_S else RobotCommand()

    def _quiet(self, outcome: Outcome) -> bool:
        """Publish the outcome; True once no client has sent a command for `LEFT_S`."""
        self._put(OUTCOME_TYPE, outcome.value, time.time_ns())
        with self._lock:
            return time.monotonic() - self._heard_s > LEFT_S

    def _listen(self, session: ForeignSession, wire: Wire, topic: str, number: int) -> None:
        types = (TWIST_TYPE, STAMPED_TWIST_TYPE)
        wire.announce(session, topic, wire.address(session, topic, types, SUBSCRIBER), SUBSCRIBER, number)

        def on_command(key: str, payload: bytes, attachment: bytes) -> None:
            command = wire.codec.read(wire.type_of(key, types[0]), payload)
            if isinstance(command, RobotCommand):
                with self._lock:
                    self._command, self._heard_s = command, time.monotonic()

        session.hear(wire.heard_key(topic), on_command)
