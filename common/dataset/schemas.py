"""The channels of a shard: topics, schemas, and the messages that an episode has once.

Channel numbers are part of the bytes that an episode's SHA-256 covers: no channel ever gets another one. Those of
`CHANNELS` are in every shard, those of `OPTIONAL_CHANNELS` in the shards whose samples have these outputs:
further images, the labels of people, the expert's commands, images of the goals, and what a robot of ranges drew. Those
of `CameraChannels` are in the shards of robots with several cameras. Those of `VIEW_CHANNELS` are for viewers, which
need frames, the map and markers to show an episode in 3-D; no sample is read from them and no hash covers them.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
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
from readygo.common.images.images import OUTPUTS
from readygo.common.images.names import GOAL_IMAGE, RGB, camera_of, cameras_of, image_name
from readygo.common.messages.episode import EpisodeKey, Split
from readygo.common.messages.plan import DriverKind, Outcome
from readygo.common.messages.proto.driving_pb2 import ExpertCommands
from readygo.common.messages.proto.readygo_pb2 import Action, EpisodeCommit, EpisodeStart, Goal, StepTruth
from readygo.common.messages.proto.robot_pb2 import DrawnRobot
from readygo.common.messages.samples import EpisodeHeader, FurtherCamera
from readygo.common.robot.config import CAMERAS_MAX

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
GOAL_IMAGE_CHANNELS: Mapping[str, Channel] = {GOAL_IMAGE: Channel(27, "/episode/goal_image", CompressedImage)}
"""Channel of what the first camera shows at the goal: one message, at an episode's first sample."""
DRAWN = "drawn"
DRAWN_CHANNELS: Mapping[str, Channel] = {DRAWN: Channel(28, "/robot/drawn", DrawnRobot)}
"""Channel of what the robot drew from its ranges: one message, at an episode's first sample."""
OPTIONAL_CHANNELS: Mapping[str, Channel] = {
    **OUTPUT_CHANNELS,
    **LABEL_CHANNELS,
    **EXPERT_CHANNELS,
    **GOAL_IMAGE_CHANNELS,
    **DRAWN_CHANNELS,
}
"""All optional channels in the order of their messages, which follow those of `SAMPLE_CHANNELS`."""
ROS_CALIBRATION = Channel(19, "/camera/calibration", CameraCalibration)
"""The calibration as ROS and OpenCV have it, pixel centres at integers; in `CALIBRATION` they are at +0.5."""
TRANSFORMS = Channel(20, "/tf", FrameTransforms)
MARKERS = Channel(21, "/episode/markers", SceneUpdate)
PATH = Channel(22, "/episode/path", PointCloud)
ROBOT_OUTLINE = Channel(23, "/robot/outline", PointCloud)
BODIES = Channel(24, "/humans/bodies", SceneUpdate)
MAP = Channel(25, "/map", Grid)
MAP_POINTS = Channel(26, "/map/points", PointCloud)
PERCEPTION = Channel(29, "/perception", SceneUpdate)
"""What a driver perceives, live only: it is in no shard."""
VIEW_CHANNELS = (TRANSFORMS, MARKERS, PATH, ROBOT_OUTLINE, BODIES, MAP, MAP_POINTS)
"""What viewers need besides samples; point clouds repeat what Rerun does not show of a scene or a grid."""


class CameraChannels:
    """The channels of a camera besides the first one; they follow all others among a sample's messages."""

    def __init__(self, place: int, name: str) -> None:
        """Name them.

        Args:
            place: The camera's place among the further ones, from 0.
            name: Its name.
        """
        first = 64 + 16 * place
        self.name = name
        self.calibration = Channel(first, f"/camera/{name}/calibration", CameraCalibration)
        """Calibration as ROS and OpenCV have it, pixel centres at integers, in every form of an episode."""
        self.images: Mapping[str, Channel] = {
            image_name(name, kind): Channel(
                first + 1 + number, f"/camera/{name}/{'image' if kind == RGB else kind}", CompressedImage
            )
            for number, kind in enumerate(OUTPUTS)
        }
        """Channels of the camera's images, by the names of the images."""

    @property
    def frame(self) -> str:
        """Name of the camera's coordinate frame."""
        return camera_frame(self.name)


def camera_frame(camera: str) -> str:
    """The frame of a camera; the first one is called ""."""
    return f"{CAMERA_FRAME}_{camera}" if camera else CAMERA_FRAME


def camera_of_frame(frame: str) -> str:
    """The camera of a frame, see `camera_frame`."""
    return frame.removeprefix(CAMERA_FRAME).removeprefix("_")


def camera_channels(names: Iterable[str]) -> list[CameraChannels]:
    """The channels of cameras besides the first one, by their names in their order."""
    return [CameraChannels(place, name) for place, name in enumerate(names)]


NAMELESS_CAMERAS = tuple(camera_channels(str(place) for place in range(CAMERAS_MAX)))
"""All that there can be, for what goes by the numbers of channels alone."""
IMAGE_NUMBERS = frozenset(
    channel.number
    for channels in (
        (IMAGE,),
        OUTPUT_CHANNELS.values(),
        GOAL_IMAGE_CHANNELS.values(),
        *(camera.images.values() for camera in NAMELESS_CAMERAS),
    )
    for channel in channels
)
"""Numbers of the channels that carry encoded images."""
_WITH_IMAGES = IMAGE_NUMBERS | {channel.number for channel in EXPERT_CHANNELS.values()}


def optional_channels(cameras: Iterable[str]) -> dict[str, Channel]:
    """All channels that there may be besides `CHANNELS`, by output, on a robot with some further cameras."""
    found = dict(OPTIONAL_CHANNELS)
    for camera in camera_channels(cameras):
        found |= camera.images
    return found


def output_of(number: int, topic: str) -> str | None:
    """The output that a channel of a shard has; None if it has none."""
    name = topic.removeprefix("/camera/").partition("/")[0]
    for camera in camera_channels([name] * CAMERAS_MAX):
        for output, channel in camera.images.items():
            if (channel.number, channel.topic) == (number, topic):
                return output
    return next((name for name, channel in OPTIONAL_CHANNELS.items() if channel.number == number), None)


def is_image(output: str) -> bool:
    """True if an output is an image of each sample, not labels, commands or an image of the goal."""
    return output in OUTPUT_CHANNELS or bool(camera_of(output))


def samples_with(channel: Channel, sample_count: int, image_every: int) -> range:
    """The samples of an episode that have a message on a channel of samples: all, or those at which images were taken.

    An image of the goal, and what a robot drew, are at the first one alone.

    Args:
        channel: One of `SAMPLE_CHANNELS` or of `optional_channels`.
        sample_count: Samples of the episode.
        image_every: Samples from image to image, as `EpisodeHeader.image_every`.
    """
    if channel in (*GOAL_IMAGE_CHANNELS.values(), *DRAWN_CHANNELS.values()):
        return range(min(sample_count, 1))
    return range(0, sample_count, image_every if channel.number in _WITH_IMAGES else 1)


def image_every(commands: Any, numbers: Sequence[int], sample_count: int) -> int:
    """`EpisodeHeader.image_every` of an episode.

    Args:
        commands: One of its ExpertCommands messages, which say it; None where there are none.
        numbers: Numbers of its samples with images.
        sample_count: Number of its samples.
    """
    if commands is not None:
        return int(commands.image_every) or 1
    return math.gcd(*numbers) or max(sample_count, 1)


class Ending(NamedTuple):
    """How an episode ended, and who drove it."""

    outcome: Outcome = Outcome.SUCCESS
    driver: DriverKind = DriverKind.EXPERT
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
    outputs = tuple(outputs)
    calibrations = (camera.calibration for camera in camera_channels(further_cameras(outputs)))
    return (*CHANNELS, *output_channels(outputs).values(), *calibrations)


def staged_channels(outputs: Iterable[str]) -> tuple[Channel, ...]:
    """All channels of a shard whose samples have `outputs` and whose episodes are staged for viewers."""
    content = (channel for channel in channels_with(outputs) if channel is not CALIBRATION)
    return (*content, ROS_CALIBRATION, *VIEW_CHANNELS)


def further_cameras(outputs: Iterable[str]) -> tuple[str, ...]:
    """The cameras besides the first one whose images are among some outputs, in the order of these."""
    return tuple(camera for camera in cameras_of(outputs) if camera)


def output_channels(outputs: Iterable[str], known: Mapping[str, Channel] | None = None) -> dict[str, Channel]:
    """The channels of some of the `known` outputs, in their order in a shard.

    Args:
        outputs: Their names, those of cameras in the order of these.
        known: By default all that there are on a robot with the cameras of `outputs`.

    Raises:
        DatasetError: If there is no channel for an output.
    """
    outputs = tuple(outputs)
    known = optional_channels(further_cameras(outputs)) if known is None else known
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
    return serialize(
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


def calibration_message(
    camera: EpisodeHeader | FurtherCamera, stamp_ns: int | None, frame: str = CAMERA_FRAME
) -> bytes:
    """The CameraCalibration of an episode.

    Args:
        camera: What is constant of it; a header tells of the first one.
        stamp_ns: Time of the message [ns]; None leaves it out.
        frame: The camera's frame.
    """
    k = list(camera.K_px)
    return serialize(
        CameraCalibration(
            timestamp=None if stamp_ns is None else timestamp(stamp_ns),
            frame_id=frame,
            width=camera.width_px,
            height=camera.height_px,
            distortion_model=camera.distortion_model,
            D=camera.distortion,
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
    return serialize(
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
        return Ending(Outcome(commands.outcome), DriverKind(commands.driver), commands.policy)
    except ValueError as error:
        raise DatasetError(f"the end of an episode cannot be read: {error}") from error


def drawn_of(robot: Any) -> dict[str, float]:
    """`EpisodeHeader.drawn` of a DrawnRobot message."""
    return {field.name: value for field, value in robot.ListFields()}


def timestamp(stamp_ns: int) -> Any:
    """A time of a message."""
    return Timestamp(seconds=stamp_ns // NS_PER_S, nanos=stamp_ns % NS_PER_S)


def serialize(message: Any) -> bytes:
    """The bytes of a message, the same for the same content."""
    payload: bytes = message.SerializeToString(deterministic=True)
    return payload
