"""The channels of a shard: topics, schemas, and the messages of a sample.

Channel numbers are part of the bytes that an episode's SHA-256 covers: no channel ever gets another one. Those of
`CHANNELS` are in every shard, those of `OUTPUT_CHANNELS` in the shards whose samples have these outputs.
"""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.Pose_pb2 import Pose
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
from foxglove_schemas_protobuf.PosesInFrame_pb2 import PosesInFrame
from foxglove_schemas_protobuf.Quaternion_pb2 import Quaternion
from foxglove_schemas_protobuf.Vector3_pb2 import Vector3
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from google.protobuf.timestamp_pb2 import Timestamp

from common.errors import DatasetError
from common.messages.episode import EpisodeKey, Split
from common.messages.proto.readygo_pb2 import Action, EpisodeCommit, EpisodeStart, Goal, StepTruth
from common.messages.samples import EpisodeHeader, Sample
from common.rasterizer.image_files import FILE_FORMAT

NS_PER_S = 1_000_000_000
WORLD_FRAME = "world"
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
"""Every sample has one message on each of these, in this order."""
OUTPUT_CHANNELS: Mapping[str, Channel] = {
    "depth": Channel(10, "/camera/depth", CompressedImage),
    "median_depth": Channel(11, "/camera/median_depth", CompressedImage),
    "alpha": Channel(12, "/camera/alpha", CompressedImage),
    "mask": Channel(13, "/camera/mask", CompressedImage),
    "normal": Channel(14, "/camera/normal", CompressedImage),
}
"""Channels of the images besides rgb, in the order of their messages, which follow those of `SAMPLE_CHANNELS`."""
SCHEMA_NUMBERS: Mapping[Any, int] = {channel.message: channel.number for channel in CHANNELS}
"""Number of the schema of each message class."""


def channels_with(outputs: Iterable[str]) -> tuple[Channel, ...]:
    """All channels of a shard whose samples have `outputs`."""
    return (*CHANNELS, *output_channels(outputs).values())


def output_channels(outputs: Iterable[str]) -> dict[str, Channel]:
    """The channels of some outputs, in their order in a shard.

    Raises:
        DatasetError: If there is no channel for an output.
    """
    names = set(outputs)
    unknown = sorted(names - set(OUTPUT_CHANNELS))
    if unknown:
        raise DatasetError(f"There is no channel for {unknown[0]!r} images; known are {', '.join(OUTPUT_CHANNELS)}.")
    return {name: channel for name, channel in OUTPUT_CHANNELS.items() if name in names}


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
    return _serialized(
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
    return _serialized(
        CameraCalibration(
            timestamp=_timestamp(stamp_ns),
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


def sample_messages(sample: Sample, image_format: str, stamp_ns: int) -> Iterable[tuple[Channel, bytes]]:
    """The messages of one sample, in the order of `SAMPLE_CHANNELS` and `OUTPUT_CHANNELS`."""
    stamp = _timestamp(stamp_ns)
    image = CompressedImage(timestamp=stamp, frame_id=CAMERA_FRAME, data=sample.image, format=image_format)
    humans = PosesInFrame(timestamp=stamp, frame_id=WORLD_FRAME, poses=[_pose(*row) for row in sample.humans_xyzyaw])
    truth = StepTruth(
        human_distance_m=sample.human_distance_m,
        time_to_collision_s=sample.time_to_collision_s,
        human_visible=sample.human_visible,
        expert_cost=sample.expert_cost,
        replanned=sample.replanned,
    )
    messages = (
        image,
        PoseInFrame(timestamp=stamp, frame_id=WORLD_FRAME, pose=_pose(*sample.robot_xyzyaw)),
        humans,
        Action(v_mps=sample.action_v_mps, w_radps=sample.action_w_radps),
        Goal(x_m=sample.goal_xy_robot_m[0], y_m=sample.goal_xy_robot_m[1]),
        truth,
    )
    channels = output_channels(sample.outputs)
    outputs = (
        CompressedImage(timestamp=stamp, frame_id=CAMERA_FRAME, data=sample.outputs[name], format=FILE_FORMAT)
        for name in channels
    )
    return zip((*SAMPLE_CHANNELS, *channels.values()), map(_serialized, (*messages, *outputs)), strict=True)


def commit_message(episode: EpisodeKey, attempt: int, sample_count: int, sha256: str) -> bytes:
    """The EpisodeCommit that ends an episode."""
    return _serialized(
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


def pose_xyzyaw(pose: Any) -> tuple[float, float, float, float]:
    """x, y, z [m] and yaw [rad] in [-pi, pi] of a foxglove.Pose that turns about z only."""
    position, q = pose.position, pose.orientation
    return position.x, position.y, position.z, math.remainder(2.0 * math.atan2(q.z, q.w), math.tau)


def _pose(x_m: float, y_m: float, z_m: float, yaw_rad: float) -> Any:
    orientation = Quaternion(x=0.0, y=0.0, z=math.sin(0.5 * yaw_rad), w=math.cos(0.5 * yaw_rad))
    return Pose(position=Vector3(x=x_m, y=y_m, z=z_m), orientation=orientation)


def _timestamp(stamp_ns: int) -> Any:
    return Timestamp(seconds=stamp_ns // NS_PER_S, nanos=stamp_ns % NS_PER_S)


def _serialized(message: Any) -> bytes:
    payload: bytes = message.SerializeToString(deterministic=True)
    return payload
