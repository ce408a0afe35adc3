"""Conversion of a log to a data folder: one shard of episodes without human labels, with any driver."""

import dataclasses
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from readygo.apps.robot_logs.drives import GAP_NS, UnicycleDrive, drive_of, spans
from readygo.apps.robot_logs.reader import LogCamera, RobotLog, open_log
from readygo.common.config import section_to_mapping
from readygo.common.dataset import Provenance, SceneOrigin, ShardWriter, encode_episode, shard_name
from readygo.common.dataset.stage import Scenery
from readygo.common.errors import ConfigError, DatasetError
from readygo.common.files import unfinished_folder
from readygo.common.frames import goal_in_robot_frame
from readygo.common.images.encoded import decode_image
from readygo.common.messages import EpisodeHeader, EpisodeKey, Sample, Split, sample_crc32
from readygo.common.robot import CameraConfig, RobotConfig

DRIFT_MAX_M = 0.3
"""Largest distance of a drive from its odometry [m]; a larger one means a different robot."""
_LENSES = {
    "plumb_bob": ("brown_conrady", ("k1", "k2", "p1", "p2", "k3")),
    "rational_polynomial": ("brown_conrady", ("k1", "k2", "p1", "p2", "k3")),
    "equidistant": ("fisheye", ("k1", "k2", "k3", "k4")),
    "fisheye": ("fisheye", ("k1", "k2", "k3", "k4")),
}
"""For each lens model of ROS: our model, and the names of the coefficients in ROS's order; others must be 0."""
Progress = Callable[[int, int], None]


@dataclass(frozen=True, kw_only=True)
class LogTopics:
    """Topics of the log; an empty `camera_info` uses the robot's camera."""

    image: str
    odometry: str
    camera_info: str = ""


@dataclass(frozen=True, kw_only=True)
class Converted:
    """Result of a conversion."""

    episodes: int
    samples: int
    drift_m: float
    """Largest distance of a recorded pose from the odometry [m]."""


def convert(
    path: Path,
    out: Path,
    topics: LogTopics,
    robot: RobotConfig,
    *,
    episode_s: float = 30.0,
    license: str = "",
    progress: Progress = lambda done, total: None,
) -> Converted:
    """Write a data folder of a log.

    Args:
        path: Rosbag2 folder or MCAP file.
        out: Folder to make; it appears when it is complete.
        topics: Topics to read.
        robot: Limits and camera of the robot.
        episode_s: Longest episode [s].
        license: License of the log, recorded with the data.
        progress: Called with the numbers of finished and of all episodes.

    Raises:
        ConfigError: If a topic is missing, or rosbags is not installed.
        DatasetError: If the log has no usable data, or `robot` does not match it.
    """
    if episode_s < 2.0:
        raise ConfigError(f"--episode-s must be at least 2, got {episode_s:g}.")
    with open_log(path) as log, unfinished_folder(out, raises=DatasetError) as folder:
        if topics.camera_info:
            seen = log.camera(topics.camera_info).of_images(topics.image)
            robot = dataclasses.replace(robot, camera=camera_of(robot.camera, seen))
        odometry = log.odometry(topics.odometry)
        found = spans(odometry, log.image_times_ns(topics.image), episode_s)
        if not found:
            raise DatasetError(f"{path} holds no drive of 2 s and 1 m with images and odometry less than 0.5 s apart.")
        drives = [drive_of(odometry, span, robot) for span in found]
        drift_m = max(drive.drift_m for drive in drives)
        if drift_m > DRIFT_MAX_M:
            raise DatasetError(
                f"The robot leaves its odometry by {drift_m:.2f} m: it drives faster, reverses or slips; pass --robot "
                "with its limits (v_max_mps, w_max_radps, a_max_mps2, alpha_max_radps2)."
            )
        _write(folder, log, topics.image, drives, robot, _provenance(path, robot, license), progress)
    return Converted(episodes=len(drives), samples=sum(len(drive.xyyaw) for drive in drives), drift_m=drift_m)


def camera_of(camera: CameraConfig, seen: LogCamera) -> CameraConfig:
    """A camera's mount with the lens of a CameraInfo.

    Raises:
        ConfigError: If the lens model is unknown.
    """
    names: dict[str, float] = {}
    distortion = "none"
    if any(seen.distortion):
        if seen.model not in _LENSES:
            raise ConfigError(
                f"The lens model {seen.model!r} is not known; name a topic of rectified images (image_rect), or use "
                f"{list(_LENSES)}."
            )
        distortion, order = _LENSES[seen.model]
        if any(seen.distortion[len(order) :]):
            raise ConfigError(
                f"The lens model {seen.model!r} is known with {len(order)} coefficients, and further ones of the log's "
                "are not 0; name a topic of rectified images (image_rect), or calibrate with plumb_bob or equidistant."
            )
        names = dict(zip(order, seen.distortion, strict=False))
    fx, _, cx, _, fy, cy, *_ = seen.K_px
    plain = {f"k{n}": 0.0 for n in range(1, 5)} | {"p1": 0.0, "p2": 0.0}
    intrinsics = {"fx_px": fx, "fy_px": fy, "cx_px": cx + 0.5, "cy_px": cy + 0.5, "horizontal_fov_deg": None}
    size = {"height_px": seen.height_px, "width_px": seen.width_px}
    changes: dict[str, Any] = {**plain, **names, **intrinsics, **size, "distortion": distortion}
    try:
        return dataclasses.replace(camera, **changes)
    except ValueError as error:
        raise ConfigError(f"The log's CameraInfo cannot be used: {error}") from error


def _provenance(path: Path, robot: RobotConfig, license: str) -> Provenance:
    import readygo

    return Provenance(
        readygo_version=readygo.__version__,
        scene=SceneOrigin(name=path.stem, license=license),
        seed=0,
        config={"robot": section_to_mapping(robot)},
    )


def _write(
    folder: Path,
    log: RobotLog,
    topic: str,
    drives: list[UnicycleDrive],
    robot: RobotConfig,
    provenance: Provenance,
    progress: Progress,
) -> None:
    with ShardWriter(folder / shard_name("log", 0), provenance, stage=Scenery(robot=robot, maps=None)) as writer:
        for index, drive in enumerate(drives):
            images = list(_images_at(log, topic, drive))
            header = _header(index, drive, robot.camera, images[0])
            every = drive.clock.image_every
            samples = [_sample(drive, header, seq, b"" if seq % every else image) for seq, image in enumerate(images)]
            writer.append(encode_episode(header, 1, samples))
            progress(index + 1, len(drives))


def _images_at(log: RobotLog, topic: str, drive: UnicycleDrive) -> Iterator[bytes]:
    """The newest image at each sample."""
    images = log.images(topic, drive.start_ns - GAP_NS, int(drive.times_ns[-1]))
    newest, following = b"", next(images, None)
    for time_ns in drive.times_ns.tolist():
        while following is not None and following[0] <= time_ns:
            newest, following = following[1], next(images, None)
        yield newest


def _header(index: int, drive: UnicycleDrive, camera: CameraConfig, image: bytes) -> EpisodeHeader:
    """The header of an episode; its goal is its last position."""
    picture = decode_image(image)
    if picture is None or picture.shape[:2] != (camera.height_px, camera.width_px):
        seen = "cannot be decoded" if picture is None else f"are {picture.shape[0]}x{picture.shape[1]}"
        raise DatasetError(
            f"The log's images {seen}, the camera has {camera.height_px}x{camera.width_px}; pass --camera-info TOPIC, "
            "or --robot with the log's camera."
        )
    (x, y, yaw), (goal_x, goal_y, _) = drive.xyyaw[0].tolist(), drive.xyyaw[-1].tolist()
    return EpisodeHeader(
        episode=EpisodeKey(seed=0, split=Split.TRAIN, index=index),
        sample_count=len(drive.xyyaw),
        goal_xy_m=(goal_x, goal_y),
        start_xyyaw=(x, y, yaw),
        avatars=(),
        encounters=(),
        image_every=drive.clock.image_every,
        image_format="jpeg" if image.startswith(b"\xff\xd8") else "png",
        height_px=camera.height_px,
        width_px=camera.width_px,
        K_px=tuple(camera.K_px.reshape(-1).tolist()),
        distortion_model=camera.distortion_model,
        distortion=camera.coefficients,
    )


def _sample(drive: UnicycleDrive, header: EpisodeHeader, seq: int, image: bytes) -> Sample:
    x, y, yaw = drive.xyyaw[seq].tolist()
    v, w = drive.actions[seq].tolist()
    return Sample(
        seq=seq,
        crc32=sample_crc32(image, {}),
        time_ns=drive.clock.time_ns(seq),
        image=image,
        action_v_mps=v,
        action_w_radps=w,
        goal_xy_robot_m=goal_in_robot_frame(x, y, yaw, header.goal_xy_m),
        robot_xyzyaw=(x, y, 0.0, yaw),
        humans_xyzyaw=(),
        human_distance_m=math.inf,
        time_to_collision_s=math.inf,
        human_visible=False,
        expert_cost=0.0,
        replanned=False,
    )
