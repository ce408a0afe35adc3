"""What robots see: batches of views from a renderer."""

import hashlib
import math
from collections.abc import Sequence
from weakref import WeakKeyDictionary

import numpy as np

from readygo.common.arrays import AnyArray, UInt8Array
from readygo.common.bus import Bus
from readygo.common.episode.goal import goal_pose
from readygo.common.episode.simulation import EpisodeSimulation
from readygo.common.errors import BusError
from readygo.common.images.names import RGB, kind_of
from readygo.common.maps import FloorMap
from readygo.common.messages import EpisodeMotions, Humans, RenderReply, RenderRequest, RenderView, encode
from readygo.common.messages.topics import Topic
from readygo.common.policy.sight import as_measured, in_bytes, side_by_side
from readygo.common.robot import RobotConfig

SHUTTER_S = 0.1
"""Longest time from a frame's first light to its own time: 0.05 s of exposure and as much of readout [s]."""


class Eyes:
    """Asks one renderer for images; people travel once, then by their key."""

    def __init__(
        self,
        bus: Bus,
        topic: Topic[RenderRequest, RenderReply],
        *,
        robot: RobotConfig,
        floor: FloorMap,
        timeout_s: float,
        sees: tuple[str, ...] = (RGB,),
    ) -> None:
        self._bus, self._topic, self._timeout_s = bus, topic, timeout_s
        self._robot, self._floor, self._clock = robot, floor, robot.clock
        self._latency_steps = self._clock.steps(robot.camera.latency_s)
        self._sees = sees
        self._sent: set[str] = set()
        self._keys: WeakKeyDictionary[EpisodeSimulation, str] = WeakKeyDictionary()

    def arrives(self, simulation: EpisodeSimulation) -> bool:
        """True if a new image comes at the episode's present step."""
        return self._clock.sees(simulation.step, self._latency_steps)

    def look(self, simulations: Sequence[EpisodeSimulation]) -> UInt8Array:
        """What policies see, from `measure`, as `PolicySpec.images` names it, shape (B, H, W, C)."""
        images = self.measure(simulations)
        return side_by_side({name: in_bytes(image, name, self._robot) for name, image in images.items()}, self._sees)

    def measure(self, simulations: Sequence[EpisodeSimulation]) -> dict[str, AnyArray]:
        """What each robot sees now: the images of the cameras' latency ago, the first ones until there are some so old.

        Args:
            simulations: Episodes, at any step.

        Returns:
            By name what the eyes see: sRGB images, shape (B, H, W, 3), and depths [m], inf where nothing is measured,
            shape (B, H, W).

        Raises:
            BusError: If the renderer does not answer, or not with one image per view.
        """
        people = [simulation.motions_so_far() for simulation in simulations]
        keys = [self._key(simulation, motions) for simulation, motions in zip(simulations, people, strict=True)]
        views = tuple(self._view(simulation, key) for simulation, key in zip(simulations, keys, strict=True))
        reply = self._reply(views, {key: motions for key, motions in zip(keys, people, strict=True) if key})
        names = [simulation.scenario.episode.episode_id for simulation in simulations]
        return {
            name: drawn
            if kind_of(name) == RGB
            else np.stack(
                [
                    as_measured(image, name, self._robot, episode, view.step)
                    for image, episode, view in zip(drawn, names, views, strict=True)
                ]
            )
            for name, drawn in {RGB: reply.rgb, **reply.outputs}.items()
        }

    def look_from(self, xyyaw: Sequence[tuple[float, float, float]], simulation: EpisodeSimulation) -> UInt8Array:
        """Images that a robot would see at some poses without humans, as for an image of a goal.

        Args:
            xyyaw: Poses: x [m], y [m], yaw [rad], B of them.
            simulation: The episode whose robot's camera looks.

        Returns:
            sRGB images, shape (B, H, W, 3).

        Raises:
            BusError: See `look`.
        """
        return self._reply(tuple(self._still_view(pose, simulation) for pose in xyyaw), {}).rgb

    def goal_image(self, simulation: EpisodeSimulation) -> UInt8Array:
        """What the robot would see at its goal without humans, sRGB, shape (H, W, 3).

        Raises:
            BusError: See `look`.
        """
        pose = goal_pose(simulation.scenario, simulation.robot_map, simulation.robot.planning_radius_m)
        image: UInt8Array = self.look_from([pose], simulation)[0]
        return image

    def _reply(self, views: tuple[RenderView, ...], known: dict[str, EpisodeMotions]) -> RenderReply:
        reply = self._ask(views, {key: motions for key, motions in known.items() if key not in self._sent})
        if reply.unknown_people:
            # A renderer keeps a few hundred keys only, and may have been replaced by another one.
            self._sent.difference_update(reply.unknown_people)
            reply = self._ask(views, known)
        if len(reply.rgb) != len(views):
            raise BusError(f"{self._topic.name!r} answered {len(reply.rgb)} images to {len(views)} views.")
        self._sent.update(known)
        return reply

    def _key(self, simulation: EpisodeSimulation, motions: EpisodeMotions) -> str:
        """The name of an episode's people; motions that grow are other people at every step."""
        if motions is not simulation.motions:
            return humans_key(motions)
        if simulation not in self._keys:
            self._keys[simulation] = humans_key(motions)
        return self._keys[simulation]

    def _ask(self, views: tuple[RenderView, ...], people: dict[str, EpisodeMotions]) -> RenderReply:
        request = RenderRequest(
            views=views,
            people=tuple(Humans(key=key, humans=motions.humans) for key, motions in people.items()),
            outputs=tuple(name for name in self._sees if name != RGB),
        )
        return self._bus.request(self._topic, request, timeout_s=self._timeout_s)

    def _view(self, simulation: EpisodeSimulation, people: str) -> RenderView:
        step = self._clock.image_step(simulation.step, self._latency_steps)
        path = simulation.path_xyyaw(max(step - math.ceil(SHUTTER_S * self._clock.rate_hz), 0), step).tolist()
        x_m, y_m, yaw_rad = path[-1]
        return RenderView(
            people=people,
            step=step,
            T_world_camera=simulation.robot.camera.T_world_camera(x_m, y_m, yaw_rad, self._floor.at(x_m, y_m)),
            episode=simulation.scenario.episode,
            path_xyyaw=tuple((x, y, yaw) for x, y, yaw in path),
        )

    def _still_view(self, pose: tuple[float, float, float], simulation: EpisodeSimulation) -> RenderView:
        (x_m, y_m, yaw_rad), episode = pose, simulation.scenario.episode
        T_world_camera = simulation.robot.camera.T_world_camera(x_m, y_m, yaw_rad, self._floor.at(x_m, y_m))
        return RenderView(people="", step=0, T_world_camera=T_world_camera, episode=episode)


def humans_key(motions: EpisodeMotions) -> str:
    """A name for the people of an episode, from who they are and how they move; empty without people."""
    return hashlib.sha256(encode(motions)).hexdigest()[:24] if motions.humans else ""
