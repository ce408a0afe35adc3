"""What passes between a policy and a robot, whatever the robot's messages are."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, NamedTuple, Protocol

import numpy as np
import numpy.typing as npt

from readygo.apps.robot_logs.reader import NUMBER_MAX, LogCamera


class Encoded(NamedTuple):
    """An image as a compressed one comes."""

    data: npt.NDArray[np.uint8]
    """JPEG, PNG, or what ROS's compressedDepth is, shape (N,)."""
    format: str
    """What CompressedImage says of it: "jpeg", "16UC1; compressedDepth png"."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Picture:
    """An image of the robot's camera."""

    stamp_ns: int
    """When it was taken, by the robot's clock [ns]; 0 if the robot does not say."""
    decode: Callable[[], npt.NDArray[Any]] = field(repr=False)
    """Its pixels, blue, green, red, uint8, shape (H, W, 3); of a depth camera depths [m], inf where nothing was
    measured, float32, shape (H, W); ValueError if they cannot be read."""
    encoded: Encoded | None = field(default=None, repr=False)
    """As it came, where it came compressed."""


@dataclass(frozen=True, kw_only=True)
class Odometry:
    """Where the robot is."""

    stamp_ns: int
    """By the robot's clock [ns]; 0 if the robot does not say."""
    x_m: float
    y_m: float
    yaw_rad: float
    v_mps: float
    w_radps: float


@dataclass(frozen=True, kw_only=True)
class Command:
    """What the robot shall do."""

    v_mps: float = 0.0
    w_radps: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Goal:
    """Where the robot shall go, in the frame of its odometry [m]."""

    x_m: float
    y_m: float


STAMP_MAX_NS = 2**31 * 10**9
"""Times in ROS have seconds of 31 bits."""
Value = Picture | Odometry | Command | Goal | LogCamera | str
"""A message; a string is an outcome."""


def check_numbers(value: Value) -> Value:
    """The message, if a robot can mean its numbers.

    Raises:
        ValueError: If one is not finite, or beyond `NUMBER_MAX`, or a time is none.
    """
    if isinstance(value, Picture | Odometry) and not 0 <= value.stamp_ns < STAMP_MAX_NS:
        raise ValueError(f"its time is {value.stamp_ns} ns; it must be within 0..{STAMP_MAX_NS}")
    numbers: tuple[float, ...] = ()
    if isinstance(value, Odometry):
        numbers = (value.x_m, value.y_m, value.yaw_rad, value.v_mps, value.w_radps)
    elif isinstance(value, Command):
        numbers = (value.v_mps, value.w_radps)
    elif isinstance(value, Goal):
        numbers = (value.x_m, value.y_m)
    elif isinstance(value, LogCamera):
        numbers = (value.height_px, value.width_px, *value.K_px, *value.distortion)
    for number in numbers:
        if not (math.isfinite(number) and abs(number) <= NUMBER_MAX):
            raise ValueError(f"a number is {number:g}; it must be finite, and at most {NUMBER_MAX:g}")
    return value


class Codec(Protocol):
    """A robot's messages, to and from bytes; types are named as in ROS."""

    def read(self, type_name: str, payload: bytes) -> Value:
        """The message in some bytes.

        Raises:
            ValueError: If they hold none of that type, or numbers that `check_numbers` refuses.
        """
        ...

    def write(self, type_name: str, value: Any, stamp_ns: int) -> bytes:
        """The bytes of a message.

        Args:
            type_name: One of `ros_codec`'s types.
            value: A `Value`; in place of a picture its pixels, see `Picture.decode`, or what it was `Encoded` as.
            stamp_ns: Time of the message [ns].
        """
        ...
