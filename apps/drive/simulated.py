"""A robot that is none: it drives in an episode of a scene, and speaks as robots do, as late and as unreliably."""

import heapq
import threading
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from readygo.apps.drive.messages import Command as RobotCommand
from readygo.apps.drive.messages import Goal, Odometry
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
from readygo.common.bus.foreign import ForeignSession
from readygo.common.episode import EpisodeSimulation
from readygo.common.episode.loop import Command, DriverFailure, run_episode
from readygo.common.images.names import RGB
from readygo.common.messages import Outcome
from readygo.common.robot import Clock
from readygo.services.driver import DriverConfig

COMMAND_STALE_S = 0.5
"""A robot that hears nothing for so long stands, as bases of real robots do [s]."""
BEHIND_S = 0.5
"""A robot that is so late with its steps begins to count them anew [s]."""
CONSTANT_EVERY_S = 0.5
"""How often goal and camera are sent [s]."""
LEFT_S = 1.0
"""Who has sent no command for so long has gone [s]."""
Look = Callable[[EpisodeSimulation], dict[str, npt.NDArray[Any]]]
"""What the robot sees now, by the names of the images (`readygo.common.images.names`): sRGB, shape (H, W, 3), and
depths [m], inf where nothing is measured, shape (H, W)."""


@dataclass(frozen=True, kw_only=True)
class Manners:
    """How late, and how unreliably, a robot speaks."""

    latency_s: float = 0.05
    """From when an image is taken until it is sent [s]."""
    jitter_s: float = 0.01
    """Standard deviation of that [s]."""
    drop_share: float = 0.02
    """Share of images that are lost."""
    camera_hz: float | None = None
    """Images per second: those of the robot's camera, divided by a whole number; None takes all of them."""
    compressed: bool = False
    """Send JPEG in place of raw images."""

    def __post_init__(self) -> None:
        if self.latency_s < 0 or self.jitter_s < 0 or not 0 <= self.drop_share < 1:
            raise ValueError("latency and jitter must not be negative, and the share of lost images 0..1.")

    def image_every(self, clock: Clock) -> int:
        """Steps from image to image.

        Raises:
            ConfigError: If the rate is none of the camera's divided by a whole number.
        """
        return DriverConfig(camera_hz=self.camera_hz).image_every(clock)

    def sent(self, names: Iterable[str], rng: np.random.Generator) -> dict[str, float]:
        """The images of one time that are not lost, and how long each is on its way [s].

        Args:
            names: Of the images.
            rng: Of the manners.
        """
        return {name: self._late_s(rng) for name in names if rng.random() >= self.drop_share}

    def _late_s(self, rng: np.random.Generator) -> float:
        return max(self.latency_s + self.jitter_s * float(rng.standard_normal()), 0.0)


def odometry_of(simulation: EpisodeSimulation, stamp_ns: int) -> Odometry:
    """Where the robot of an episode is now."""
    return Odometry(
        stamp_ns=stamp_ns,
        x_m=simulation.x_m,
        y_m=simulation.y_m,
        yaw_rad=simulation.yaw_rad,
        v_mps=simulation.v_mps,
        w_radps=simulation.w_radps,
    )


def sent(image: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """An image as messages have it: blue, green, red; depths as they are."""
    return np.ascontiguousarray(image[..., ::-1]) if image.ndim == 3 else image


class SimulatedRobot:
    """Drives through one episode after the other as its client commands: the driver of `run_episode`."""

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
        """Be on a network.

        Args:
            session: Of the network.
            wire: How it speaks.
            topics: Where.
            cameras: What it says of its cameras, by their names; the first one is called "".
            look: What they show; it has what `topics` names.
            manners: How it speaks.
            rng: Of that.
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
        # What it hears has a number of its own behind these.
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
        """How often the steps were so late that they were counted anew."""
        self._listen(session, wire, topics.command, len(kinds) + 1)

    def drive(self, simulation: EpisodeSimulation) -> Outcome:
        """Wait for somebody who drives, do as told until the episode ends, say how, and wait until they have gone."""
        run_episode(simulation, self)
        outcome = simulation.outcome
        assert outcome is not None
        self._stand(simulation, lambda: self._quiet(outcome))
        return outcome

    def start(self, simulation: EpisodeSimulation) -> None:
        """Stand until a client commands the robot."""
        self._stand(simulation, lambda: self._commanded() != RobotCommand())
        self._step, self._next_s = 0, time.monotonic()

    def act(self, running: Sequence[tuple[EpisodeSimulation, None]]) -> list[Command | DriverFailure]:
        """The client's command after one step of real time.

        A command within a step counts for all of it, as a decision does in an evaluation.
        """
        ((simulation, _),) = running
        self._live(simulation)
        command = self._commanded()
        return [(command.v_mps, command.w_radps)]

    def _stand(self, simulation: EpisodeSimulation, over: Callable[[], bool]) -> None:
        """Send what the robot sees without moving."""
        self._step, self._next_s = 0, time.monotonic()
        while not over():
            self._live(simulation)

    def _live(self, simulation: EpisodeSimulation) -> None:
        """One step of real time."""
        self._show(simulation, self._step)
        self._step, self._next_s = self._step + 1, self._next_s + simulation.clock.dt_s
        if time.monotonic() - self._next_s > BEHIND_S:
            self.behind, self._next_s = self.behind + 1, time.monotonic()
        self._send_until(self._next_s)

    def _show(self, simulation: EpisodeSimulation, step: int) -> None:
        """Say where the robot is, and take an image if it is time for one."""
        stamp_ns, now_s = time.time_ns(), time.monotonic()
        self._put(ODOMETRY_TYPE, odometry_of(simulation, stamp_ns), stamp_ns)
        if now_s - self._constant_s > CONSTANT_EVERY_S:
            self._constant_s = now_s
            goal_x, goal_y = simulation.scenario.goal_xy_m.tolist()
            self._put(GOAL_TYPE, Goal(x_m=goal_x, y_m=goal_y), stamp_ns)
            for camera, publisher in self._infos.items():
                publisher.put(publisher.write(self._cameras[camera], stamp_ns))
        if step % self._manners.image_every(simulation.clock):
            return
        late_s = self._manners.sent(self._images, self._rng)
        if not late_s:
            return
        images = self._look(simulation)
        for name, late in late_s.items():
            payload = self._images[name].write(sent(images[name]), stamp_ns)
            # Nothing overtakes on its way.
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

    def _commanded(self) -> RobotCommand:
        with self._lock:
            return self._command if time.monotonic() - self._heard_s < COMMAND_STALE_S else RobotCommand()

    def _quiet(self, outcome: Outcome) -> bool:
        """Say how the episode ended, until nobody drives any more."""
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
