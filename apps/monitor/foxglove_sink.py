"""Foxglove, live: the channels, frames and markers of the shards over its WebSocket protocol.

The only place that imports the foxglove SDK.
"""

import math
from typing import Any

import numpy as np
from foxglove_schemas_protobuf.ArrowPrimitive_pb2 import ArrowPrimitive
from foxglove_schemas_protobuf.Color_pb2 import Color
from foxglove_schemas_protobuf.LinePrimitive_pb2 import LinePrimitive
from foxglove_schemas_protobuf.Point3_pb2 import Point3
from foxglove_schemas_protobuf.Pose_pb2 import Pose
from foxglove_schemas_protobuf.Quaternion_pb2 import Quaternion
from foxglove_schemas_protobuf.SceneEntity_pb2 import SceneEntity
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from foxglove_schemas_protobuf.TextPrimitive_pb2 import TextPrimitive
from foxglove_schemas_protobuf.Vector3_pb2 import Vector3
from google.protobuf.duration_pb2 import Duration

from readygo.apps.monitor.feed import LiveMoment
from readygo.apps.monitor.shapes import ARROW_MIN_M
from readygo.apps.monitor.track import Pictures
from readygo.apps.pictures.perceived import FREE, PERCEIVED
from readygo.common.arrays import Float64Array
from readygo.common.camera import CameraConfig, SensorConfig
from readygo.common.dataset import columns, markers, packed, schemas
from readygo.common.dataset.canonical import HALF_PX, with_pixels_moved
from readygo.common.dataset.markers import BODY_HEIGHT_M
from readygo.common.dataset.scene_map import MapMessages
from readygo.common.dataset.schemas import Channel
from readygo.common.episode.robot import robot_of_episode
from readygo.common.errors import RunError
from readygo.common.extras import install_command
from readygo.common.frames import goal_in_robot_frame
from readygo.common.images.names import RGB, camera_of
from readygo.common.messages.live import LivePerception, LivePerson, LiveState
from readygo.common.messages.samples import EpisodeHeader, FurtherCamera, Sample
from readygo.common.perception.live import AHEAD_S, LIFT_M, covariance_ellipse, free_points
from readygo.common.robot import RobotConfig
from readygo.services.renderer import calibrations

NO_SENSOR = SensorConfig()
LIFETIME_NS = 600_000_000
"""Time after which viewers drop what is no longer perceived [ns]."""
MAP_EVERY = 5
"""Number of repetitions of the other constant content per repetition of the map, which is large."""


class FoxgloveSink:
    """A server that Foxglove connects to: Open connection, Foxglove WebSocket."""

    def __init__(
        self, robot: RobotConfig, maps: MapMessages | None, port: int, sensor: SensorConfig = NO_SENSOR
    ) -> None:
        """Start the server.

        Args:
            robot: Robot, with its size, cameras and ranges.
            maps: The map of the scene; None without one.
            port: Port on the loopback address, as the protocol has no authentication; 0 takes a free one.
            sensor: Variation of the cameras from episode to episode.

        Raises:
            RunError: If the SDK is not installed, or the port cannot be opened.
        """
        try:
            import foxglove
        except ImportError as error:
            command = install_command("foxglove")
            raise RunError(f"--foxglove needs foxglove-sdk; install it with: {command}") from error
        self._foxglove, self._robot, self._sensor, self._maps = foxglove, robot, sensor, maps
        self.context = foxglove.Context()
        """Context of all channels; tests record it."""
        self._frames: tuple[bytes, ...] = ()
        """Transforms of the cameras on the episode's robot."""
        self._cameras: tuple[FurtherCamera, ...] = ()
        """All cameras of the episode, the first one before the others."""
        self._channels: dict[int, Any] = {}
        self._begun = 0
        try:
            self._server = foxglove.start_server(name="readygo", host="127.0.0.1", port=port, context=self.context)
        except (OSError, RuntimeError, ValueError) as error:
            raise RunError(f"Cannot serve Foxglove at port {port}: {error}; choose another one.") from error
        self.port: int = self._server.port
        """Port of the server."""

    def begin(self, moment: LiveMoment, stamp_ns: int) -> None:
        """Show the content that is constant over an episode."""
        episode, stamp = moment.state.episode, schemas.timestamp(stamp_ns)
        robot = robot_of_episode(self._robot, episode)
        self._frames = markers.camera_frames(robot)
        self._cameras = calibrations(self._robot, self._sensor, episode)
        header = _header(moment, self._cameras)
        goal_xy_m = moment.state.goal_xy_m
        calibration = with_pixels_moved(schemas.calibration_message(header, stamp_ns), -HALF_PX)
        self._log(schemas.EPISODE_START, schemas.start_message(header), stamp_ns)
        self._log(schemas.ROS_CALIBRATION, calibration, stamp_ns)
        for channel, payload in packed.calibrations(header):
            self._log(channel, packed.stamp(stamp_ns) + payload, stamp_ns)
        shown = (
            (schemas.MARKERS, markers.markers(moment.way, goal_xy_m, robot, stamp)),
            (schemas.PATH, markers.path_cloud(moment.way, goal_xy_m, stamp)),
            (schemas.ROBOT_OUTLINE, markers.robot_outline(robot, stamp)),
        )
        for channel, message in shown:
            self._log(channel, schemas.serialize(message), stamp_ns)
        if self._maps is not None and self._begun % MAP_EVERY == 0:
            for channel, message in zip((schemas.MAP, schemas.MAP_POINTS), self._maps, strict=True):
                message.timestamp.CopyFrom(stamp)
                self._log(channel, schemas.serialize(message), stamp_ns)
        self._begun += 1

    def show(self, moment: LiveMoment, stamp_ns: int) -> None:
        """Show a moment; `stamp_ns` is the wall clock."""
        state, stamps = moment.state, columns.stamps(np.array([stamp_ns], dtype=np.uint64))
        messages = packed.messages([_sample(state, moment.images, self._robot)], _header(moment, self._cameras))
        messages.append(markers.frames(*packed.pose(np.array([state.robot_xyzyaw])), self._frames))
        messages.append(markers.bodies(*packed.people([state.humans_xyzyaw])))
        for each in messages:
            self._log(each.channel, b"".join(columns.bytes_of(each.at(stamps))), stamp_ns)
        if moment.perception is not None:
            shown = perception_scene(moment.perception, self._robot.camera, schemas.timestamp(stamp_ns))
            self._log(schemas.PERCEPTION, schemas.serialize(shown), stamp_ns)

    def close(self) -> None:
        """Stop the server."""
        self._server.stop()

    def _log(self, channel: Channel, payload: bytes, stamp_ns: int) -> None:
        if channel.number not in self._channels:
            name = channel.message.DESCRIPTOR.full_name
            schema = self._foxglove.Schema(name=name, encoding="protobuf", data=schemas.descriptor_set(channel.message))
            self._channels[channel.number] = self._foxglove.Channel(
                channel.topic, schema=schema, message_encoding="protobuf", context=self.context
            )
        self._channels[channel.number].log(payload, log_time=stamp_ns)


def perception_scene(perception: LivePerception, camera: CameraConfig, stamp: Any) -> Any:
    """The message on /perception: tracks with covariances, velocities and probabilities, and the free space.

    Args:
        perception: What a driver perceives.
        camera: The robot's camera.
        stamp: Time of the message, a protobuf Timestamp.
    """
    height_m = perception.robot_xyzyaw[2] + LIFT_M
    entities = [
        _entity(f"track {person.number}", stamp, **_track_shapes(person, height_m)) for person in perception.tracks
    ]
    free = _line(free_points(perception, camera), height_m, FREE)
    return SceneUpdate(entities=[*entities, _entity("free space", stamp, lines=[free])])


def _track_shapes(person: LivePerson, height_m: float) -> dict[str, Any]:
    """Shapes of a track by the fields of SceneEntity."""
    (x_m, y_m), (vx, vy) = person.xy_m, person.v_mps
    speed_mps, place = math.hypot(vx, vy), Vector3(x=x_m, y=y_m, z=height_m)
    text = f"{100 * person.presence:.0f} %, {speed_mps:.1f} m/s"
    shapes = {
        "lines": [_line(covariance_ellipse(person), height_m, PERCEIVED)],
        "texts": [
            TextPrimitive(
                pose=Pose(position=Vector3(x=x_m, y=y_m, z=height_m + BODY_HEIGHT_M), orientation=Quaternion(w=1.0)),
                billboard=True,
                font_size=0.25,
                color=_color(PERCEIVED),
                text=text,
            )
        ],
    }
    if speed_mps * AHEAD_S < ARROW_MIN_M:
        return shapes
    half_rad = math.atan2(vy, vx) / 2
    head_m = min(0.2, 0.5 * AHEAD_S * speed_mps)
    arrow = ArrowPrimitive(
        pose=Pose(position=place, orientation=Quaternion(z=math.sin(half_rad), w=math.cos(half_rad))),
        shaft_length=AHEAD_S * speed_mps - head_m,
        shaft_diameter=0.06,
        head_length=head_m,
        head_diameter=0.14,
        color=_color(PERCEIVED),
    )
    return {**shapes, "arrows": [arrow]}


def _entity(name: str, stamp: Any, **shapes: Any) -> Any:
    lifetime = Duration(nanos=LIFETIME_NS)
    return SceneEntity(timestamp=stamp, frame_id=schemas.WORLD_FRAME, id=name, lifetime=lifetime, **shapes)


def _line(xy_m: Float64Array, height_m: float, rgb: tuple[int, int, int]) -> Any:
    points = [Point3(x=x, y=y, z=height_m) for x, y in xy_m.tolist()]
    pose = Pose(orientation=Quaternion(w=1.0))
    return LinePrimitive(type=LinePrimitive.LINE_STRIP, pose=pose, thickness=0.03, points=points, color=_color(rgb))


def _color(rgb: tuple[int, int, int]) -> Any:
    red, green, blue = (value / 255 for value in rgb)
    return Color(r=red, g=green, b=blue, a=1.0)


def _header(moment: LiveMoment, cameras: tuple[FurtherCamera, ...]) -> EpisodeHeader:
    """The header of an episode, as far as its states contain it."""
    state, (first, *further) = moment.state, cameras
    x_m, y_m, _, yaw_rad = moment.way[0].tolist()
    return EpisodeHeader(
        episode=state.episode,
        sample_count=state.sample_count,
        goal_xy_m=state.goal_xy_m,
        start_xyyaw=(x_m, y_m, yaw_rad),
        avatars=(),
        encounters=(),
        image_format=moment.image_format,
        height_px=first.height_px,
        width_px=first.width_px,
        K_px=first.K_px,
        distortion_model=first.distortion_model,
        distortion=first.distortion,
        driver=state.driver,
        cameras=tuple(further),
    )


def _sample(state: LiveState, images: Pictures, robot: RobotConfig) -> Sample:
    x_m, y_m, _, yaw_rad = state.robot_xyzyaw
    known = ("", *robot.cameras)
    return Sample(
        seq=state.sample,
        crc32=0,
        time_ns=state.time_ns,
        image=images.get(RGB, b""),
        action_v_mps=state.v_mps,
        action_w_radps=state.w_radps,
        goal_xy_robot_m=goal_in_robot_frame(x_m, y_m, yaw_rad, state.goal_xy_m),
        robot_xyzyaw=state.robot_xyzyaw,
        humans_xyzyaw=state.humans_xyzyaw,
        human_distance_m=state.human_distance_m,
        time_to_collision_s=state.time_to_collision_s,
        human_visible=state.human_visible,
        expert_cost=0.0,
        replanned=state.replanned,
        outputs={name: image for name, image in images.items() if name != RGB and camera_of(name) in known},
    )
