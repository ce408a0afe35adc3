"""The ground that a person with a phone walks on: its cells, a closed path over it, and the marker's place."""

from dataclasses import dataclass

import cv2
import numpy as np

from readygo.common.arrays import BoolArray, Float64Array
from readygo.common.errors import SceneError
from readygo.common.maps import GridFrame, clearance_m, free_components
from readygo.common.scenes import Scene

BODY_RADIUS_M = 0.25
AREA_MIN_M2 = 2.0
INSET_M = 0.25
"""Distance of the path from ground where a body does not fit, if there is room [m]."""
DOOR_M = 1.3
"""Gaps narrower than this are doors: a circle around a place holds its room only [m]."""
LOOP_MIN_M = 3.0
_STEP_M = 0.02
_SMOOTHING_M = (0.35, 0.2, 0.1)
MARKER_DISTANCE_M = 1.3
"""Approximate distance of the marker from the start of the walk [m]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class WalkableGround:
    """Connected cells of a scene that a person can stand on."""

    cells: BoolArray
    """True for walkable cells, shape (H, W)."""
    frame: GridFrame

    @property
    def area_m2(self) -> float:
        """Area of the ground [m2]."""
        return float(self.cells.sum()) * self.frame.resolution_m**2

    def holds(self, xy_m: Float64Array) -> BoolArray:
        """True for points [m] on the ground, shape (N, 2) -> (N,)."""
        row, column = self.frame.cells(xy_m)
        inside = (row >= 0) & (column >= 0) & (row < self.cells.shape[0]) & (column < self.cells.shape[1])
        held: BoolArray = inside & self.cells[np.where(inside, row, 0), np.where(inside, column, 0)]
        return held

    @property
    def centres_m(self) -> Float64Array:
        """Centres of the cells [m], shape (N, 2)."""
        return np.stack(self.frame.centre_m(*np.nonzero(self.cells))).T


def walking_ground(
    scene: Scene,
    *,
    crop: tuple[float, float, float, float] | None = None,
    start: tuple[float, float] | None = None,
    radius_m: float = 3.0,
) -> WalkableGround:
    """The ground that is filmed: the largest connected part of a rectangle, or the room at a circle's centre.

    Args:
        scene: Scene bundle.
        crop: x0 y0 x1 y1 of the rectangle [m], instead of start and radius.
        start: Centre of the circle [m]; the most open place of the scene by default.
        radius_m: Radius of the circle [m]; it ends at doors, unless the room is too small.

    Raises:
        SceneError: If the area has no walkable ground.
    """
    human = scene.maps.human
    clearance = clearance_m(human).astype(np.float64)
    x_m, y_m = _centres(human.frame, (human.occupied.shape[0], human.occupied.shape[1]))
    row, column = np.unravel_index(int(np.argmax(clearance)), clearance.shape)
    middle = start or human.frame.centre_m(int(row), int(column))
    if crop is not None:
        where = (x_m >= crop[0]) & (x_m <= crop[2]) & (y_m >= crop[1]) & (y_m <= crop[3])
        words = f"in the rectangle {' '.join(f'{value:g}' for value in crop)}"
    else:
        where = (x_m - middle[0]) ** 2 + (y_m - middle[1]) ** 2 <= radius_m**2
        words = f"within {radius_m:g} m of ({middle[0]:.1f}, {middle[1]:.1f})"
    standing = where & (clearance > BODY_RADIUS_M)
    if crop is not None:
        cells = free_components(standing)[0] == 1
    else:
        squared = (x_m - middle[0]) ** 2 + (y_m - middle[1]) ** 2
        cells = _room(standing, where & (clearance > 0.5 * DOOR_M), squared, human.frame.resolution_m)
    ground = WalkableGround(cells=cells, frame=human.frame)
    if ground.area_m2 < AREA_MIN_M2:
        raise SceneError(
            f"There are {ground.area_m2:.1f} m2 of connected ground to walk on {words}, {AREA_MIN_M2:g} m2 are needed; "
            "choose another place: --start X Y, --radius or --crop X0 Y0 X1 Y1 (`readygo scene inspect` draws a map)."
        )
    return ground


def _centres(frame: GridFrame, shape: tuple[int, int]) -> tuple[Float64Array, Float64Array]:
    x_m, y_m = frame.centre_m(np.arange(shape[0]), np.arange(shape[1]))
    return x_m[None, :], y_m[:, None]


def _room(standing: BoolArray, wide: BoolArray, squared_m2: Float64Array, cell_m: float) -> BoolArray:
    """The ground around a place, without the ground behind doors unless the rest is too small.

    Args:
        standing: Cells where a person can stand.
        wide: Cells where the ground is wider than a door.
        squared_m2: Squared distances from the place [m2].
        cell_m: Edge of a cell [m].
    """
    from scipy import ndimage

    core = _part_near(wide, squared_m2)
    if core.any():
        reach_m = 0.5 * DOOR_M - BODY_RADIUS_M + cell_m
        around = ndimage.distance_transform_edt(~core) * cell_m <= reach_m
        room = _part_near(standing & around, squared_m2)
        if room.sum() * cell_m * cell_m >= AREA_MIN_M2:
            return room
    return _part_near(standing, squared_m2)


def _part_near(cells: BoolArray, squared_m2: Float64Array) -> BoolArray:
    """The connected part of the cells that is nearest to a place."""
    labels, _ = free_components(cells)
    if not labels.any():
        return cells
    nearest = int(np.argmin(np.where(labels > 0, squared_m2, np.inf)))
    part: BoolArray = labels == labels.reshape(-1)[nearest]
    return part


def closed_way(ground: WalkableGround) -> Float64Array:
    """A closed, smooth path along the ground's border, counterclockwise, a point each 2 cm [m], shape (N, 2).

    Raises:
        SceneError: If the ground is too narrow to walk around.
    """
    from scipy import ndimage

    depth_m = ndimage.distance_transform_edt(np.pad(ground.cells, 1))[1:-1, 1:-1] * ground.frame.resolution_m
    for inset_m in (INSET_M, 0.5 * INSET_M, 0.0):
        labels, _ = free_components(depth_m > inset_m)
        outline = _outline(labels == 1, ground.frame)
        if len(outline) and _length_m(outline) >= LOOP_MIN_M:
            return _smooth_outline(outline, ground)
    raise SceneError(f"The ground of {ground.area_m2:.1f} m2 is too narrow to walk around; choose a larger part.")


def _outline(cells: BoolArray, frame: GridFrame) -> Float64Array:
    outlines, _ = cv2.findContours(cells.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    if not outlines:
        return np.empty((0, 2))
    longest = max(outlines, key=len).reshape(-1, 2).astype(np.int64)
    x, y = frame.centre_m(longest[:, 1], longest[:, 0])
    points = np.column_stack([x, y])
    clockwise = float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))) < 0.0
    return points[::-1] if clockwise else points


def _length_m(points: Float64Array) -> float:
    return float(np.hypot(*(np.roll(points, -1, axis=0) - points).T).sum())


def _smooth_outline(outline: Float64Array, ground: WalkableGround) -> Float64Array:
    """The outline, smoothed as far as it stays on the ground."""
    from scipy.ndimage import gaussian_filter1d

    even = _evenly(outline)
    for sigma_m in _SMOOTHING_M:
        way = gaussian_filter1d(even, sigma_m / _STEP_M, axis=0, mode="wrap")
        if ground.holds(way).mean() > 0.97:
            break
    return _evenly(way)


def _evenly(points: Float64Array) -> Float64Array:
    closed = np.concatenate([points, points[:1]])
    at_m = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(closed, axis=0).T))])
    wanted = np.linspace(0.0, at_m[-1], max(8, round(at_m[-1] / _STEP_M)), endpoint=False)
    return np.stack([np.interp(wanted, at_m, closed[:, k]) for k in (0, 1)], axis=1)


def marker_place(ground: WalkableGround, way: Float64Array) -> tuple[int, tuple[float, float]]:
    """Index of the path's point where the walk begins, and position of the marker [m].

    The marker lies on the most open ground, where most of the path sees it; the walk begins where the path is at the
    usual filming distance from it.
    """
    from scipy import ndimage

    depth_m = ndimage.distance_transform_edt(np.pad(ground.cells, 1))[1:-1, 1:-1] * ground.frame.resolution_m
    spots, room_m = ground.centres_m, depth_m[ground.cells]
    nearest_m = np.sqrt(_squared_to_way(spots, way))
    spot = spots[int(np.argmax(np.minimum(room_m, 0.6) - np.abs(nearest_m - MARKER_DISTANCE_M)))]
    away_m = np.hypot(*(way - spot).T)
    begin = int(np.argmin(np.abs(away_m - MARKER_DISTANCE_M)))
    return begin, (float(spot[0]), float(spot[1]))


def _squared_to_way(spots: Float64Array, way: Float64Array) -> Float64Array:
    from scipy.spatial import cKDTree

    distance, _ = cKDTree(way).query(spots)
    return np.asarray(distance, dtype=np.float64) ** 2
