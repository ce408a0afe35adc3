"""Messages for robots without ROS: MessagePack maps, described in docs/robots.md."""

import dataclasses
from collections.abc import Mapping
from functools import partial
from typing import Any

import cv2
import msgpack
import numpy as np

from readygo.apps.drive.messages import (
    Encoded,
    GoalMessage,
    ImageMessage,
    OdometryMessage,
    Value,
    VelocityMessage,
    check_numbers,
)
from readygo.apps.drive.ros_codec import (
    COMPRESSED_TYPE,
    GOAL_TYPE,
    IMAGE_TYPE,
    OUTCOME_TYPE,
    PEOPLE_TYPE,
    SCAN_TYPE,
    STAMPED_TWIST_TYPE,
    TWIST_TYPE,
)
from readygo.apps.robot_logs.pixels import (
    compressed_depth,
    compressed_depth_of,
    is_compressed_depth,
    millimetres,
    pixels_of,
)
from readygo.apps.robot_logs.reader import INFO_TYPE, JPEG_QUALITY, ODOMETRY_TYPE, LogCamera
from readygo.common.arrays import AnyArray
from readygo.common.images.encoded import decode_pixels
from readygo.common.messages.codec import unpack
from readygo.common.messages.live import LivePerson

ITEMS_MAX = 100
"""Largest number of items of a list or map in a robot's message."""
_ENCODED = ("jpeg", "png")


class PlainCodec:
    """Codec of MessagePack maps."""

    def read(self, type_name: str, payload: bytes) -> Value:
        """Decode a message; raises ValueError if it is invalid."""
        try:
            fields = unpack(payload, ITEMS_MAX)
            if not isinstance(fields, dict):
                raise TypeError(f"a map was due, not {type(fields).__name__}")
            return check_numbers(_value(type_name, fields))
        except (LookupError, TypeError, ValueError, OverflowError, MemoryError, msgpack.UnpackException) as error:
            raise ValueError(f"{len(payload)} bytes are no message of {type_name}: {error!r}") from error

    def write(self, type_name: str, value: Any, stamp_ns: int) -> bytes:
        """Encode a message; arguments as in `Codec.write`."""
        fields = {"stamp_ns": stamp_ns, **_fields(type_name, value)}
        packed: bytes = msgpack.packb(fields)
        return packed


def _fields(type_name: str, value: Any) -> dict[str, Any]:
    if type_name == IMAGE_TYPE:
        height, width = value.shape[:2]
        encoding = "bgr8" if value.ndim == 3 else "16UC1"
        stored = value if value.ndim == 3 else millimetres(value).astype("<u2")
        return {"encoding": encoding, "height_px": height, "width_px": width, "data": stored.tobytes()}
    if type_name == COMPRESSED_TYPE and value.ndim == 2:
        data, encoding = compressed_depth(value)
        return {"encoding": encoding, "height_px": value.shape[0], "width_px": value.shape[1], "data": data}
    if type_name == COMPRESSED_TYPE:
        data = cv2.imencode(".jpg", value, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])[1].tobytes()
        return {"encoding": "jpeg", "height_px": value.shape[0], "width_px": value.shape[1], "data": data}
    if type_name == INFO_TYPE:
        names = ("height_px", "width_px", "model", "K_px", "distortion")
        return {name: getattr(value, name) for name in names}
    if type_name == OUTCOME_TYPE:
        return {"outcome": value}
    if type_name == PEOPLE_TYPE:
        return {"frame": value.frame, "people": [_person(person) for person in value.people]}
    if type_name == SCAN_TYPE:
        return dataclasses.asdict(value)
    numbers: dict[str, tuple[str, ...]] = {
        ODOMETRY_TYPE: ("x_m", "y_m", "yaw_rad", "v_mps", "w_radps"),
        GOAL_TYPE: ("x_m", "y_m"),
        TWIST_TYPE: ("v_mps", "w_radps"),
        STAMPED_TWIST_TYPE: ("v_mps", "w_radps"),
    }
    fields: dict[str, Any] = {name: float(getattr(value, name)) for name in numbers[type_name]}
    return fields | {"frame": value.frame} if type_name in (ODOMETRY_TYPE, GOAL_TYPE) else fields


def _person(person: LivePerson) -> dict[str, Any]:
    """A human as plain values."""
    (x_m, y_m), (vx_mps, vy_mps) = person.xy_m, person.v_mps
    return {
        "number": person.number,
        "presence": person.presence,
        "x_m": x_m,
        "y_m": y_m,
        "vx_mps": vx_mps,
        "vy_mps": vy_mps,
        "position_covariance": list(person.place_cov_m2),
        "velocity_covariance": list(person.velocity_cov_m2ps2),
        "age_s": person.age_s,
    }


def _value(type_name: str, fields: Mapping[str, Any]) -> Value:
    if type_name in (PEOPLE_TYPE, SCAN_TYPE):
        raise ValueError("people and scans are sent, not received")
    if type_name in (IMAGE_TYPE, COMPRESSED_TYPE):
        encoding, data, encoded = str(fields["encoding"]), fields["data"], None
        if not isinstance(data, bytes):
            raise TypeError(f"data must be bytes, not {type(data).__name__}")
        size_px = (0, 0)
        if encoding in _ENCODED or is_compressed_depth(encoding):
            encoded = Encoded(np.frombuffer(data, np.uint8), encoding)
        else:
            size_px = int(fields["height_px"]), int(fields["width_px"])
        decode = partial(_pixels, encoding, data, size_px)
        return ImageMessage(stamp_ns=int(fields.get("stamp_ns", 0)), decode=decode, encoded=encoded)
    if type_name == INFO_TYPE:
        return LogCamera(
            height_px=int(fields["height_px"]),
            width_px=int(fields["width_px"]),
            K_px=tuple(float(value) for value in fields["K_px"]),
            model=str(fields["model"]),
            distortion=tuple(float(value) for value in fields["distortion"]),
        )
    if type_name == OUTCOME_TYPE:
        return str(fields["outcome"])
    if type_name == GOAL_TYPE:
        return GoalMessage(x_m=float(fields["x_m"]), y_m=float(fields["y_m"]), frame=str(fields.get("frame", "")))
    if type_name in (TWIST_TYPE, STAMPED_TWIST_TYPE):
        return VelocityMessage(v_mps=float(fields["v_mps"]), w_radps=float(fields["w_radps"]))
    names = ("x_m", "y_m", "yaw_rad", "v_mps", "w_radps")
    numbers: dict[str, Any] = {name: float(fields[name]) for name in names}
    return OdometryMessage(stamp_ns=int(fields.get("stamp_ns", 0)), frame=str(fields.get("frame", "odom")), **numbers)


def _pixels(encoding: str, data: bytes, size_px: tuple[int, int]) -> AnyArray:
    if is_compressed_depth(encoding):
        return compressed_depth_of(data, encoding)
    if encoding not in _ENCODED:
        height, width = size_px
        row_bytes = len(data) // max(height, 1)
        return pixels_of(
            np.frombuffer(data, np.uint8), encoding=encoding, height_px=height, width_px=width, row_bytes=row_bytes
        )
    pixels = decode_pixels(data, cv2.IMREAD_COLOR)
    if pixels is None:
        raise ValueError(f"images that are no {encoding}")
    return pixels
