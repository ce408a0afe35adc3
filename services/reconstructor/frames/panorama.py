"""Images of 360 degrees, cut into views of a pinhole camera.

An equirectangular image of W x H pixels, W = 2 H, shows the ray of longitude lon (to the right) and latitude lat (up)
at u = (lon / 2 pi + 1/2) W and v = (1/2 - lat / pi) H, pixel centres at +0.5. Its camera has OpenCV axes: x right, y
down, z towards the image's middle. Views turn with it and share its centre.
"""

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from readygo.common.arrays import Float32Array, Float64Array, UInt8Array
from readygo.common.errors import SceneError
from readygo.common.images.encoded import read_pixels
from readygo.services.reconstructor.frames.light import encode_light, light_of
from readygo.services.reconstructor.frames.video import write_jpeg

_RINGS = ((0.0, 0.0), (45.0, -20.0))
"""Longitude of the first of four views, and latitude of all of them [deg]. Views are 90 deg wide and high: the lower
ring ends 65 deg below the horizon, where the photographer begins."""
_ROUNDING_PX = 2


def view_rotations() -> dict[str, Float64Array]:
    """Rotations `R_panorama_view` of the views that are cut, shape (3, 3), by the folder of each."""
    turns = [(first + 90.0 * k, pitch) for first, pitch in _RINGS for k in range(4)]
    return {f"view_{number}": _rotation(*np.radians(turn)) for number, turn in enumerate(turns)}


def panorama_rays(width_px: int) -> Float64Array:
    """Unit rays of an equirectangular image's pixels, shape (W / 2, W, 3)."""
    lon = ((np.arange(width_px) + 0.5) / width_px - 0.5) * math.tau
    lat = (0.5 - (np.arange(width_px // 2) + 0.5) / (width_px // 2)) * math.pi
    lat, lon = np.meshgrid(lat, lon, indexing="ij")
    return np.stack([np.cos(lat) * np.sin(lon), -np.sin(lat), np.cos(lat) * np.cos(lon)], axis=-1)


def view_side_px(width_px: int) -> int:
    """Sides of a view that is as fine as an equirectangular image's horizon [px], an even number."""
    return 2 * round(width_px / math.tau)


def panorama_width_px(side_px: int) -> int:
    """Width of an equirectangular image whose views have these sides [px]."""
    return math.ceil(math.pi * side_px)


def cut_panoramas(folder: Path, found: dict[str, Any]) -> dict[str, Any]:
    """Replace the 360-degree images of a folder, one at a time, by `folder`/VIEW/NAME.jpg for each view.

    Args:
        folder: Equirectangular images of one size, without subfolders.
        found: What is known of them.

    Returns:
        The same of the views, with the pinhole `lens` of each, and `rig`: `R_panorama_view` by folder.

    Raises:
        SceneError: If the images are not twice as wide as high.
    """
    if isinstance(found["size_px"][0], list) or not is_panorama(found["size_px"]):
        sizes = found["size_px"] if isinstance(found["size_px"][0], list) else [found["size_px"]]
        shape = ", ".join(f"{width}x{height}" for width, height in sizes[:3])
        raise SceneError(
            f"Images of {shape} px are no 360-degree images, whose width is twice the height, all of one size: export "
            "them as equirectangular, or leave --equirectangular out."
        )
    rotations, side_px = view_rotations(), view_side_px(found["size_px"][0])
    panoramas = sorted(folder.glob("*.jpg"))
    maps: dict[str, tuple[Float32Array, Float32Array]] = {}
    for path in panoramas:
        bgr = read_pixels(path, cv2.IMREAD_COLOR)
        assert bgr is not None
        maps = maps or {name: _places(R, side_px, bgr.shape[1]) for name, R in rotations.items()}
        for name, view in _cut(np.asarray(bgr, dtype=np.uint8), maps):
            write_jpeg(folder / name / path.name, view)
        path.unlink()
    lens = ["PINHOLE", side_px / 2, side_px / 2, side_px / 2, side_px / 2]
    names = [f"{name}/{path.name}" for name in rotations for path in panoramas]
    words = f"{len(panoramas)} images of 360 degrees are cut into {len(rotations)} views of 90 deg each"
    return {
        **found,
        "kept": len(names),
        "size_px": [side_px, side_px],
        "source_px": [side_px, side_px],
        "focal_px": 0.0,
        "photos": {},
        "lens": dict.fromkeys(names, lens),
        "rig": {name: R.tolist() for name, R in rotations.items()},
        "notes": [*found.get("notes", []), words],
    }


def is_panorama(size_px: tuple[int, int] | list[int]) -> bool:
    """True for the width and height of an equirectangular image, but for rounding to pixels."""
    return abs(size_px[0] - 2 * size_px[1]) <= _ROUNDING_PX


def _cut(bgr: UInt8Array, maps: dict[str, tuple[Float32Array, Float32Array]]) -> Iterator[tuple[str, UInt8Array]]:
    """The views of an equirectangular image (H, W, 3) by name, interpolated in light."""
    light = light_of(bgr)
    for name, (u, v) in maps.items():
        view = cv2.remap(light, u, v, cv2.INTER_CUBIC, borderMode=cv2.BORDER_WRAP)
        yield name, encode_light(np.asarray(view, dtype=np.uint16))


def _places(R_panorama_view: Float64Array, side_px: int, width_px: int) -> tuple[Float32Array, Float32Array]:
    """Column and row of the panorama, counted from the first pixel's centre, that each pixel of a view shows."""
    along = (np.arange(side_px) + 0.5) / (side_px / 2) - 1.0
    x, y = np.meshgrid(along, along)
    rays = np.stack([x, y, np.ones_like(x)], axis=-1) @ R_panorama_view.T
    lon, lat = np.arctan2(rays[..., 0], rays[..., 2]), np.arctan2(-rays[..., 1], np.hypot(rays[..., 0], rays[..., 2]))
    u = (lon / math.tau + 0.5) * width_px - 0.5
    v = (0.5 - lat / math.pi) * (width_px / 2) - 0.5
    return u.astype(np.float32), v.astype(np.float32)


def _rotation(yaw_rad: float, pitch_rad: float) -> Float64Array:
    """`R_panorama_view` of a view that is turned to the right, then up."""
    c, s, cp, sp = math.cos(yaw_rad), math.sin(yaw_rad), math.cos(pitch_rad), math.sin(pitch_rad)
    forward, right = np.array([s * cp, -sp, c * cp]), np.array([c, 0.0, -s])
    return np.column_stack([right, np.cross(forward, right), forward])
