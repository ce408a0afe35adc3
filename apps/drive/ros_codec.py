"""Messages of ROS 2 as CDR, by rosbags (extra `robot-logs`); no ROS is needed."""

import math
from functools import partial
from typing import Any

import cv2
import numpy as np

from readygo.apps.drive.messages import (
    Encoded,
    GoalMessage,
    ImageMessage,
    OdometryMessage,
    PeopleMessage,
    ScanMessage,
    Value,
    VelocityMessage,
    check_numbers,
)
from readygo.apps.robot_logs.pixels import (
    compressed_depth,
    compressed_depth_of,
    is_compressed_depth,
    millimetres,
    pixels_of,
)
from readygo.apps.robot_logs.reader import IMAGE_TYPES, INFO_TYPE, JPEG_QUALITY, ODOMETRY_TYPE, LogCamera, yaw_of
from readygo.common.arrays import AnyArray
from readygo.common.errors import ConfigError
from readygo.common.extras import install_command
from readygo.common.images.encoded import decode_pixels
from readygo.common.messages.live import LivePerson

IMAGE_TYPE, COMPRESSED_TYPE = IMAGE_TYPES
TWIST_TYPE, STAMPED_TWIST_TYPE = "geometry_msgs/msg/Twist", "geometry_msgs/msg/TwistStamped"
GOAL_TYPE, OUTCOME_TYPE = "geometry_msgs/msg/PoseStamped", "std_msgs/msg/String"
PEOPLE_TYPE, SCAN_TYPE = "people_msgs/msg/People", "sensor_msgs/msg/LaserScan"
_SENT = (PEOPLE_TYPE, SCAN_TYPE)
"""Types that are only sent."""
_DEFINITIONS = {
    "people_msgs/msg/Person": """string name
geometry_msgs/Point position
geometry_msgs/Point velocity
float64 reliability
string[] tagnames
string[] tags
""",
    PEOPLE_TYPE: """std_msgs/Header header
people_msgs/Person[] people
""",
}
"""Types that are not among ROS's own. Source: github.com/wg-perception/people, people_msgs/msg."""
PERSON_TAGS = ("position_covariance", "velocity_covariance", "age")
"""Tags of a person: covariances xx, xy, yy in m2 and m2/s2, and time since the latest detection in s."""


class RosCodec:
    """Codec of ROS 2 messages in CDR."""

    def __init__(self) -> None:
        """Load the message types.

        Raises:
            ConfigError: If rosbags is not installed.
        """
        try:
            from rosbags.typesys import Stores, get_types_from_msg, get_typestore
        except ImportError as error:
            raise ConfigError(f"ROS messages need rosbags: {install_command('robot-logs')}") from error
        self._store: Any = get_typestore(Stores.ROS2_HUMBLE)
        for name, text in _DEFINITIONS.items():
            self._store.register(get_types_from_msg(text, name))
        self._types: Any = self._store.types
        self._writers: dict[str, Any] = {
            IMAGE_TYPE: self._image,
            COMPRESSED_TYPE: self._compressed_message,
            ODOMETRY_TYPE: self._odometry,
            INFO_TYPE: self._camera_info,
            TWIST_TYPE: lambda command, _: self._twist(command),
            STAMPED_TWIST_TYPE: self._stamped_twist,
            GOAL_TYPE: self._goal,
            OUTCOME_TYPE: lambda outcome, _: self._types[OUTCOME_TYPE](data=outcome),
            PEOPLE_TYPE: self._people,
            SCAN_TYPE: self._scan,
        }

    def type_hash(self, type_name: str) -> str:
        """The RIHS01 hash of a message type."""
        return str(self._store.hash_rihs01(type_name))

    def definition(self, type_name: str) -> str:
        """The text of a type's .msg file and of those that it refers to."""
        return str(self._store.generate_msgdef(type_name, ros_version=2)[0])

    def read(self, type_name: str, payload: bytes) -> Value:
        """Decode a message; raises ValueError if it is invalid."""
        if type_name not in self._writers or type_name in _SENT:
            raise ValueError(f"messages of type {type_name} are not known")
        try:
            message = self._store.deserialize_cdr(payload, type_name)
        except Exception as error:  # rosbags' generated code raises many types of exceptions
            raise ValueError(f"{len(payload)} bytes are no {type_name}") from error
        return check_numbers(_value(type_name, message))

    def write(self, type_name: str, value: Any, stamp_ns: int) -> bytes:
        """Encode a message; arguments as in `Codec.write`."""
        message = self._writers[type_name](value, stamp_ns)
        return bytes(self._store.serialize_cdr(message, type_name))

    def _header(self, stamp_ns: int, frame: str) -> Any:
        stamp = self._types["builtin_interfaces/msg/Time"](sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9)
        return self._types["std_msgs/msg/Header"](stamp=stamp, frame_id=frame)

    def _image(self, pixels: AnyArray, stamp_ns: int) -> Any:
        encoding = "bgr8" if pixels.ndim == 3 else "16UC1"
        stored = pixels if pixels.ndim == 3 else millimetres(pixels).astype("<u2")
        data = np.frombuffer(stored.tobytes(), np.uint8)
        return self._types[IMAGE_TYPE](
            header=self._header(stamp_ns, "camera"),
            height=pixels.shape[0],
            width=pixels.shape[1],
            encoding=encoding,
            is_bigendian=0,
            step=len(data) // pixels.shape[0],
            data=data,
        )

    def _compressed_message(self, image: AnyArray | Encoded, stamp_ns: int) -> Any:
        data, image_format = image if isinstance(image, Encoded) else _encode_image(image)
        return self._types[COMPRESSED_TYPE](header=self._header(stamp_ns, "camera"), format=image_format, data=data)

    def _pose(self, x_m: float, y_m: float, yaw_rad: float) -> Any:
        point = self._types["geometry_msgs/msg/Point"](x=x_m, y=y_m, z=0.0)
        turn = self._types["geometry_msgs/msg/Quaternion"](
            x=0.0, y=0.0, z=math.sin(yaw_rad / 2), w=math.cos(yaw_rad / 2)
        )
        return self._types["geometry_msgs/msg/Pose"](position=point, orientation=turn)

    def _twist(self, command: VelocityMessage | OdometryMessage) -> Any:
        vector = self._types["geometry_msgs/msg/Vector3"]
        linear, angular = vector(x=command.v_mps, y=0.0, z=0.0), vector(x=0.0, y=0.0, z=command.w_radps)
        return self._types[TWIST_TYPE](linear=linear, angular=angular)

    def _stamped_twist(self, command: VelocityMessage, stamp_ns: int) -> Any:
        return self._types[STAMPED_TWIST_TYPE](header=self._header(stamp_ns, "base_link"), twist=self._twist(command))

    def _odometry(self, odometry: OdometryMessage, stamp_ns: int) -> Any:
        pose = self._pose(odometry.x_m, odometry.y_m, odometry.yaw_rad)
        return self._types[ODOMETRY_TYPE](
            header=self._header(stamp_ns, odometry.frame),
            child_frame_id=odometry.robot_frame,
            pose=self._types["geometry_msgs/msg/PoseWithCovariance"](pose=pose, covariance=np.zeros(36)),
            twist=self._types["geometry_msgs/msg/TwistWithCovariance"](
                twist=self._twist(odometry), covariance=np.zeros(36)
            ),
        )

    def _goal(self, goal: GoalMessage, stamp_ns: int) -> Any:
        pose = self._pose(goal.x_m, goal.y_m, 0.0)
        return self._types[GOAL_TYPE](header=self._header(stamp_ns, goal.frame), pose=pose)

    def _people(self, message: PeopleMessage, stamp_ns: int) -> Any:
        people = [self._person(person) for person in message.people]
        return self._types[PEOPLE_TYPE](header=self._header(stamp_ns, message.frame), people=people)

    def _person(self, person: LivePerson) -> Any:
        point = self._types["geometry_msgs/msg/Point"]
        covariances = (person.place_cov_m2, person.velocity_cov_m2ps2)
        tags = [" ".join(f"{value:.4g}" for value in values) for values in (*covariances, (person.age_s,))]
        return self._types["people_msgs/msg/Person"](
            name=str(person.number),
            position=point(x=person.xy_m[0], y=person.xy_m[1], z=0.0),
            velocity=point(x=person.v_mps[0], y=person.v_mps[1], z=0.0),
            reliability=person.presence,
            tagnames=list(PERSON_TAGS),
            tags=tags,
        )

    def _scan(self, scan: ScanMessage, stamp_ns: int) -> Any:
        last = len(scan.ranges_m) - 1
        return self._types[SCAN_TYPE](
            header=self._header(stamp_ns, scan.frame),
            angle_min=scan.angle_min_rad,
            angle_max=scan.angle_min_rad + last * scan.angle_increment_rad,
            angle_increment=scan.angle_increment_rad,
            time_increment=0.0,
            scan_time=scan.period_s,
            range_min=0.0,
            range_max=scan.range_max_m,
            ranges=np.array(scan.ranges_m, np.float32),
            intensities=np.empty(0, np.float32),
        )

    def _camera_info(self, camera: LogCamera, stamp_ns: int) -> Any:
        K = np.array(camera.K_px, np.float64)
        return self._types[INFO_TYPE](
            header=self._header(stamp_ns, "camera"),
            height=camera.height_px,
            width=camera.width_px,
            distortion_model=camera.model,
            d=np.array(camera.distortion, np.float64),
            k=K,
            r=np.eye(3).reshape(-1),
            p=np.concatenate([K.reshape(3, 3), np.zeros((3, 1))], axis=1).reshape(-1),
            binning_x=0,
            binning_y=0,
            roi=self._types["sensor_msgs/msg/RegionOfInterest"](
                x_offset=0, y_offset=0, height=0, width=0, do_rectify=False
            ),
        )


def _encode_image(pixels: AnyArray) -> Encoded:
    if pixels.ndim == 3:
        return Encoded(cv2.imencode(".jpg", pixels, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])[1], "jpeg")
    file, image_format = compressed_depth(pixels)
    return Encoded(np.frombuffer(file, np.uint8), image_format)


def _value(type_name: str, message: Any) -> Value:
    if type_name == OUTCOME_TYPE:
        return str(message.data)
    if type_name == TWIST_TYPE:
        return VelocityMessage(v_mps=message.linear.x, w_radps=message.angular.z)
    if type_name == STAMPED_TWIST_TYPE:
        return VelocityMessage(v_mps=message.twist.linear.x, w_radps=message.twist.angular.z)
    if type_name == GOAL_TYPE:
        place = message.pose.position
        return GoalMessage(x_m=place.x, y_m=place.y, frame=message.header.frame_id)
    if type_name == INFO_TYPE:
        return LogCamera.of(message)
    stamp_ns = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
    if type_name == ODOMETRY_TYPE:
        return _odometry_of(message, stamp_ns)
    encoded = Encoded(message.data, message.format) if type_name == COMPRESSED_TYPE else None
    return ImageMessage(stamp_ns=stamp_ns, decode=partial(_pixels, type_name, message), encoded=encoded)


def _odometry_of(message: Any, stamp_ns: int) -> OdometryMessage:
    place, turn = message.pose.pose.position, message.pose.pose.orientation
    return OdometryMessage(
        stamp_ns=stamp_ns,
        x_m=place.x,
        y_m=place.y,
        yaw_rad=yaw_of(turn),
        v_mps=message.twist.twist.linear.x,
        w_radps=message.twist.twist.angular.z,
        frame=message.header.frame_id or "odom",
        robot_frame=message.child_frame_id or "base_link",
    )


def _pixels(type_name: str, message: Any) -> AnyArray:
    if type_name == IMAGE_TYPE:
        return pixels_of(
            message.data,
            encoding=message.encoding,
            height_px=message.height,
            width_px=message.width,
            row_bytes=message.step,
            big_endian=bool(message.is_bigendian),
        )
    if is_compressed_depth(message.format):
        return compressed_depth_of(message.data.tobytes(), message.format)
    pixels = decode_pixels(message.data.tobytes(), cv2.IMREAD_COLOR)
    if pixels is None:
        raise ValueError(f"compressed images that are no JPEG or PNG (format {message.format!r})")
    return pixels
