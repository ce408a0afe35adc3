from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

WriteLog = Callable[..., Path]


@pytest.fixture
def write_log(tmp_path: Path) -> WriteLog:
    """Writes a rosbag2 folder with odometry at 50 Hz and images at 12 Hz of a robot that drives a circle."""
    rosbag2 = pytest.importorskip("rosbags.rosbag2", reason="rosbags (extra robot-logs) is not installed")
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    types = store.types

    def header(time_ns: int) -> Any:
        stamp = types["builtin_interfaces/msg/Time"](sec=time_ns // 10**9, nanosec=time_ns % 10**9)
        return types["std_msgs/msg/Header"](stamp=stamp, frame_id="x")

    def odometry(time_ns: int, x: float, y: float, yaw: float) -> Any:
        point = types["geometry_msgs/msg/Point"](x=x, y=y, z=0.0)
        turn = types["geometry_msgs/msg/Quaternion"](x=0.0, y=0.0, z=float(np.sin(yaw / 2)), w=float(np.cos(yaw / 2)))
        none = types["geometry_msgs/msg/Vector3"](x=0.0, y=0.0, z=0.0)
        pose = types["geometry_msgs/msg/Pose"](position=point, orientation=turn)
        twist = types["geometry_msgs/msg/Twist"](linear=none, angular=none)
        return types["nav_msgs/msg/Odometry"](
            header=header(time_ns),
            child_frame_id="base_link",
            pose=types["geometry_msgs/msg/PoseWithCovariance"](pose=pose, covariance=np.zeros(36)),
            twist=types["geometry_msgs/msg/TwistWithCovariance"](twist=twist, covariance=np.zeros(36)),
        )

    def image(time_ns: int, number: int, raw: bool) -> Any:
        pixels = np.full((144, 256, 3), number % 256, np.uint8)
        if raw:
            return types["sensor_msgs/msg/Image"](
                header=header(time_ns),
                height=144,
                width=256,
                encoding="rgb8",
                is_bigendian=0,
                step=768,
                data=pixels.reshape(-1),
            )
        data = cv2.imencode(".jpg", pixels)[1].reshape(-1)
        return types["sensor_msgs/msg/CompressedImage"](header=header(time_ns), format="jpeg", data=data)

    def write(
        *,
        seconds: float = 6.0,
        raw: bool = False,
        speed_mps: float = 0.5,
        stop_s: tuple[float, float] = (9, 9),
        topic: str = "/camera/image_raw",
    ) -> Path:
        folder = tmp_path / "log"
        with rosbag2.Writer(folder, version=9, storage_plugin=rosbag2.StoragePlugin.MCAP) as writer:
            kind = "sensor_msgs/msg/Image" if raw else "sensor_msgs/msg/CompressedImage"
            places = writer.add_connection("/odom", "nav_msgs/msg/Odometry", typestore=store)
            pictures = writer.add_connection(topic, kind, typestore=store)
            events = [(t, 0) for t in np.arange(0, seconds, 0.02)] + [(t, 1) for t in np.arange(0, seconds, 1 / 12)]
            for number, (t, what) in enumerate(sorted(events)):
                time_ns = 10**18 + round(t * 1e9)
                driven_s = t - max(0.0, min(t, stop_s[1]) - stop_s[0])
                angle = speed_mps * driven_s / 2.0
                message = (
                    image(time_ns, number, raw)
                    if what
                    else odometry(time_ns, 2 * np.sin(angle), 2 * (1 - np.cos(angle)), angle)
                )
                data = store.serialize_cdr(message, message.__msgtype__)
                writer.write(pictures if what else places, time_ns, data)
        return folder

    return write
