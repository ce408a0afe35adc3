"""What robots see: batches of views from a renderer."""

import hashlib
from collections.abc import Sequence
from weakref import WeakKeyDictionary

import numpy as np
import numpy.typing as npt

from readygo.common.bus import Bus
from readygo.common.camera.depth import depth_bytes, depth_rng, measured_depth
from readygo.common.episode.simulation import EpisodeSimulation
from readygo.common.errors import BusError
from readygo.common.maps import FloorMap
from readygo.common.messages import EpisodeKey, EpisodeMotions, Humans, RenderReply, RenderRequest, RenderView, encode
from readygo.common.messages.topics import Topic
from readygo.common.policy.sight import DEPTH, RGB, side_by_side
from readygo.common.robot import RobotConfig
from readygo.common.robot.kinematics import whole_steps

SHUTTER_STEPS = 2
"""Longest time from a frame's first light to its own time: 0.05 s of exposure and as much of readout."""


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
        self._camera, self._floor = robot.camera, floor
        self._latency_steps = whole_steps(robot.camera.latency_s)
        self._sees = sees
        self._sent: set[str] = set()
        self._keys: WeakKeyDictionary[EpisodeSimulation, str] = WeakKeyDictionary()

    def look(self, simulations: Sequence[EpisodeSimulation]) -> npt.NDArray[np.uint8]:
        """What policies see, from `measured`: sRGB, shape (B, H, W, 3), or with depths, shape (B, H, W, C)."""
        rgb, depths_m = self.measured(simulations)
        if depths_m is None:
            return rgb
        return side_by_side({RGB: rgb, DEPTH: depth_bytes(np.stack(depths_m), self._camera)}, self._sees)

    def measured(
        self, simulations: Sequence[EpisodeSimulation]
    ) -> tuple[npt.NDArray[np.uint8], list[npt.NDArray[np.float32]] | None]:
        """What each robot sees now: the image of the camera's latency ago, the first one until there is one so old.

        Args:
            simulations: Episodes, at any step.

        Returns:
            sRGB images, shape (B, H, W, 3), and depths [m], inf where nothing is measured, B of shape (H, W); None
            where the eyes see none.

        Raises:
            BusError: If the renderer does not answer, or not with one image per view.
        """
        people = [simulation.motions_so_far() for simulation in simulations]
        keys = [self._key(simulation, motions) for simulation, motions in zip(simulations, people, strict=True)]
        views = tuple(self._view(simulation, key) for simulation, key in zip(simulations, keys, strict=True))
        reply = self._reply(views, {key: motions for key, motions in zip(keys, people, strict=True) if key})
        return reply.rgb, self._measured(reply, views)

    def _measured(self, reply: RenderReply, views: Sequence[RenderView]) -> list[npt.NDArray[np.float32]] | None:
        """Depths as the robots' cameras measure them [m], shapes (H, W); None where nobody wants them."""
        if DEPTH not in self._sees:
            return None
        return [
            measured_depth(depth_m, self._camera, depth_rng(view.episode.episode_id, view.step))
            for depth_m, view in zip(reply.outputs[DEPTH], views, strict=True)
            if view.episode is not None
        ]

    def look_from(self, xyyaw: Sequence[tuple[float, float, float]], episode: EpisodeKey) -> npt.NDArray[np.uint8]:
        """What a robot that stands somewhere sees with nobody there, as with an image of a goal.

        Args:
            xyyaw: Poses: x [m], y [m], yaw [rad], B of them.
            episode: Whose camera looks.

        Returns:
            sRGB images, shape (B, H, W, 3).

        Raises:
            BusError: See `look`.
        """
        return self._reply(tuple(self._still_view(pose, episode) for pose in xyyaw), {}).rgb

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
        step = max(simulation.step - self._latency_steps, 0)
        path = simulation.path_xyyaw(max(step - SHUTTER_STEPS, 0), step).tolist()
        x_m, y_m, yaw_rad = path[-1]
        return RenderView(
            people=people,
            step=step,
            T_world_camera=self._camera.T_world_camera(x_m, y_m, yaw_rad, self._floor.at(x_m, y_m)),
            episode=simulation.scenario.episode,
            path_xyyaw=tuple((x, y, yaw) for x, y, yaw in path),
        )

    def _still_view(self, pose: tuple[float, float, float], episode: EpisodeKey) -> RenderView:
        x_m, y_m, yaw_rad = pose
        T_world_camera = self._camera.T_world_camera(x_m, y_m, yaw_rad, self._floor.at(x_m, y_m))
        return RenderView(people="", step=0, T_world_camera=T_world_camera, episode=episode)


def humans_key(motions: EpisodeMotions) -> str:
    """A name for the people of an episode, from who they are and how they move; empty without people."""
    return hashlib.sha256(encode(motions)).hexdigest()[:24] if motions.humans else ""
