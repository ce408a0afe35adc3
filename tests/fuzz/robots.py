"""Targets: messages, calibrations and logs of robots."""

from pathlib import Path
from typing import Any

import numpy as np
from rosbags import rosbag2
from rosbags.typesys import Stores, get_typestore

from readygo.apps.drive import ros_codec
from readygo.apps.drive.calibration import camera_from_file, info_of
from readygo.apps.drive.messages import Codec, Encoded, GoalMessage, ImageMessage, OdometryMessage, VelocityMessage
from readygo.apps.drive.plain_codec import PlainCodec
from readygo.apps.drive.ros_codec import RosCodec
from readygo.apps.robot_logs.convert import LogTopics, convert
from readygo.apps.robot_logs.pixels import compressed_depth
from readygo.apps.robot_logs.reader import INFO_TYPE, ODOMETRY_TYPE
from readygo.common.camera import CameraConfig
from readygo.common.robot import RobotConfig
from tests.fuzz import mutate
from tests.fuzz.files import of_file
from tests.fuzz.run import Seed, Target

CAMERA = CameraConfig(height_px=8, width_px=10)
ROBOT = RobotConfig(camera=CAMERA)
TIME_NS = 1_700_000_000_000_000_000
_BGR = np.random.default_rng(0).integers(0, 255, (8, 10, 3), np.uint8)
_DEPTH_M = np.linspace(0.5, 4.0, 80, dtype=np.float32).reshape(8, 10)


def _depth() -> Encoded:
    file, how = compressed_depth(_DEPTH_M)
    return Encoded(np.frombuffer(file, np.uint8), how)


def _said(codec: Codec, kinds: tuple[str, ...]) -> list[Seed]:
    depth = _DEPTH_M if isinstance(codec, PlainCodec) else _depth()
    values: list[tuple[str, Any]] = [
        (ODOMETRY_TYPE, OdometryMessage(stamp_ns=TIME_NS, x_m=1.0, y_m=2.0, yaw_rad=0.5, v_mps=0.4, w_radps=0.1)),
        (ros_codec.TWIST_TYPE, VelocityMessage(v_mps=0.5, w_radps=0.1)),
        (ros_codec.STAMPED_TWIST_TYPE, VelocityMessage(v_mps=0.5, w_radps=0.1)),
        (ros_codec.GOAL_TYPE, GoalMessage(x_m=3.0, y_m=1.5)),
        (ros_codec.OUTCOME_TYPE, "success"),
        (INFO_TYPE, info_of(CAMERA)),
        (ros_codec.IMAGE_TYPE, _BGR),
        (ros_codec.IMAGE_TYPE, _DEPTH_M),
        (ros_codec.COMPRESSED_TYPE, _BGR),
        (ros_codec.COMPRESSED_TYPE, depth),
    ]
    return [Seed(codec.write(kind, value, TIME_NS), kind) for kind, value in values if kind in kinds]


def _heard(codec: Codec) -> Any:
    def read(data: bytes, kind: str, folder: Path) -> None:
        value = codec.read(kind, data)
        if isinstance(value, ImageMessage):
            value.decode()

    return read


_NUMBERS = (
    ODOMETRY_TYPE,
    ros_codec.TWIST_TYPE,
    ros_codec.STAMPED_TWIST_TYPE,
    ros_codec.GOAL_TYPE,
    ros_codec.OUTCOME_TYPE,
    INFO_TYPE,
)
_IMAGES = (ros_codec.IMAGE_TYPE, ros_codec.COMPRESSED_TYPE)


def _log(path: Path, *, packed: bool) -> Path:
    """A drive of 3 s, with odometry at 10 Hz and images at 4 Hz."""
    store, codec = get_typestore(Stores.ROS2_HUMBLE), RosCodec()
    writer = rosbag2.Writer(path, version=9, storage_plugin=rosbag2.StoragePlugin.MCAP)
    if packed:
        writer.set_compression(rosbag2.CompressionMode.STORAGE, rosbag2.CompressionFormat.ZSTD)
    with writer:
        places = writer.add_connection("/odom", ODOMETRY_TYPE, typestore=store)
        pictures = writer.add_connection("/camera/image_raw", ros_codec.COMPRESSED_TYPE, typestore=store)
        for k in range(31):
            time_ns = TIME_NS + k * 100_000_000
            odometry = OdometryMessage(stamp_ns=time_ns, x_m=0.05 * k, y_m=0.0, yaw_rad=0.0, v_mps=0.5, w_radps=0.0)
            writer.write(places, time_ns, codec.write(ODOMETRY_TYPE, odometry, time_ns))
            if k % 3 == 0:
                writer.write(pictures, time_ns, codec.write(ros_codec.COMPRESSED_TYPE, _BGR, time_ns))
    return next(path.glob("*.mcap"))


def _logs(folder: Path) -> list[Path]:
    paths = []
    for packed in (False, True):
        path = folder / f"{packed}.mcap"
        path.write_bytes(_log(folder / f"log-{packed}", packed=packed).read_bytes())
        paths.append(path)
    return paths


def _import(path: Path) -> None:
    out = path.parent / "out"
    for each in out.glob("*") if out.exists() else ():
        each.unlink()
    convert(path, out, LogTopics(image="/camera/image_raw", odometry="/odom"), ROBOT)


def _calibrations(folder: Path) -> list[Path]:
    (folder / "c.yaml").write_text(
        "image_width: 10\nimage_height: 8\ncamera_name: a\n"
        "camera_matrix:\n  rows: 3\n  cols: 3\n  data: [8.0, 0.0, 5.0, 0.0, 8.0, 4.0, 0.0, 0.0, 1.0]\n"
        "distortion_model: plumb_bob\n"
        "distortion_coefficients:\n  rows: 1\n  cols: 5\n  data: [0.1, 0.0, 0.0, 0.0, 0.0]\n"
    )
    return [folder / "c.yaml"]


PLAIN, ROS = PlainCodec(), RosCodec()
TARGETS = [
    Target(
        name="plain messages of robots",
        seeds=lambda folder: _said(PLAIN, _NUMBERS),
        read=_heard(PLAIN),
        mutate=mutate.message_pack,
        refusals=(ValueError,),
    ),
    Target(
        name="plain images of robots",
        seeds=lambda folder: _said(PLAIN, _IMAGES),
        read=_heard(PLAIN),
        mutate=mutate.message_pack,
        refusals=(ValueError,),
    ),
    Target(
        name="ROS messages",
        seeds=lambda folder: _said(ROS, _NUMBERS),
        read=_heard(ROS),
        mutate=mutate.binary,
        refusals=(ValueError,),
    ),
    Target(
        name="ROS images",
        seeds=lambda folder: _said(ROS, _IMAGES),
        read=_heard(ROS),
        mutate=mutate.binary,
        refusals=(ValueError,),
    ),
    of_file("robot log", _logs, _import, mutate.mcap),
    of_file("calibration .yaml", _calibrations, lambda path: camera_from_file(CAMERA, path), mutate.text),
]
