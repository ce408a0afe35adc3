"""Episodes staged for viewers: at their place in a shard's time, among frames, markers and the scene's map."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from readygo.common.arrays import Float64Array
from readygo.common.dataset import columns, markers, packed, schemas
from readygo.common.dataset.canonical import HALF_PX, record_head, shift_times, with_pixels_moved
from readygo.common.dataset.chunk import EpisodeChunk, parse, read_chunk
from readygo.common.dataset.columns import Part, Pieces
from readygo.common.dataset.packed import Messages
from readygo.common.dataset.poses import pose_xyzyaw
from readygo.common.dataset.records import Message, iter_messages
from readygo.common.dataset.scene_map import MapMessages, map_messages
from readygo.common.dataset.schemas import Channel
from readygo.common.robot.config import RobotConfig

if TYPE_CHECKING:
    from readygo.common.scenes import SceneMaps

PAUSE_NS = schemas.NS_PER_S
"""Between the last sample of an episode and the first of the next one in a shard."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Scenery:
    """What viewers show around the samples of a run."""

    robot: RobotConfig | None = None
    """Gives the cameras their places, and the robot its size; None leaves both out."""
    maps: "SceneMaps | None" = None
    """Maps of the scene, read with the first episode; None leaves the map out."""

    def of(self, drawn: Mapping[str, float]) -> "Scenery":
        """The stage of an episode, whose robot is one of the robot's ranges; see `EpisodeHeader.drawn`."""
        return replace(self, robot=self.robot.with_values(drawn)) if self.robot and drawn else self

    def stage_episode(self, chunk: EpisodeChunk, start_ns: int, *, with_map: bool) -> EpisodeChunk:
        """An episode as a shard holds it.

        Args:
            chunk: The episode in canonical form.
            start_ns: When it begins in the shard.
            with_map: True for a shard's first episode, which has the map before its samples.

        Raises:
            SceneError: If the map cannot be read.
        """
        view, stage, shift_ns = memoryview(chunk.data), self.of(chunk.drawn), start_ns - chunk.start_time_ns
        messages = list(iter_messages(view, 0, len(view)))
        beside = stage._beside(view, messages, chunk, shift_ns)
        parts: list[bytes | memoryview] = []
        for message in messages:
            time_ns = message.log_time_ns + shift_ns
            number, payload = message.channel, shift_times(view, message, shift_ns)
            followers = [(other, next(rows)) for other, rows in beside.get(number, ())]
            if number == schemas.CALIBRATION.number:
                number, payload = schemas.ROS_CALIBRATION.number, with_pixels_moved(payload, -HALF_PX)
                around = stage.surroundings(chunk.samples["pose"], chunk.goal_xy_m, start_ns, with_map=with_map)
                followers = [(channel.number, content) for channel, content in around]
            for each, content in ((number, payload), *followers):
                parts += (record_head(each, message.sequence, time_ns, time_ns, len(content)), content)
        return read_chunk(b"".join(parts), sha256=chunk.sha256)

    def surroundings(
        self, poses_xyzyaw: Float64Array, goal_xy_m: Sequence[float], start_ns: int, *, with_map: bool
    ) -> list[tuple[Channel, bytes]]:
        """The messages with what stays where it is over an episode.

        Args:
            poses_xyzyaw: The robot at every sample: x, y, z [m], yaw [rad], shape (S, 4).
            goal_xy_m: The goal [m].
            start_ns: When the episode begins in the shard.
            with_map: True for a shard's first episode, which has the map before its samples.
        """
        stamp = schemas.timestamp(start_ns)
        found = [
            (schemas.MARKERS, markers.markers(poses_xyzyaw, goal_xy_m, self.robot, stamp)),
            (schemas.PATH, markers.path_cloud(poses_xyzyaw, goal_xy_m, stamp)),
        ]
        if self.robot is not None:
            found.append((schemas.ROBOT_OUTLINE, markers.robot_outline(self.robot, stamp)))
        if with_map and self._map is not None:
            for content in self._map:
                content.timestamp.CopyFrom(stamp)
            found += zip((schemas.MAP, schemas.MAP_POINTS), self._map, strict=True)
        return [(channel, schemas.serialize(content)) for channel, content in found]

    def frames(self, position: Part, orientation: Part) -> Messages:
        """The messages that go with a robot's poses; see `markers.frames`."""
        return markers.frames(position, orientation, self._cameras)

    @cached_property
    def _map(self) -> MapMessages | None:
        return None if self.maps is None else map_messages(self.maps.robot, self.maps.floor)

    @cached_property
    def _cameras(self) -> tuple[bytes, ...]:
        return () if self.robot is None else markers.camera_frames(self.robot)

    def _beside(
        self, view: memoryview, messages: Sequence[Message], chunk: EpisodeChunk, shift_ns: int
    ) -> dict[int, list[tuple[int, Iterator[bytes]]]]:
        """What follows each message of a channel, by its number: other channels' numbers and their messages."""

        def parse_messages(channel: Channel) -> list[Any]:
            return [parse(channel, view[m.body : m.end]) for m in messages if m.channel == channel.number]

        times_ns = [m.log_time_ns + shift_ns for m in messages if m.channel == schemas.ROBOT_POSE.number]
        stamps = columns.stamps(np.array(times_ns, dtype=np.uint64))
        poses = [message.pose for message in parse_messages(schemas.ROBOT_POSE)]
        position, orientation = (
            Pieces([schemas.serialize(getattr(pose, name)) for pose in poses]) for name in ("position", "orientation")
        )
        shown = {schemas.ROBOT_POSE: self.frames(position, orientation)}
        if "boxes" not in chunk.outputs:
            humans = [[pose_xyzyaw(pose) for pose in message.poses] for message in parse_messages(schemas.HUMANS)]
            shown[schemas.HUMANS] = markers.bodies(*packed.people(humans))
        return {
            channel.number: [(each.channel.number, iter(columns.rows_of(each.at(stamps))))]
            for channel, each in shown.items()
        }
