"""Maps of a scene for agents of two heights, from its Gaussians.

Voxels are stacked on the local floor: each Gaussian is lowered by the floor's height at its centre before the exact
ellipsoid test, so that a layer has one height above the floor everywhere, also on tilted and uneven ground.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from readygo.common.arrays import BoolArray, Float64Array
from readygo.common.gaussians import GaussianCloud
from readygo.common.maps.coarse_ground import ground_detail
from readygo.common.maps.floor import FloorEstimate, complete_floor, estimate_floor
from readygo.common.maps.grid import FloorMap, GridFrame, OccupancyMap
from readygo.common.maps.voxels import occupied_bands

FLOOR_CELLS = 2
"""Cells of the floor map are this many map cells wide."""
LOW_BAND_M = 0.10
LOW_WIDTH_M = 0.15
"""Up to LOW_BAND_M over the ground clearance, things narrower than this with nothing above are noise of the floor [m].

A reconstructed floor is some 10 cm thick; its highest Gaussians would close doorways.
"""
STEP_M = 0.05
"""Something stands where the ground that is seen rises by more than this more steeply than ground does [m]: low boxes,
whose Gaussians are not higher than rough ground. A box 0.3 m wide and 0.1 m high has 0.051 m in a flat; of the rough
ground in a camp site 9 % of the area has more, of that in a flat none."""
GROUND_CLEARANCE_M = 0.10
"""Lower things count as floor [m]."""
SLOPE_MAX = 0.35
"""Steeper floor (rise over run) is blocked."""
RAIL_TOP_M = 1.3
RAIL_WIDTH_M = 0.4
RAIL_LENGTH_M = 0.8
"""A handrail is at most this high above the floor, at most this wide and at least this long [m]."""


@dataclass(frozen=True, kw_only=True)
class MapConfig:
    """How the maps of a scene are made."""

    resolution_m: float = 0.05
    """Edge of cells and voxels [m]."""
    opacity_threshold: float = 0.5
    """A voxel is occupied if the opacities of the Gaussians that touch it sum up to more than this."""
    robot_height_m: float = 0.6
    human_height_m: float = 1.9
    close_coarse: bool = False
    """True blocks ground that was not filmed: where huge Gaussians stand for it."""
    close_unfilmed: bool = True
    """True keeps the robot where it sees what was filmed; only of scenes whose cameras are known."""

    def __post_init__(self) -> None:
        if not 0.01 <= self.resolution_m <= 1.0:
            raise ValueError(f"resolution_m must be 0.01..1, got {self.resolution_m}.")
        if not self.opacity_threshold > 0:
            raise ValueError(f"opacity_threshold must be positive, got {self.opacity_threshold}.")
        if not min(self.robot_height_m, self.human_height_m) > GROUND_CLEARANCE_M:
            raise ValueError(
                f"heights of robot and human must be above {GROUND_CLEARANCE_M} m, below which things are floor, got "
                f"{self.robot_height_m} and {self.human_height_m}."
            )


@dataclass(frozen=True, kw_only=True, eq=False)
class ScenePlan:
    """What `plan_scene` makes of a cloud."""

    robot: OccupancyMap
    human: OccupancyMap
    floor: FloorMap
    unknown: BoolArray
    """Cells that are occupied only because no floor, or a too steep one, is seen there, shape (H, W)."""
    phantoms: BoolArray
    """Cells where only the floor's own Gaussians stick out of it; they are free, shape (H, W)."""
    coarse: BoolArray
    """Cells whose ground was not filmed from near, shape (H, W)."""
    blurred: BoolArray
    """Cells whose ground consists of Gaussians so large that images of it are blurred, shape (H, W)."""
    ground_size_m: float
    """Usual size of the Gaussians that the ground consists of [m]."""


def plan_scene(cloud: GaussianCloud, config: MapConfig, cameras_m: Float64Array | None = None) -> ScenePlan:
    """Floor and occupancy maps of a scene.

    Args:
        cloud: Gaussians, metres, z up; no sky.
        config: Cells, thresholds and heights.
        cameras_m: Centres of the cameras that it was filmed with, in their order, shape (N, 3) [m]: floor is below.

    Raises:
        NoGroundError: If no floor is found.
    """
    estimate = estimate_floor(cloud, FLOOR_CELLS * config.resolution_m)
    if cameras_m is not None:
        estimate = complete_floor(estimate, cameras_m)
    frame = replace(estimate.floor.frame, resolution_m=config.resolution_m)
    shape = tuple(FLOOR_CELLS * n for n in estimate.supported.shape)
    above = above_floor(cloud, estimate.floor)
    bands = _occupied_bands(above, frame, (shape[0], shape[1]), config)
    robot = _with_compact_low(bands.low, bands.robot, config.resolution_m)
    robot |= _railings(bands.waist, robot, config.resolution_m)
    human = _with_compact_low(bands.low, bands.human, config.resolution_m)
    standing = _occupied_bands(above.select(_stand(cloud, estimate, config)), frame, (shape[0], shape[1]), config)
    steps = (estimate.step_m > STEP_M).repeat(FLOOR_CELLS, axis=0).repeat(FLOOR_CELLS, axis=1)
    phantoms = _phantoms(robot | human, steps | standing.low | standing.robot | standing.waist | standing.human)
    robot, human = robot & ~phantoms, human & ~phantoms
    closed = ~_walkable(estimate)
    ground = ground_detail(cloud, estimate.floor, estimate.supported)
    coarse, blurred = (
        part.repeat(FLOOR_CELLS, axis=0).repeat(FLOOR_CELLS, axis=1) for part in (ground.coarse, ground.blurred)
    )
    if config.close_coarse:
        closed |= coarse
    return ScenePlan(
        phantoms=phantoms & ~closed,
        coarse=coarse,
        blurred=blurred,
        ground_size_m=ground.size_m,
        robot=OccupancyMap(frame=frame, occupied=robot | closed),
        human=OccupancyMap(frame=frame, occupied=human | closed),
        floor=estimate.floor,
        unknown=closed & ~robot & ~human,
    )


def _walkable(estimate: FloorEstimate) -> BoolArray:
    """Map cells with floor that is not too steep."""
    height, cell_m = estimate.floor.height_m.astype(np.float64), estimate.floor.frame.resolution_m
    padded = np.pad(height, 1, mode="edge")
    rise_x = (padded[1:-1, 2:] - padded[1:-1, :-2]) / (2 * cell_m)
    rise_y = (padded[2:, 1:-1] - padded[:-2, 1:-1]) / (2 * cell_m)
    walkable = estimate.supported & (rise_x * rise_x + rise_y * rise_y <= SLOPE_MAX * SLOPE_MAX)
    return walkable.repeat(FLOOR_CELLS, axis=0).repeat(FLOOR_CELLS, axis=1)


def above_floor(cloud: GaussianCloud, floor: FloorMap) -> GaussianCloud:
    """The cloud with heights above the local floor instead of world z."""
    means = cloud.means_m.copy()
    means[:, 2] -= floor.at_many(cloud.means_m[:, :2].astype(np.float64)).astype(np.float32)
    return replace(cloud, means_m=means)


def _stand(cloud: GaussianCloud, estimate: FloorEstimate, config: MapConfig) -> BoolArray:
    """The Gaussians that stand on the floor: their centres are higher over what is seen of it than counts as floor."""
    relief = FloorMap(frame=estimate.floor.frame, height_m=estimate.relief_m.astype(np.float32))
    height_m = cloud.means_m[:, 2] - relief.at_many(cloud.means_m[:, :2].astype(np.float64))
    standing: BoolArray = height_m > GROUND_CLEARANCE_M
    return standing


def _phantoms(occupied: BoolArray, standing: BoolArray) -> BoolArray:
    """Islands without a cell in which something stands: rough ground made of thick Gaussians, not obstacles."""
    from scipy import ndimage

    labels, count = ndimage.label(occupied, np.ones((3, 3)))
    real = np.zeros(count + 1, np.bool_)
    real[np.unique(labels[standing])] = True
    real[0] = True
    phantoms: BoolArray = ~real[labels]
    return phantoms


@dataclass(frozen=True, kw_only=True, eq=False)
class _Bands:
    """Cells with an occupied voxel in a range of heights above the floor, shape (H, W) each."""

    low: BoolArray
    """Occupied from the ground clearance over LOW_BAND_M: where noise of the floor reaches."""
    robot: BoolArray
    """Occupied above `low`, up to the robot's height."""
    waist: BoolArray
    """Above the robot, up to RAIL_TOP_M."""
    human: BoolArray
    """Above `low`, up to the human's height."""


def _occupied_bands(cloud: GaussianCloud, frame: GridFrame, shape: tuple[int, int], config: MapConfig) -> _Bands:
    """Voxelise a cloud whose heights are relative to the floor."""
    cell_m, bottom_m = config.resolution_m, GROUND_CLEARANCE_M
    low, robot, rail, human = (
        math.ceil((top_m - bottom_m) / cell_m - 1e-6)
        for top_m in (bottom_m + LOW_BAND_M, config.robot_height_m, RAIL_TOP_M, config.human_height_m)
    )
    layers = max(low, robot, rail, human)
    bands = np.zeros((4, *shape), np.bool_)
    for rows, occupied in occupied_bands(cloud, frame, bottom_m, (layers, *shape), config.opacity_threshold):
        for band, (first, last) in zip(bands, ((0, low), (low, robot), (robot, rail), (low, human)), strict=True):
            band[rows] = occupied[first:last].any(axis=0)
    return _Bands(low=bands[0], robot=bands[1], waist=bands[2], human=bands[3])


def _with_compact_low(low: BoolArray, high: BoolArray, cell_m: float) -> BoolArray:
    """Cells of `high`, and those of `low` that belong to something at least LOW_WIDTH_M wide."""
    from scipy import ndimage

    width = max(2, round(LOW_WIDTH_M / cell_m))
    compact: BoolArray = ndimage.binary_opening(low | high, np.ones((width, width), np.bool_))
    return high | (low & compact)


def _railings(waist: BoolArray, below: BoolArray, cell_m: float) -> BoolArray:
    """Narrow, long things at waist height over free ground: handrails, whose glass or thin bars the scene lacks."""
    from scipy import ndimage

    reach = max(1, round(RAIL_WIDTH_M / (2 * cell_m)))
    i, j = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    broad = ndimage.binary_opening(waist | below, i * i + j * j <= (reach + 0.1) ** 2)
    labels, count = ndimage.label(waist & ~below & ~broad, np.ones((3, 3), np.bool_))
    long = np.zeros(count + 1, np.bool_)
    for label, (rows, columns) in enumerate(ndimage.find_objects(labels), start=1):
        long[label] = math.hypot(rows.stop - rows.start, columns.stop - columns.start) * cell_m >= RAIL_LENGTH_M
    railings: BoolArray = long[labels]
    return railings
