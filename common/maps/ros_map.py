"""ROS map_server maps: a yaml file beside a png or pgm picture whose first row is the largest y.

Source: the ROS 1 `map_server` and Nav2 `map_server` packages (trinary mode).
"""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from readygo.common.arrays import BoolArray, Float64Array, UInt8Array
from readygo.common.documents import read_yaml
from readygo.common.errors import SceneError
from readygo.common.files import read_regular, write_whole
from readygo.common.images.encoded import PICTURES, PIXELS_MAX, decode_pixels, encoded_size_px
from readygo.common.maps.grid import GridFrame, OccupancyMap

OCCUPIED_PX, UNKNOWN_PX, FREE_PX = 0, 205, 254
_QUARTER_TURN_TOLERANCE_RAD = 0.01


@dataclass(frozen=True, kw_only=True)
class RosMapHeader:
    """The fields of a map_server yaml."""

    image: str
    resolution_m: float
    origin: tuple[float, float, float]
    """World pose of the picture's lower left corner: x [m], y [m], yaw [rad]."""
    negate: bool
    occupied_thresh: float
    free_thresh: float


def load_ros_map(path: str | Path) -> OccupancyMap:
    """Read a map_server yaml and its picture; unknown and transparent cells count as occupied.

    A yaw of the origin is honoured for quarter turns, to which angles within 0.01 rad are rounded.

    Args:
        path: The yaml file.

    Raises:
        SceneError: If a file is missing or broken, or the yaw is not a quarter turn.
    """
    path = Path(path)
    header = _read_header(path)
    occupancy, transparent = _read_picture(path.parent / header.image, header.negate)
    free = (occupancy < header.free_thresh) & ~transparent
    return _place_map(np.ascontiguousarray(~free[::-1]), header, path)


def load_unknown_cells(path: str | Path) -> BoolArray:
    """The cells that a map says nothing about, in the rows and columns of `load_ros_map`.

    Raises:
        SceneError: If a file is missing or broken, or the yaw is not a quarter turn.
    """
    path = Path(path)
    header = _read_header(path)
    occupancy, transparent = _read_picture(path.parent / header.image, header.negate)
    between = (occupancy >= header.free_thresh) & (occupancy <= header.occupied_thresh)
    return _place_map(np.ascontiguousarray((between | transparent)[::-1]), header, path).occupied


def _place_map(occupied: BoolArray, header: RosMapHeader, path: Path) -> OccupancyMap:
    x, y, yaw = header.origin
    turns = round(yaw / (math.pi / 2))
    if abs(yaw - turns * math.pi / 2) > _QUARTER_TURN_TOLERANCE_RAD:
        raise SceneError(f"{path} has a yaw of {yaw:.3f} rad; only quarter turns are supported: turn the picture.")
    height_m, width_m = (n * header.resolution_m for n in occupied.shape)
    # Rows grow with y here, so that numpy's quarter turn from axis 1 to axis 0 is counter-clockwise in the world.
    turned = np.ascontiguousarray(np.rot90(occupied, k=turns % 4, axes=(1, 0)))
    shift_x, shift_y = {0: (0.0, 0.0), 1: (height_m, 0.0), 2: (width_m, height_m), 3: (0.0, width_m)}[turns % 4]
    frame = GridFrame(origin_x_m=x - shift_x, origin_y_m=y - shift_y, resolution_m=header.resolution_m)
    return OccupancyMap(frame=frame, occupied=turned)


def save_ros_map(
    occupancy: OccupancyMap,
    path: str | Path,
    *,
    unknown: BoolArray | None = None,
    picture_format: Literal["png", "pgm"] = "png",
) -> None:
    """Write a map_server yaml and, beside it, its picture.

    Args:
        occupancy: Map.
        path: Name of the yaml; the picture has the same stem.
        unknown: Cells to draw as unknown (grey), shape (H, W); `load_ros_map` takes them as occupied.
        picture_format: What map_server versions of ROS 1 and Nav2 alike read.

    Raises:
        SceneError: If the files cannot be written.
    """
    path = Path(path)
    pixels = np.where(occupancy.occupied, OCCUPIED_PX, FREE_PX).astype(np.uint8)
    if unknown is not None:
        pixels[unknown] = UNKNOWN_PX
    picture = path.with_suffix(f".{picture_format}")
    write_whole(picture, _encode_pixels(np.ascontiguousarray(pixels[::-1]), picture.suffix), raises=SceneError)
    frame = occupancy.frame
    lines = [
        f"image: {picture.name}",
        "mode: trinary",
        f"resolution: {frame.resolution_m!r}",
        f"origin: [{frame.origin_x_m!r}, {frame.origin_y_m!r}, 0.0]",
        "negate: 0",
        "occupied_thresh: 0.65",
        "free_thresh: 0.196",
    ]
    write_whole(path, "\n".join(lines) + "\n", raises=SceneError)


def _encode_pixels(pixels: UInt8Array, suffix: str) -> bytes:
    import cv2

    ok, encoded = cv2.imencode(suffix, pixels)
    assert ok
    return bytes(encoded.tobytes())


def _read_header(path: Path) -> RosMapHeader:
    try:
        fields = read_yaml(path)
    except (OSError, ValueError) as error:
        raise SceneError(f"Map {path} cannot be read: {getattr(error, 'strerror', None) or error}.") from error
    if not isinstance(fields, dict):
        raise SceneError(f"Map {path} holds no keys: it is not a map_server yaml.")
    mode = fields.get("mode", "trinary")
    if mode not in ("trinary", "scale"):
        raise SceneError(f"Map {path} has mode {mode!r}; only 'trinary' and 'scale' are supported.")
    try:
        origin = [float(number) for number in fields["origin"]]
        header = RosMapHeader(
            image=str(fields["image"]),
            resolution_m=float(fields["resolution"]),
            origin=(origin[0], origin[1], origin[2] if len(origin) > 2 else 0.0),
            negate=str(fields.get("negate", "0")).lower() in ("1", "true"),
            occupied_thresh=float(fields.get("occupied_thresh", "0.65")),
            free_thresh=float(fields.get("free_thresh", "0.196")),
        )
    except KeyError as error:
        raise SceneError(f"Map {path} lacks the key {error.args[0]!r}: it is not a map_server yaml.") from error
    except (ValueError, TypeError, IndexError) as error:
        raise SceneError(f"Map {path} has a value that is not a number: {error}.") from error
    if not (0 < header.resolution_m < math.inf) or not all(map(math.isfinite, header.origin)):
        raise SceneError(f"Map {path} needs a positive resolution and a finite origin.")
    if not 0 <= header.free_thresh <= header.occupied_thresh <= 1:
        raise SceneError(
            f"Map {path} needs 0 <= free_thresh <= occupied_thresh <= 1, got {header.free_thresh:g} and "
            f"{header.occupied_thresh:g}."
        )
    return header


def _read_picture(path: Path, negate: bool) -> tuple[Float64Array, BoolArray]:
    """Occupancy 0..1 per pixel and where the picture is transparent, first row on top, shape (H, W) each."""
    import cv2

    try:
        data = read_regular(path)
    except OSError as error:
        raise SceneError(f"Map picture {path} cannot be read: {error.strerror or error}.") from error
    if not data:
        raise SceneError(f"Map picture {path} is empty.")
    pixels = decode_pixels(data, cv2.IMREAD_UNCHANGED, formats=PICTURES)
    if pixels is None:
        size_px = encoded_size_px(data)
        if size_px is not None and size_px[0] * size_px[1] > PIXELS_MAX:
            raise SceneError(
                f"Map picture {path} claims {size_px[1]} x {size_px[0]} pixels, more than {PIXELS_MAX}; save it with a "
                "coarser resolution."
            )
        raise SceneError(f"Map picture {path} is not a png or pgm picture, or it is truncated.")
    if pixels.dtype not in (np.uint8, np.uint16):
        raise SceneError(f"Map picture {path} has pixels of type {pixels.dtype}; save it with 8 or 16 bits.")
    white = 255.0 if pixels.dtype == np.uint8 else 65535.0
    layers = pixels.reshape(*pixels.shape[:2], -1)
    has_alpha = layers.shape[2] in (2, 4)
    grey = layers[:, :, : layers.shape[2] - has_alpha].mean(axis=2)
    grey /= white
    transparent = layers[:, :, -1] < white if has_alpha else np.zeros(grey.shape, np.bool_)
    return (grey if negate else np.subtract(1.0, grey, out=grey)), transparent
