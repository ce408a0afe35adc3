"""Episodes staged for viewers: at their place in a shard's time, among frames, markers and the scene's map."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

from readygo.common.dataset import markers, schemas
from readygo.common.dataset.canonical import HALF_PX, moved, record_head, with_pixels_moved
from readygo.common.dataset.chunk import EpisodeChunk, messages_of, parse, read_chunk
from readygo.common.dataset.records import Message
from readygo.common.dataset.scene_map import MapMessages, map_messages
from readygo.common.dataset.schemas import Channel
from readygo.common.robot.config import RobotConfig

if TYPE_CHECKING:
    from readygo.common.scenes import SceneMaps

PAUSE_NS = schemas.NS_PER_S
"""Between the last sample of an episode and the first of the next one in a shard."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Stage:
    """What viewers show around the samples of a run."""

    robot: RobotConfig | None = None
    """Gives the camera its place, and the robot its size; None leaves both out."""
    maps: "SceneMaps | None" = None
    """Of the scene; None leaves the map out. They are read with the first episode."""

    def staged(self, chunk: EpisodeChunk, start_ns: int, *, with_map: bool) -> EpisodeChunk:
        """An episode as a shard holds it.

        Args:
            chunk: The episode in canonical form.
            start_ns: When it begins in the shard.
            with_map: True for a shard's first episode, which has the map before its samples.

        Raises:
            SceneError: If the map cannot be read.
        """
        view = memoryview(chunk.data)
        parts: list[bytes | memoryview] = []
        for message in messages_of(view):
            time_ns = message.log_time_ns - chunk.start_time_ns + start_ns
            for channel, payload in self._messages(view, message, chunk, start_ns, with_map):
                number = message.channel if channel is None else channel.number
                parts += (record_head(number, message.sequence, (time_ns, time_ns), len(payload)), payload)
        return read_chunk(b"".join(parts), sha256=chunk.sha256)

    @cached_property
    def _map(self) -> MapMessages | None:
        return None if self.maps is None else map_messages(self.maps.robot, self.maps.floor)

    @cached_property
    def _camera(self) -> Any | None:
        return None if self.robot is None else markers.camera_transform(self.robot.camera, None)

    def _messages(
        self, view: memoryview, message: Message, chunk: EpisodeChunk, start_ns: int, with_map: bool
    ) -> Iterator[tuple[Channel | None, bytes | memoryview]]:
        """A message at its time in the shard, its channel unchanged if it is None, and what goes with it."""
        payload = moved(view, message, start_ns - chunk.start_time_ns)
        if message.channel == schemas.CALIBRATION.number:
            yield schemas.ROS_CALIBRATION, with_pixels_moved(payload, -HALF_PX)
            for channel, content in self._surroundings(chunk, schemas.timestamp(start_ns), with_map):
                yield channel, schemas.serialized(content)
            return
        yield None, payload
        if message.channel == schemas.ROBOT_POSE.number:
            yield (
                schemas.TRANSFORMS,
                schemas.serialized(self._transforms(parse(schemas.ROBOT_POSE, memoryview(payload)))),
            )
        if message.channel == schemas.HUMANS.number and "boxes" not in chunk.outputs:
            humans = parse(schemas.HUMANS, memoryview(payload))
            yield schemas.BODIES, schemas.serialized(markers.bodies(humans.poses, humans.timestamp))

    def _surroundings(self, chunk: EpisodeChunk, stamp: Any, with_map: bool) -> Iterator[tuple[Channel, Any]]:
        """What stays where it is over an episode."""
        poses, goal_xy_m = chunk.samples["pose"], chunk.goal_xy_m
        yield schemas.MARKERS, markers.markers(poses, goal_xy_m, self.robot, stamp)
        yield schemas.PATH, markers.path_cloud(poses, goal_xy_m, stamp)
        if self.robot is not None:
            yield schemas.ROBOT_OUTLINE, markers.robot_outline(self.robot, stamp)
        if with_map and self._map is not None:
            for channel, content in zip((schemas.MAP, schemas.MAP_POINTS), self._map, strict=True):
                content.timestamp.CopyFrom(stamp)
                yield channel, content

    def _transforms(self, pose: Any) -> Any:
        """The frames of robot and camera of a PoseInFrame."""
        frames = [markers.robot_transform(pose.pose, pose.timestamp)]
        if self._camera is not None:
            self._camera.timestamp.CopyFrom(pose.timestamp)
            frames.append(self._camera)
        return markers.transforms(frames)
