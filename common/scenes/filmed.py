"""From where a scene can be rendered as it was filmed, by the cameras that filmed it.

Things are known from the sides that cameras saw them from. A place is rated by the rays that leave it all around: a ray
is filmed if what it meets was seen from about the direction that it comes from, or, where it meets nothing, if the
ground before it was seen.
All happens on the grid of the scene's maps, with what hides things at each height (`readygo.common.maps.sight`).

Legend: bin = one of `BINS` directions on the ground, seen from a thing, counterclockwise from +x.
"""

import math

import numpy as np

from readygo.common.arrays import BoolArray, Float32Array, Float64Array, Int64Array, UInt16Array, UInt32Array
from readygo.common.camera.captured import CapturedViews
from readygo.common.kernels import kernel_with_cache
from readygo.common.maps import FloorMap, SightMap
from readygo.common.maps.sight import is_clear

FILMED_MIN = 0.5
"""Places with a smaller share of filmed rays show too much that was not filmed."""
CAMERAS_MAX = 400
"""Most cameras that are used; of more, so many are taken evenly."""
FAR_M = 8.0
"""What is farther from a camera, or a place, tells nothing of it [m]."""
BINS = 16
NEAR_BINS = 2
"""What was filmed from within so many bins (45 deg) is known."""
RAYS = 24
_THING_HEIGHTS_M = (0.5, 1.2)
_THING_M, _GROUND_M = 0.8, 0.0
_GROUND_STEPS_M = (0.8, 1.6)
_STRIDE = 2
_SMOOTH_CELLS = 5


def filmed_share(views: CapturedViews, sight: SightMap, floor: FloorMap, standing: BoolArray) -> Float32Array:
    """How much of what is seen from each place was filmed, from 0 to 1.

    Args:
        views: The cameras.
        sight: What hides what; gives the grid.
        floor: The local floor.
        standing: Places that are asked for, shape (H, W).

    Returns:
        Shape (H, W), 0 where `standing` is false.
    """
    from scipy import ndimage

    things = sight.opaque_between(*_THING_HEIGHTS_M)
    rims = things & ~ndimage.binary_erosion(things, np.ones((3, 3), np.bool_))
    frame = sight.frame
    place = (float(frame.origin_x_m), float(frame.origin_y_m), float(frame.resolution_m), float(sight.layer_m))
    cameras = _cameras(views, floor)
    thing_bits, ground_bits = np.zeros(things.shape, np.uint16), np.zeros(things.shape, np.uint16)
    _look(sight.opaque, place, *cameras, np.argwhere(rims), _THING_M, thing_bits)
    _look(sight.opaque, place, *cameras, np.argwhere(standing), _GROUND_M, ground_bits)
    share = np.zeros(things.shape, np.float32)
    _rate(things, thing_bits, ground_bits, standing, float(frame.resolution_m), share)
    smooth = ndimage.median_filter(share, _SMOOTH_CELLS, mode="nearest")
    return np.where(standing, smooth, np.float32(0.0))


def _cameras(views: CapturedViews, floor: FloorMap) -> tuple[Float64Array, Float64Array, Float64Array]:
    """x, y, height above the floor [m] (C, 3); rotations world to camera (C, 3, 3); intrinsics and size [px] (C, 6)."""
    chosen = np.unique(np.linspace(0, len(views) - 1, min(len(views), CAMERAS_MAX)).round().astype(np.int64))
    T, K = views.T_world_camera[chosen], views.K_px[chosen]
    centres = T[:, :3, 3]
    eyes = np.column_stack([centres[:, :2], centres[:, 2] - floor.at_many(np.ascontiguousarray(centres[:, :2]))])
    images = np.column_stack([K[:, 0, 0], K[:, 1, 1], K[:, 0, 2], K[:, 1, 2], views.sizes_px[chosen]])
    return eyes, np.ascontiguousarray(np.swapaxes(T[:, :3, :3], 1, 2)), images.astype(np.float64)


@kernel_with_cache
def _look(
    opaque: UInt32Array,
    place: tuple[float, float, float, float],
    eyes: Float64Array,
    R_camera_world: Float64Array,
    images: Float64Array,
    cells: Int64Array,
    height_m: float,
    bits: UInt16Array,
) -> None:
    """Mark from which bins cameras see cells, at a height above the floor."""
    ox, oy, resolution, _ = place
    for n in range(len(cells)):
        i, j = cells[n, 0], cells[n, 1]
        x, y = ox + (j + 0.5) * resolution, oy + (i + 0.5) * resolution
        for c in range(len(eyes)):
            dx, dy, dz = x - eyes[c, 0], y - eyes[c, 1], height_m - eyes[c, 2]
            away = math.sqrt(dx * dx + dy * dy)
            if away > FAR_M or away < 2.0 * resolution:
                continue
            R, image = R_camera_world[c], images[c]
            depth = R[2, 0] * dx + R[2, 1] * dy + R[2, 2] * dz
            if depth < 0.1:
                continue
            u = image[0] * (R[0, 0] * dx + R[0, 1] * dy + R[0, 2] * dz) / depth + image[2]
            v = image[1] * (R[1, 0] * dx + R[1, 1] * dy + R[1, 2] * dz) / depth + image[3]
            if u < 0.0 or v < 0.0 or u > image[4] or v > image[5]:
                continue
            side = np.uint16(1 << (math.floor((math.atan2(-dy, -dx) / math.tau + 1.0) * BINS + 0.5) % BINS))
            if bits[i, j] & side:
                continue
            # The thing itself hides nothing of what is on it.
            until = 1.0 - 1.5 * resolution / away
            target = (eyes[c, 0] + until * dx, eyes[c, 1] + until * dy, eyes[c, 2] + until * dz)
            if is_clear(opaque, place, (eyes[c, 0], eyes[c, 1], eyes[c, 2]), target, True):
                bits[i, j] |= side


@kernel_with_cache
def _rate(
    things: BoolArray,
    thing_bits: UInt16Array,
    ground_bits: UInt16Array,
    standing: BoolArray,
    resolution: float,
    share: Float32Array,
) -> None:
    """Share of the rays around each place that were filmed, for blocks of `_STRIDE` cells."""
    rows, columns = things.shape
    steps = int(FAR_M / resolution)
    for i in range(0, rows, _STRIDE):
        for j in range(0, columns, _STRIDE):
            if not standing[i : i + _STRIDE, j : j + _STRIDE].any():
                continue
            filmed = 0
            for ray in range(RAYS):
                if _is_filmed(things, thing_bits, ground_bits, (i, j), ray / RAYS, steps, resolution):
                    filmed += 1
            share[i : i + _STRIDE, j : j + _STRIDE] = filmed / RAYS


@kernel_with_cache
def _is_filmed(
    things: BoolArray,
    thing_bits: UInt16Array,
    ground_bits: UInt16Array,
    place: tuple[int, int],
    turn: float,
    steps: int,
    resolution: float,
) -> bool:
    """True if what a ray meets was filmed from about the side of its place; if it meets nothing, if the ground was."""
    rows, columns = things.shape
    c, s = math.cos(math.tau * turn), math.sin(math.tau * turn)
    side = math.floor((turn + 0.5) * BINS + 0.5) % BINS
    near = False
    for step in range(1, steps):
        y, x = math.floor(place[0] + 0.5 + s * step), math.floor(place[1] + 0.5 + c * step)
        if y < 0 or x < 0 or y >= rows or x >= columns:
            break
        if things[y, x]:
            around = 0
            # Rays meet cells beside the rim that cameras saw.
            for di in range(max(y - 1, 0), min(y + 2, rows)):
                for dj in range(max(x - 1, 0), min(x + 2, columns)):
                    around |= int(thing_bits[di, dj])
            known = False
            for off in range(-NEAR_BINS, NEAR_BINS + 1):
                known |= (around >> ((side + off) % BINS)) & 1 == 1
            return known
        for ground_m in _GROUND_STEPS_M:
            if step == int(ground_m / resolution) and ground_bits[y, x] != 0:
                near = True
    return near
