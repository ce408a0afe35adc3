"""A robot that is none: it drives in an episode of a scene, and speaks as robots do, as late and as unreliably."""

import heapq
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from readygo.apps.drive.messages import Command, Goal, Odometry
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
from readygo.common.messages import Outcome
from readygo.common.robot.kinematics import DT_S, RATE_HZ

COMMAND_STALE_S = 0.5
"""A robot that hears nothing for so long stands, as bases of real robots do [s]."""
BEHIND_S = 0.5
"""A robot that is so late with its steps begins to count them anew [s]."""
CONSTANT_EVERY_S = 0.5
"""How often goal and camera are sent [s]."""
LEFT_S = 1.0
"""Who has sent no command for so long has gone [s]."""
Look = Callable[[EpisodeSimulation], tuple[npt.NDArray[np.uint8], npt.NDArray[np.float32] | None]]
"""What the robot sees now: sRGB, shape (H, W, 3), and depths [m], inf where nothing is measured, shape (H, W); None for
a robot without a depth camera."""


@dataclass(frozen=True, kw_only=True)
class Manners:
    """How late, and how unreliably, a robot speaks."""

    latency_s: float = 0.05
    """From when an image is taken until it is sent [s]."""
    jitter_s: float = 0.01
    """Standard deviation of that [s]."""
    drop_share: float = 0.02
    """Share of images that are lost."""
    camera_hz: float = RATE_HZ
    """Images per second: 20 divided by a whole number."""
    compressed: bool = False
    """Send JPEG in place of raw images."""

    def __post_init__(self) -> None:
        steps = RATE_HZ / self.camera_hz if self.camera_hz > 0 else 0.0
        if steps < 1 or steps != round(steps):
            raise ValueError(
                f"the camera's rate must be {RATE_HZ} Hz divided by a whole number, got {self.camera_hz:g}."
            )
        if self.latency_s < 0 or self.jitter_s < 0 or not 0 <= self.drop_share < 1:
            raise ValueError("latency and jitter must not be negative, and the share of lost images 0..1.")

    def sends(self, step: int, rng: np.random.Generator) -> bool:
        """True if an image is taken at a step and is not lost."""
        return step % round(RATE_HZ / self.camera_hz) == 0 and rng.random() >= self.drop_share

    def late_s(self, rng: np.random.Generator) -> float:
        """How long an image is on its way [s]."""
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


class SimulatedRobot:
    """Drives through one episode after the other as it is told."""

    def __init__(
        self,
        session: ForeignSession,
        wire: Wire,
        topics: Topics,
        camera: LogCamera,
        look: Look,
        manners: Manners,
        rng: np.random.Generator,
    ) -> None:
        self._look, self._manners, self._rng, self._camera = look, manners, rng, camera
        image_type = COMPRESSED_TYPE if manners.compressed else IMAGE_TYPE
        kinds = [
            (topics.image, image_type),
            (topics.odometry, ODOMETRY_TYPE),
            (topics.camera_info, INFO_TYPE),
            (topics.goal, GOAL_TYPE),
            (topics.outcome, OUTCOME_TYPE),
        ]
        self._depth_publisher: TopicPublisher | None = None
        if topics.depth:
            number = len(kinds) + 2
            self._depth_publisher = TopicPublisher(session, wire, topics.depth, (IMAGE_TYPE,), number, block=True)
        self._publishers = {
            kind: TopicPublisher(session, wire, topic, (kind,), number, block=True)
            for number, (topic, kind) in enumerate(kinds, start=1)
        }
        self._image_type = image_type
        self._lock = threading.Lock()
        self._command, self._heard_s = Command(), 0.0
        self._due: list[tuple[float, int, bytes, bytes]] = []
        self._taken, self._last_due_s, self._constant_s = 0, 0.0, 0.0
        self.behind = 0
        """How often the steps were so late that they were counted anew."""
        self._listen(session, wire, topics.command)

    def drive(self, simulation: EpisodeSimulation) -> Outcome:
        """Wait for somebody who drives, do as told until the episode ends, say how, and wait until they have gone."""
        self._during(simulation, lambda: self._commanded() != Command(), move=False)
        self._during(simulation, lambda: simulation.outcome is not None, move=True)
        outcome = simulation.outcome
        assert outcome is not None
        self._during(simulation, lambda: self._quiet(outcome), move=False)
        return outcome

    def _during(self, simulation: EpisodeSimulation, over: Callable[[], bool], *, move: bool) -> None:
        """Live in real time, step by step."""
        next_s = time.monotonic()
        step = 0
        while not over():
            self._show(simulation, step)
            step, next_s = step + 1, next_s + DT_S
            if time.monotonic() - next_s > BEHIND_S:
                self.behind, next_s = self.behind + 1, time.monotonic()
            self._send_until(next_s)
            if move:
                # What comes within a step counts for all of it, as a decision does in an evaluation.
                command = self._commanded()
                simulation.advance(command.v_mps, command.w_radps)

    def _show(self, simulation: EpisodeSimulation, step: int) -> None:
        """Say where the robot is, and take an image if it is time for one."""
        stamp_ns, now_s = time.time_ns(), time.monotonic()
        self._put(ODOMETRY_TYPE, odometry_of(simulation, stamp_ns), stamp_ns)
        if now_s - self._constant_s > CONSTANT_EVERY_S:
            self._constant_s = now_s
            goal_x, goal_y = simulation.scenario.goal_xy_m.tolist()
            self._put(GOAL_TYPE, Goal(x_m=goal_x, y_m=goal_y), stamp_ns)
            self._put(INFO_TYPE, self._camera, stamp_ns)
        if not self._manners.sends(step, self._rng):
            return
        rgb, depth_m = self._look(simulation)
        bgr = np.ascontiguousarray(rgb[..., ::-1])
        depths = b""
        if self._depth_publisher is not None and depth_m is not None:
            depths = self._depth_publisher.write(depth_m, stamp_ns)
        payload = self._publishers[self._image_type].write(bgr, stamp_ns)
        late_s = self._manners.late_s(self._rng)
        # Nothing overtakes on its way.
        self._last_due_s = max(now_s + late_s, self._last_due_s)
        self._taken += 1
        heapq.heappush(self._due, (self._last_due_s, self._taken, payload, depths))

    def _send_until(self, until_s: float) -> None:
        """Send images as they become due, until a time."""
        while True:
            due_s = self._due[0][0] if self._due else until_s
            time.sleep(max(min(due_s, until_s) - time.monotonic(), 0.0))
            if not self._due or due_s > until_s:
                return
            _, _, payload, depths = heapq.heappop(self._due)
            if self._depth_publisher is not None and depths:
                self._depth_publisher.put(depths)
            self._publishers[self._image_type].put(payload)

    def _put(self, kind: str, value: object, stamp_ns: int) -> None:
        publisher = self._publishers[kind]
        publisher.put(publisher.write(value, stamp_ns))

    def _commanded(self) -> Command:
        with self._lock:
            return self._command if time.monotonic() - self._heard_s < COMMAND_STALE_S else Command()

    def _quiet(self, outcome: Outcome) -> bool:
        """Say how the episode ended, until nobody drives any more."""
        self._put(OUTCOME_TYPE, outcome.value, time.time_ns())
        with self._lock:
            return time.monotonic() - self._heard_s > LEFT_S

    def _listen(self, session: ForeignSession, wire: Wire, topic: str) -> None:
        types = (TWIST_TYPE, STAMPED_TWIST_TYPE)
        wire.announce(session, topic, wire.address(session, topic, types, SUBSCRIBER), SUBSCRIBER, 9)

        def on_command(key: str, payload: bytes, attachment: bytes) -> None:
            command = wire.codec.read(wire.type_of(key, types[0]), payload)
            if isinstance(command, Command):
                with self._lock:
                    self._command, self._heard_s = command, time.monotonic()

        session.hear(wire.heard_key(topic), on_command)
