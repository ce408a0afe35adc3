"""Messages between a policy and a robot, independent of the robot's transport."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple, Protocol

from readygo.apps.robot_logs.reader import NUMBER_MAX, LogCamera
from readygo.common.arrays import AnyArray, UInt8Array
from readygo.common.messages.live import LivePerson


class Encoded(NamedTuple):
    """A compressed image as received."""

    data: UInt8Array
    """Bytes of JPEG, PNG or ROS's compressedDepth, shape (N,)."""
    format: str
    """Format field of CompressedImage: "jpeg", "16UC1; compressedDepth png"."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ImageMessage:
    """An image of the robot's camera."""

    stamp_ns: int
    """Capture time, by the robot's clock [ns]; 0 if the robot sends none."""
    decode: Callable[[], AnyArray] = field(repr=False)
    """Returns the pixels: BGR, uint8, shape (H, W, 3); for a depth camera depths [m], inf where nothing was measured,
    float32, shape (H, W). Raises ValueError if they cannot be decoded."""
    encoded: Encoded | None = field(default=None, repr=False)
    """Compressed bytes as received; None for a raw image."""


@dataclass(frozen=True, kw_only=True)
class OdometryMessage:
    """Pose and velocity of the robot."""

    stamp_ns: int
    """Time of the message, by the robot's clock [ns]; 0 if the robot sends none."""
    x_m: float
    y_m: float
    yaw_rad: float
    v_mps: float
    w_radps: float
    frame: str = "odom"
    """Name of the frame of the pose."""
    robot_frame: str = "base_link"
    """Name of the robot's frame, whose pose it is."""

    def at(self, stamp_ns: int) -> "OdometryMessage":
        """The message with another time."""
        return replace(self, stamp_ns=stamp_ns)


@dataclass(frozen=True, kw_only=True)
class VelocityMessage:
    """Velocity command for the robot."""

    v_mps: float = 0.0
    w_radps: float = 0.0


@dataclass(frozen=True, kw_only=True)
class GoalMessage:
    """Goal position in the frame of the odometry [m]."""

    x_m: float
    y_m: float
    frame: str = ""
    """Name of the frame as the sender says it; empty if it does not."""


@dataclass(frozen=True, kw_only=True)
class PeopleMessage:
    """People around the robot; it is sent, not received."""

    stamp_ns: int
    """Capture time of the image that they were perceived in, by the robot's clock [ns]."""
    people: tuple[LivePerson, ...]
    frame: str = "odom"
    """Name of the frame of their places: the odometry's."""


@dataclass(frozen=True, kw_only=True)
class ScanMessage:
    """Free distances around the robot; it is sent, not received."""

    stamp_ns: int
    """Capture time of the image that they were perceived in, by the robot's clock [ns]."""
    angle_min_rad: float
    """Direction of the first ray from the robot's x axis to the left [rad]."""
    angle_increment_rad: float
    """From one ray to the next one to its left [rad]."""
    range_max_m: float
    """Largest range [m]."""
    period_s: float
    """Time between two scans [s]."""
    ranges_m: tuple[float, ...]
    """Free distances from the robot's centre [m]; inf beyond `range_max_m`, NaN where nothing is known."""
    frame: str = "base_link"
    """Name of the robot's frame."""


STAMP_MAX_NS = 2**31 * 10**9
"""Upper bound of stamps [ns]: ROS has 31 bits for seconds."""
Value = ImageMessage | OdometryMessage | VelocityMessage | GoalMessage | LogCamera | str
"""A message; a string is an outcome."""


def check_numbers(value: Value) -> Value:
    """Check the numbers of a message, and return it.

    Raises:
        ValueError: If a number is not finite or beyond `NUMBER_MAX`, or a time is invalid.
    """
    if isinstance(value, ImageMessage | OdometryMessage) and not 0 <= value.stamp_ns < STAMP_MAX_NS:
        raise ValueError(f"its time is {value.stamp_ns} ns; it must be within 0..{STAMP_MAX_NS}")
    numbers: tuple[float, ...] = ()
    if isinstance(value, OdometryMessage):
        numbers = (value.x_m, value.y_m, value.yaw_rad, value.v_mps, value.w_radps)
    elif isinstance(value, VelocityMessage):
        numbers = (value.v_mps, value.w_radps)
    elif isinstance(value, GoalMessage):
        numbers = (value.x_m, value.y_m)
    elif isinstance(value, LogCamera):
        numbers = (value.height_px, value.width_px, *value.K_px, *value.distortion)
    for number in numbers:
        if not (math.isfinite(number) and abs(number) <= NUMBER_MAX):
            raise ValueError(f"a number is {number:g}; it must be finite, and at most {NUMBER_MAX:g}")
    return value


class Codec(Protocol):
    """Encoder and decoder of a robot's messages; types are named as in ROS."""

    def read(self, type_name: str, payload: bytes) -> Value:
        """Decode a message.

        Raises:
            ValueError: If the bytes are not of that type, or hold numbers that `check_numbers` rejects.
        """
        ...

    def write(self, type_name: str, value: Any, stamp_ns: int) -> bytes:
        """Encode a message.

        Args:
            type_name: One of `ros_codec`'s types.
            value: A `Value`, a `PeopleMessage` or a `ScanMessage`; for a picture its pixels, as returned by
                `ImageMessage.decode`, or its `Encoded` bytes.
            stamp_ns: Time of the message [ns].
        """
        ...
