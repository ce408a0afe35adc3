"""What hides humans from a camera: which heights of every cell are opaque.

A wall hides all of a human, a table only the legs. Bit b of a cell covers the heights above the local floor from
`BOTTOM_M` + b * `layer_m` on; things that are lower hide no human.
"""

import math
from dataclasses import dataclass

import numpy as np

from readygo.common.arrays import BoolArray, UInt32Array
from readygo.common.gaussians import GaussianCloud
from readygo.common.kernels import kernel_with_cache
from readygo.common.maps.grid import FloorMap, GridFrame, OccupancyMap
from readygo.common.maps.occupancy import MapConfig, above_floor
from readygo.common.maps.voxels import occupied_bands

BOTTOM_M, TOP_M = 0.4, 1.9
"""Heights above the floor that sight is known for [m]; higher ones are clear; for lower ones see `is_clear`."""
BITS = 32
TARGET_HEIGHTS_M = (0.5, 1.0, 1.5)
TARGET_OFFSETS_M = (0.0, -0.2, 0.2)
"""Points of a human's body that are looked for: heights above the floor, and across the line of sight [m]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class SightMap:
    """Opaque layers of the cells of a map."""

    frame: GridFrame
    opaque: UInt32Array
    """Bit b is set where layer b is opaque, shape (H, W); row 0 is the smallest y."""
    layer_m: float
    """Height of a layer [m]."""

    def sees(self, x_m: float, y_m: float, camera_m: float, human_m: tuple[float, float]) -> bool:
        """True if a ray from the camera reaches the body of a human.

        Args:
            x_m: Camera in the world [m].
            y_m: Camera in the world [m].
            camera_m: Height of the camera above the floor [m].
            human_m: Where the human stands in the world [m].
        """
        frame = self.frame
        place = (frame.origin_x_m, frame.origin_y_m, frame.resolution_m, self.layer_m)
        return bool(sees_human(self.opaque, place, (x_m, y_m, camera_m), human_m))

    def opaque_between(self, low_m: float, high_m: float) -> BoolArray:
        """Cells with something opaque between two heights above the floor [m], shape (H, W)."""
        first, last = (math.floor((height_m - BOTTOM_M) / self.layer_m) for height_m in (low_m, high_m))
        bits = np.uint32(sum(1 << bit for bit in range(max(first, 0), min(last, BITS - 1) + 1)))
        cells: BoolArray = (self.opaque & bits) != 0
        return cells


def sight_of_occupancy(occupancy: OccupancyMap) -> SightMap:
    """Sight over a 2-D map without heights: occupied cells hide everything."""
    opaque = np.where(occupancy.occupied, np.uint32(0xFFFFFFFF), np.uint32(0))
    return SightMap(frame=occupancy.frame, opaque=opaque, layer_m=(TOP_M - BOTTOM_M) / BITS)


def sight_of_cloud(
    cloud: GaussianCloud, floor: FloorMap, frame: GridFrame, shape: tuple[int, int], config: MapConfig
) -> SightMap:
    """Sight over a Gaussian scene, by the voxels that its occupancy maps are made of.

    Args:
        cloud: Gaussians, metres, z up; no sky.
        floor: The local floor.
        frame: Cells of the map to make.
        shape: Rows and columns of the map to make.
        config: Thresholds.
    """
    cell_m = frame.resolution_m
    layers = math.ceil((TOP_M - BOTTOM_M) / cell_m - 1e-6)
    per_bit = math.ceil(layers / BITS)
    above = above_floor(cloud, floor)
    opaque = np.zeros(shape, np.uint32)
    for rows, occupied in occupied_bands(above, frame, BOTTOM_M, (layers, *shape), config.opacity_threshold):
        for layer in range(layers):
            opaque[rows] |= np.where(occupied[layer], np.uint32(1 << (layer // per_bit)), np.uint32(0))
    return SightMap(frame=frame, opaque=opaque, layer_m=per_bit * cell_m)


@kernel_with_cache
def is_clear(
    opaque: UInt32Array,
    place: tuple[float, float, float, float],
    eye: tuple[float, float, float],
    target: tuple[float, float, float],
    low_clear: bool,
) -> bool:
    """True if no opaque layer lies on a segment; checked every half cell.

    Args:
        opaque: Which heights of every cell are opaque, bits as in `SightMap`, shape (H, W).
        place: Origin x, y, resolution and height of a layer [m].
        eye: x, y in the world, height above the floor [m].
        target: The other end: x, y in the world, height above the floor [m].
        low_clear: True if all is clear below the heights that sight is known for, False if it is as the lowest of them.
    """
    ox, oy, resolution, layer = place
    dx, dy, dz = target[0] - eye[0], target[1] - eye[1], target[2] - eye[2]
    steps = int(math.sqrt(dx * dx + dy * dy) / (0.5 * resolution)) + 1
    for k in range(steps + 1):
        t = k / steps
        i = math.floor((eye[1] + dy * t - oy) / resolution)
        j = math.floor((eye[0] + dx * t - ox) / resolution)
        bit = math.floor((eye[2] + dz * t - BOTTOM_M) / layer)
        if bit < 0 and not low_clear:
            bit = 0
        inside = 0 <= i < opaque.shape[0] and 0 <= j < opaque.shape[1] and 0 <= bit < BITS
        if inside and (opaque[i, j] >> np.uint32(bit)) & np.uint32(1):
            return False
    return True


@kernel_with_cache
def sees_human(
    opaque: UInt32Array,
    place: tuple[float, float, float, float],
    eye: tuple[float, float, float],
    human: tuple[float, float],
) -> bool:
    """True if a ray from the camera reaches the body of a human; for compiled callers, see `SightMap.sees`.

    Args:
        opaque: Which heights of every cell are opaque, bits as in `SightMap`, shape (H, W).
        place: Origin x, y, resolution and height of a layer [m].
        eye: Camera: x, y in the world, height above the floor [m].
        human: Where the human stands in the world [m].
    """
    dx, dy = human[0] - eye[0], human[1] - eye[1]
    distance = max(math.sqrt(dx * dx + dy * dy), 1e-9)
    for offset in TARGET_OFFSETS_M:
        x, y = human[0] - dy / distance * offset, human[1] + dx / distance * offset
        for height in TARGET_HEIGHTS_M:
            # What hides a human from a low camera reaches the floor: walls and furniture, not table tops.
            if is_clear(opaque, place, eye, (x, y, height), False):
                return True
    return False
