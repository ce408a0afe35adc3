"""The channels of a shard: topics, schemas, and the messages that an episode has once.

Channel numbers are part of the bytes that an episode's SHA-256 covers: no channel ever gets another one. Those of
`CHANNELS` are in every shard, those of `OPTIONAL_CHANNELS` in the shards whose samples have these outputs:
further images, the labels of people, and the expert's commands. Those of `VIEW_CHANNELS` are for viewers, which need
frames, the map and markers to show an episode in 3-D; no sample is read from them and no hash covers them.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.Grid_pb2 import Grid
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
from foxglove_schemas_protobuf.PosesInFrame_pb2 import PosesInFrame
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from google.protobuf.timestamp_pb2 import Timestamp

from readygo.common.errors import DatasetError
from readygo.common.messages.episode import EpisodeKey, Split
from readygo.common.messages.plan import Driver, Outcome
from readygo.common.messages.proto.driving_pb2 import ExpertCommands
from readygo.common.messages.proto.readygo_pb2 import Action, EpisodeCommit, EpisodeStart, Goal, StepTruth
from readygo.common.messages.samples import EpisodeHeader

NS_PER_S = 1_000_000_000
WORLD_FRAME = "world"
ROBOT_FRAME = "robot"
CAMERA_FRAME = "camera"


@dataclass(frozen=True)
class Channel:
    """One channel: its number, topic and protobuf message class."""

    number: int
    topic: str
    message: Any


EPISODE_START = Channel(1, "/episode/start", EpisodeStart)
CALIBRATION = Channel(2, "/camera/calibration", CameraCalibration)
IMAGE = Channel(3, "/camera/image", CompressedImage)
ROBOT_POSE = Channel(4, "/robot/pose", PoseInFrame)
HUMANS = Channel(5, "/humans", PosesInFrame)
ACTION = Channel(6, "/robot/action", Action)
GOAL = Channel(7, "/robot/goal", Goal)
TRUTH = Channel(8, "/truth", StepTruth)
EPISODE_COMMIT = Channel(9, "/episode/commit", EpisodeCommit)
CHANNELS = (EPISODE_START, CALIBRATION, IMAGE, ROBOT_POSE, HUMANS, ACTION, GOAL, TRUTH, EPISODE_COMMIT)
SAMPLE_CHANNELS = (IMAGE, ROBOT_POSE, HUMANS, ACTION, GOAL, TRUTH)
"""Every sample has one message on each of these, in this order; see `samples_with` for images."""
OUTPUT_CHANNELS: Mapping[str, Channel] = {
    "depth": Channel(10, "/camera/depth", CompressedImage),
    "median_depth": Channel(11, "/camera/median_depth", CompressedImage),
    "alpha": Channel(12, "/camera/alpha", CompressedImage),
    "mask": Channel(13, "/camera/mask", CompressedImage),
    "normal": Channel(14, "/camera/normal", CompressedImage),
}
"""Channels of the images besides rgb."""
LABEL_CHANNELS: Mapping[str, Channel] = {
    "joints": Channel(15, "/humans/joints", PointCloud),
    "boxes": Channel(16, "/humans/boxes", SceneUpdate),
    "footprints": Channel(17, "/humans/footprints", PointCloud),
}
"""Channels of the labels of people; a shard has all of them or none."""
EXPERT = "expert"
EXPERT_CHANNELS: Mapping[str, Channel] = {EXPERT: Channel(18, "/robot/expert_commands", ExpertCommands)}
"""Channel of what the expert would do at the robot's states."""
OPTIONAL_CHANNELS: Mapping[str, Channel] = {**OUTPUT_CHANNELS, **LABEL_CHANNELS, **EXPERT_CHANNELS}
"""In the order of their messages, which follow those of `SAMPLE_CHANNELS`."""
ROS_CALIBRATION = Channel(19, "/camera/calibration", CameraCalibration)
"""The calibration as ROS and OpenCV have it, pixel centres at integers; in `CALIBRATION` they are at +0.5."""
TRANSFORMS = Channel(20, "/tf", FrameTransforms)
MARKERS = Channel(21, "/episode/markers", SceneUpdate)
PATH = Channel(22, "/episode/path", PointCloud)
ROBOT_OUTLINE = Channel(23, "/robot/outline", PointCloud)
BODIES = Channel(24, "/humans/bodies", SceneUpdate)
MAP = Channel(25, "/map", Grid)
MAP_POINTS = Channel(26, "/map/points", PointCloud)
VIEW_CHANNELS = (TRANSFORMS, MARKERS, PATH, ROBOT_OUTLINE, BODIES, MAP, MAP_POINTS)
"""What viewers need besides samples; point clouds repeat what Rerun does not show of a scene or a grid."""


_WITH_IMAGES = {channel.number for channel in (IMAGE, *OUTPUT_CHANNELS.values(), *EXPERT_CHANNELS.values())}


def samples_with(channel: Channel, sample_count: int, image_every: int) -> range:
    """The samples of an episode that have a message on a channel of samples: all, or those at which images were taken.

    Args:
        channel: One of `SAMPLE_CHANNELS` or `OPTIONAL_CHANNELS`.
        sample_count: Samples of the episode.
        image_every: See `EpisodeHeader.image_every`.
    """
    return range(0, sample_count, image_every if channel.number in _WITH_IMAGES else 1)


def image_every(commands: Any) -> int:
    """`EpisodeHeader.image_every` of an ExpertCommands message; where there is none, images are at all samples."""
    return int(commands.image_every) or 1


class Ending(NamedTuple):
    """How an episode ended, and who drove it."""

    outcome: Outcome = Outcome.SUCCESS
    driver: Driver = Driver.EXPERT
    policy: str = ""
    """SHA-256 of the offered policy that drove; empty if it was none."""


def schema_numbers(channels: Iterable[Channel]) -> dict[Any, int]:
    """Number of the schema of each message class of some channels: that of the first channel that there is for it."""
    first: dict[Any, int] = {}
    for channel in (*CHANNELS, *OPTIONAL_CHANNELS.values(), *VIEW_CHANNELS):
        first.setdefault(channel.message, channel.number)
    used = {channel.message for channel in channels}
    return {message: number for message, number in first.items() if message in used}


def channels_with(outputs: Iterable[str]) -> tuple[Channel, ...]:
    """All channels of a shard whose samples have `outputs`."""
    return (*CHANNELS, *output_channels(outputs).values())


def staged_channels(outputs: Iterable[str]) -> tuple[Channel, ...]:
    """All channels of a shard whose samples have `outputs` and whose episodes are staged for viewers."""
    content = (channel for channel in channels_with(outputs) if channel is not CALIBRATION)
    return (*content, ROS_CALIBRATION, *VIEW_CHANNELS)


def output_channels(outputs: Iterable[str], known: Mapping[str, Channel] = OPTIONAL_CHANNELS) -> dict[str, Channel]:
    """The channels of some of the `known` outputs, in their order in a shard.

    Raises:
        DatasetError: If there is no channel for an output.
    """
    names = set(outputs)
    unknown = sorted(names - set(known))
    if unknown:
        raise DatasetError(f"There is no channel for {unknown[0]!r} images; known are {', '.join(OUTPUT_CHANNELS)}.")
    return {name: channel for name, channel in known.items() if name in names}


def descriptor_set(message: Any) -> bytes:
    """Serialised FileDescriptorSet of a message class with all its imports, imports first."""
    files: dict[str, Any] = {}

    def add(file: Any) -> None:
        if file.name not in files:
            for dependency in file.dependencies:
                add(dependency)
            files[file.name] = file

    add(message.DESCRIPTOR.file)
    descriptors = FileDescriptorSet()
    for file in files.values():
        file.CopyToProto(descriptors.file.add())
    serialized: bytes = descriptors.SerializeToString()
    return serialized


def start_message(header: EpisodeHeader) -> bytes:
    """The EpisodeStart of an episode."""
    x_m, y_m, yaw_rad = header.start_xyyaw
    return serialized(
        EpisodeStart(
            episode_id=header.episode.episode_id,
            seed=header.episode.seed,
            split=header.episode.split.value,
            index=header.episode.index,
            sample_count=header.sample_count,
            goal_x_m=header.goal_xy_m[0],
            goal_y_m=header.goal_xy_m[1],
            start_x_m=x_m,
            start_y_m=y_m,
            start_yaw_rad=yaw_rad,
            avatars=header.avatars,
            encounters=header.encounters,
            image_format=header.image_format,
        )
    )


def calibration_message(header: EpisodeHeader, stamp_ns: int) -> bytes:
    """The CameraCalibration of an episode."""
    k = list(header.K_px)
    return serialized(
        CameraCalibration(
            timestamp=timestamp(stamp_ns),
            frame_id=CAMERA_FRAME,
            width=header.width_px,
            height=header.height_px,
            distortion_model=header.distortion_model,
            D=header.distortion,
            K=k,
            R=[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
            P=[*k[0:3], 0.0, *k[3:6], 0.0, *k[6:9], 0.0],
        )
    )


def stamped_parts(message: Any) -> list[Any]:
    """The parts of a message that carry a time, in `timestamp`; readygo's own messages have none."""
    parts = {"SceneUpdate": "entities", "FrameTransforms": "transforms"}.get(message.DESCRIPTOR.name)
    candidates = getattr(message, parts) if parts else [message]
    return [part for part in candidates if "timestamp" in part.DESCRIPTOR.fields_by_name]


def stamps_ns(message: Any) -> list[int]:
    """The times inside of a message [ns]."""
    return [part.timestamp.ToNanoseconds() for part in stamped_parts(message)]


def commit_message(episode: EpisodeKey, attempt: int, sample_count: int, sha256: str) -> bytes:
    """The EpisodeCommit that ends an episode."""
    return serialized(
        EpisodeCommit(
            episode_id=episode.episode_id,
            index=episode.index,
            attempt=attempt,
            sample_count=sample_count,
            sha256=sha256,
        )
    )


def episode_key(start: Any) -> EpisodeKey:
    """The key in an EpisodeStart message.

    Raises:
        DatasetError: If its split is unknown.
    """
    try:
        return EpisodeKey(seed=start.seed, split=Split(start.split), index=start.index)
    except ValueError as error:
        raise DatasetError(f"an episode's start names the unknown split {start.split!r}") from error


def ending_of(commands: Any) -> Ending:
    """The ending that an ExpertCommands message tells of.

    Raises:
        DatasetError: If outcome or driver is unknown.
    """
    try:
        return Ending(Outcome(commands.outcome), Driver(commands.driver), commands.policy)
    except ValueError as error:
        raise DatasetError(f"the end of an episode cannot be read: {error}") from error


def timestamp(stamp_ns: int) -> Any:
    """A time of a message."""
    return Timestamp(seconds=stamp_ns // NS_PER_S, nanos=stamp_ns % NS_PER_S)


def serialized(message: Any) -> bytes:
    """The bytes of a message, the same for the same content."""
    payload: bytes = message.SerializeToString(deterministic=True)
    return payload
