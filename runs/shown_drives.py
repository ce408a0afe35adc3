"""Shows on the bus what a driver perceives while it drives; see docs/live.md."""

import math
import time
from collections.abc import Callable

from readygo.common.arrays import UInt8Array
from readygo.common.bus import Bus
from readygo.common.drawing.files import jpeg_bytes
from readygo.common.episode import EpisodeSimulation
from readygo.common.episode.simulation import nearness
from readygo.common.maps import FloorMap
from readygo.common.messages import DriverKind, topics
from readygo.common.messages.live import LivePerception, LivePreview, LiveState
from readygo.common.perception import live_perception
from readygo.common.perception.episode import EpisodePerception, TakesLooks

EVERY_S = 0.25
"""Time between two looks that are shown, longer than the streams' own: all three messages are of one look [s]."""


class ShownDrives:
    """Told of a driver's looks: shows one of the episodes that it drives at a time."""

    def __init__(
        self, bus: Bus, floor: FloorMap, driver: DriverKind, clock: Callable[[], float] = time.monotonic
    ) -> None:
        """Show nothing yet.

        Args:
            bus: Bus of the run.
            floor: Height of the floor.
            driver: Who drives.
            clock: Wall clock [s].
        """
        self._bus, self._floor, self._driver, self._clock = bus, floor, driver, clock
        self._shown: EpisodeSimulation | None = None
        self._shown_s = -math.inf

    def __call__(
        self, simulation: EpisodeSimulation, perception: EpisodePerception[TakesLooks], image: UInt8Array
    ) -> None:
        """Show a look; arguments as in `readygo.common.perception.episode.OnLook`."""
        if self._shown is None or self._shown.outcome is not None:
            self._shown = simulation
        now_s = self._clock()
        if simulation is not self._shown or now_s - self._shown_s < EVERY_S:
            return
        self._shown_s = now_s
        episode, time_ns = simulation.scenario.episode, simulation.time_ns
        self._bus.tell(topics.STATE, lambda: drive_state(simulation, perception, self._floor, self._driver))
        self._bus.tell(topics.PERCEPTION, lambda: drive_perception(simulation, perception, self._floor))
        self._bus.tell(
            topics.PREVIEW,
            lambda: LivePreview(episode=episode, time_ns=time_ns, format="jpeg", image=jpeg_bytes(image)),
        )


def drive_perception(
    simulation: EpisodeSimulation, perception: EpisodePerception[TakesLooks], floor: FloorMap
) -> LivePerception:
    """What a driver perceives at the present step, after its first look."""
    assert perception.perceived is not None
    x, y, yaw = perception.pose
    return live_perception(
        simulation.scenario.episode,
        simulation.time_ns,
        (x, y, floor.at(x, y), yaw),
        perception.perceived,
        perception.people.tracker.known,
        simulation.robot.camera,
    )


def drive_state(
    simulation: EpisodeSimulation, perception: EpisodePerception[TakesLooks], floor: FloorMap, driver: DriverKind
) -> LiveState:
    """Where everybody is in an episode that is being driven."""
    goal_x_m, goal_y_m = simulation.scenario.goal_xy_m.tolist()
    x_m, y_m, step = simulation.x_m, simulation.y_m, simulation.step
    here, dt_s = simulation.human_xy_m, simulation.clock.dt_s
    steps = (here - simulation.human_xy_at(max(step - 1, 0))).tolist()
    distance_m, collision_s, humans = math.inf, math.inf, []
    for (hx, hy), (moved_x, moved_y) in zip(here.tolist(), steps, strict=True):
        humans.append((hx, hy, floor.at(hx, hy), math.atan2(moved_y, moved_x)))
        offset_m, walks_mps = (hx - x_m, hy - y_m), (moved_x / dt_s, moved_y / dt_s)
        near_m, contact_s = nearness(offset_m, walks_mps, simulation.yaw_rad, simulation.v_mps, simulation.contact_m)
        distance_m, collision_s = min(distance_m, near_m), min(collision_s, contact_s)
    camera = simulation.robot.camera
    return LiveState(
        episode=simulation.scenario.episode,
        time_ns=simulation.time_ns,
        sample=step,
        sample_count=simulation.clock.steps(simulation.config.time_limit_s),
        driver=driver,
        goal_xy_m=(goal_x_m, goal_y_m),
        robot_xyzyaw=(x_m, y_m, floor.at(x_m, y_m), simulation.yaw_rad),
        v_mps=simulation.v_mps,
        w_radps=simulation.w_radps,
        humans_xyzyaw=tuple(humans),
        human_visible=perception.perceived is not None and len(perception.perceived.people) > 0,
        human_distance_m=distance_m,
        time_to_collision_s=collision_s,
        replanned=False,
        horizontal_fov_rad=2 * math.atan(camera.width_px / (2 * float(camera.K_px[0, 0]))),
    )
