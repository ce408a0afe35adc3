"""Small, physically consistent episodes, and datasets made of them."""

import dataclasses
import functools
import math
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from readygo.common.config import section_to_mapping
from readygo.common.dataset import Provenance, SceneOrigin, ShardWriter, encode_episode, shard_name
from readygo.common.dataset.provenance import AvatarOrigin
from readygo.common.dataset.schemas import LABEL_CHANNELS
from readygo.common.dataset.stage import Scenery
from readygo.common.images.files import encode_output
from readygo.common.images.images import Images
from readygo.common.messages import AppendRequest, EpisodeHeader, EpisodeKey, FurtherCamera, Sample, Split, sample_crc32
from readygo.common.messages.samples import HumanLabels
from readygo.common.robot import CameraConfig, RobotConfig, limit_command, step_unicycle
from readygo.common.robot.kinematics import STEP_NS

ROBOT = RobotConfig(camera=CameraConfig(height_px=24, width_px=32))
PROVENANCE = Provenance(
    readygo_version="0.1.0",
    commit="0" * 40,
    numeric_class="cpu x86_64",
    scene=SceneOrigin(name="plaza", hash="ab" * 32, license="CC0"),
    avatars={"ann": AvatarOrigin(hash="cd" * 32, license="CC0")},
    seed=7,
    config={"robot": section_to_mapping(ROBOT), "episode": {"time_limit_s": 50.0}},
)
GOAL_XY_M = (4.0, 1.0)


def provenance_with_robot(**changes: Any) -> Provenance:
    """The provenance of a run with another robot."""
    robot = dataclasses.replace(ROBOT, **changes)
    return dataclasses.replace(PROVENANCE, config={"robot": section_to_mapping(robot)})


@functools.cache
def jpeg(number: int, height_px: int = 24, width_px: int = 32) -> bytes:
    pixels = np.random.default_rng(number).integers(0, 255, (height_px, width_px, 3), dtype=np.uint8)
    return cv2.imencode(".jpg", pixels, [cv2.IMWRITE_JPEG_QUALITY, 90])[1].tobytes()


@functools.cache
def make_images(number: int, height_px: int = 24, width_px: int = 32) -> Images:
    """Images of all kinds, with places where there is nothing; the mask knows one human."""
    rng = np.random.default_rng(number)
    shape = (height_px, width_px)
    nothing = rng.random(shape) < 0.2
    normal = rng.normal(size=(*shape, 3))
    normal /= np.linalg.norm(normal, axis=2, keepdims=True)
    normal[nothing] = 0.0
    depth_m = np.where(nothing, np.inf, rng.uniform(0.05, 60.0, shape)).astype(np.float32)
    return Images(
        rgb=rng.integers(0, 255, (*shape, 3), dtype=np.uint8),
        depth_m=depth_m,
        median_depth_m=depth_m * np.float32(0.9),
        alpha=np.where(nothing, 0.0, rng.random(shape)).astype(np.float32),
        mask=rng.integers(0, 2, shape, dtype=np.uint8),
        normal=normal.astype(np.float32),
    )


LEFT = CameraConfig(height_px=16, width_px=20, mount_yaw_deg=90.0)
"""A camera that looks to the left."""


def with_left_camera(header: EpisodeHeader, samples: Sequence[Sample]) -> tuple[EpisodeHeader, tuple[Sample, ...]]:
    """An episode with images of `LEFT`, colours and depths, beside those of the first camera."""
    size = LEFT.height_px, LEFT.width_px
    camera = FurtherCamera(name="left", height_px=size[0], width_px=size[1], K_px=tuple(LEFT.K_px.ravel().tolist()))
    seen = []
    for sample in samples:
        number = image_number(header.episode.index, sample.seq)
        images = {"left.rgb": jpeg(number, *size), "left.depth": encode_output(make_images(number, *size), "depth")}
        outputs = {**sample.outputs, **images}
        seen.append(dataclasses.replace(sample, outputs=outputs, crc32=sample_crc32(sample.image, outputs)))
    return dataclasses.replace(header, cameras=(camera,)), tuple(seen)


def with_goal_image(header: EpisodeHeader, samples: Sequence[Sample]) -> tuple[EpisodeHeader, tuple[Sample, ...]]:
    """An episode with an image of its goal."""
    outputs = {**samples[0].outputs, "goal_image": jpeg(5)}
    first = dataclasses.replace(samples[0], outputs=outputs, crc32=sample_crc32(samples[0].image, outputs))
    return header, (first, *samples[1:])


def image_number(index: int, seq: int) -> int:
    """Number of the images of a sample."""
    return 1000 * index + seq


def make_header(index: int, sample_count: int, **changes: Any) -> EpisodeHeader:
    header = EpisodeHeader(
        episode=EpisodeKey(seed=7, split=Split.TRAIN, index=index),
        sample_count=sample_count,
        goal_xy_m=GOAL_XY_M,
        start_xyyaw=(0.0, 0.5 * index, 0.1),
        avatars=("ann",),
        encounters=("crossing",),
        image_format="jpeg",
        height_px=ROBOT.camera.height_px,
        width_px=ROBOT.camera.width_px,
        K_px=tuple(ROBOT.camera.K_px.ravel().tolist()),
    )
    return dataclasses.replace(header, **changes)


def make_labels(seq: int) -> HumanLabels:
    """Labels of the human of `make_samples`, who stands upright with the left arm out."""
    joints = np.zeros((24, 3), dtype=np.float32)
    joints[:, 2] = np.linspace(0.95, 0.05, 24)
    joints[20, 0] = -0.4
    joints += np.float32([2.0, 0.05 * seq, 0.0])
    ground = np.float32([[-0.4, 0.0], [0.0, 0.0], [0.05, 0.1]]) + np.float32([2.0, 0.05 * seq])
    box = np.array([1.9, 0.05 * seq, 0.9, 0.4, 0.7, 1.8, math.pi / 2])
    return HumanLabels(joints_m=joints, box=box, footprint_xy_m=ground)


def make_samples(header: EpisodeHeader, names: Sequence[str] = ()) -> tuple[Sample, ...]:
    x_m, y_m, yaw_rad = header.start_xyyaw
    v_mps = w_radps = 0.0
    samples = []
    for seq in range(header.sample_count):
        v_mps, w_radps = limit_command(0.8, math.sin(0.3 * seq), v_mps, w_radps, ROBOT, 0.05)
        dx, dy = header.goal_xy_m[0] - x_m, header.goal_xy_m[1] - y_m
        c, s = math.cos(yaw_rad), math.sin(yaw_rad)
        number = image_number(header.episode.index, seq)
        image = jpeg(number, header.height_px, header.width_px)
        images = make_images(number, header.height_px, header.width_px) if names else None
        outputs = {name: encode_output(images, name) for name in names}
        sample = Sample(
            seq=seq,
            crc32=sample_crc32(image, outputs),
            time_ns=seq * STEP_NS,
            image=image,
            action_v_mps=v_mps,
            action_w_radps=w_radps,
            goal_xy_robot_m=(c * dx + s * dy, c * dy - s * dx),
            robot_xyzyaw=(x_m, y_m, 0.02, yaw_rad),
            humans_xyzyaw=((2.0, 0.05 * seq, 0.0, math.pi / 2),),
            human_distance_m=math.hypot(2.0 - x_m, 0.05 * seq - y_m),
            time_to_collision_s=math.inf,
            human_visible=seq % 2 == 0,
            expert_cost=1.5,
            replanned=seq == 3,
            outputs=outputs,
            labels=(make_labels(seq),) if header.labels else (),
        )
        samples.append(sample)
        x_m, y_m, yaw_rad = step_unicycle(x_m, y_m, yaw_rad, v_mps, w_radps, 0.05)
    return tuple(samples)


def make_episode(
    index: int, sample_count: int = 12, *, outputs: Sequence[str] = (), **changes: Any
) -> tuple[EpisodeHeader, tuple[Sample, ...]]:
    header = make_header(index, sample_count, **changes)
    return header, make_samples(header, outputs)


def append_requests(
    index: int, sample_count: int = 12, *, attempt: int = 1, batch: int = 8, **changes: Any
) -> list[AppendRequest]:
    header, samples = make_episode(index, sample_count, **changes)
    return [
        AppendRequest(
            attempt=attempt,
            header=header,
            first_seq=first,
            samples=samples[first : first + batch],
            last=first + batch >= sample_count,
        )
        for first in range(0, sample_count, batch)
    ]


def write_shard(
    folder: Path,
    indices: Iterable[int],
    *,
    number: int = 0,
    recorder: str = "r0",
    sample_count: int = 12,
    provenance: Provenance = PROVENANCE,
    outputs: Sequence[str] = (),
    stage: Scenery | None = None,
    **changes: Any,
) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    names = (*outputs, *(LABEL_CHANNELS if changes.get("labels") else ()))
    path = folder / shard_name(recorder, number)
    with ShardWriter(path, provenance, outputs=names, stage=stage, fsync=False) as writer:
        for index in indices:
            header, samples = make_episode(index, sample_count, outputs=outputs, **changes)
            writer.append(encode_episode(header, 1, samples))
    return path


def write_left_shard(folder: Path, indices: Iterable[int], sample_count: int = 12) -> Path:
    """A shard of a robot that has the camera `LEFT` besides, with colours and depths of both."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / shard_name("r0", 0)
    names = ("depth", "left.rgb", "left.depth")
    with ShardWriter(path, provenance_with_robot(cameras={"left": LEFT}), outputs=names, fsync=False) as writer:
        for index in indices:
            header, samples = with_left_camera(*make_episode(index, sample_count, outputs=("depth",)))
            writer.append(encode_episode(header, 1, samples))
    return path


def golden_episode() -> tuple[EpisodeHeader, list[Sample]]:
    """An episode whose bytes depend on no encoder and no mathematical library."""
    header, samples = make_episode(
        5, 4, start_xyyaw=(1.0, 2.0, 0.0), K_px=(16.0, 0.0, 16.0, 0.0, 16.0, 12.0, 0.0, 0.0, 1.0)
    )
    return header, [
        dataclasses.replace(
            sample,
            image=b"\xff\xd8pixels",
            action_v_mps=0.5,
            action_w_radps=-0.25,
            goal_xy_robot_m=(3.0, -1.0),
            robot_xyzyaw=(1.0, 2.0, 0.0, 0.0),
            humans_xyzyaw=((2.0, 0.5, 0.25, 0.0),),
            human_distance_m=1.75,
        )
        for sample in samples
    ]
