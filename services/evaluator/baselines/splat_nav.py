"""A planner through the Gaussians themselves, as Splat-Nav is one: free cells, safe polygons, smooth path, controller.

The robot is a stack of balls that hold its body, an obstacle is the ellipsoid of a Gaussian at a confidence; ground is
what stays below the step that the scene's maps allow. A* on a coarse grid of places where the balls meet nothing gives
a way, every piece of it a convex polygon in which they meet nothing either, and the path bends as little as it can
while each of its pieces stays in a polygon. It knows all Gaussians, and of humans nothing: a privileged baseline of the
static task.

Source: Chen et al., Splat-Nav: Safe real-time robot navigation in Gaussian splatting maps, 2024, sections IV to VI,
there for a quadrotor: its path is a spline by quadratic programming, here a chain of points by projection; its robot is
one ellipsoid, and every Gaussian counts, however transparent.
"""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from readygo.common.arrays import BoolArray, Float64Array
from readygo.common.episode import EpisodeSimulation
from readygo.common.episode.grid_search import FREE, GridSearch, taut_path_m
from readygo.common.episode.loop import Command, DriverFailure
from readygo.common.gaussians import GaussianCloud
from readygo.common.maps import FloorMap, GridFrame
from readygo.common.robot import RobotConfig
from readygo.services.evaluator.baselines.ellipsoids import Ellipsoids

SIGMAS = 1.0
"""Half axes of an obstacle in standard deviations: a fifth of a Gaussian's mass is within 1, as published."""
OPACITY_MIN = 0.5
"""Gaussians that hide less are no obstacles: the threshold of the maps for a voxel."""
THICKNESS_MIN_M = 1e-3
CELL_M = 0.1
SNAP_M = 0.5
"""Starts and goals that meet something are moved this far at most, to the nearest free cell [m]."""
POLYGON_M = 0.6
"""Gaussians farther from a piece of the way than this do not bound its polygon: it ends there [m]."""
PIECE_M, POINT_M = 1.0, 0.1
"""Longest piece of the path with one polygon, and spacing of the path's points [m]."""
SWEEPS, PROJECTIONS = 60, 20
LOOKAHEAD_M = 0.3
MARGIN_M = 0.03
"""Added to the planning radius: the controller is not always on its path [m]."""
TURN_GAIN_PER_S = 2.5
ROUGH_RAD = 0.7
"""A robot that has to turn by more than this stands while it does."""


@dataclass(frozen=True)
class Polygon:
    """A convex part of the ground: x, y with planes[:, :2] @ (x, y) <= planes[:, 2]."""

    planes: Float64Array


@dataclass
class Way:
    """State of one episode: its path and how far the robot has come."""

    path_m: Float64Array | None
    """Path [m], shape (N, 2); None if there is none."""
    reached: int = 0
    """Index of the path's point that the robot has reached."""


class SplatMap:
    """What a robot of some size can pass in a scene of Gaussians."""

    def __init__(
        self,
        cloud: GaussianCloud,
        floor: FloorMap,
        frame: GridFrame,
        unknown: BoolArray,
        robot: RobotConfig,
        ground_clearance_m: float,
    ) -> None:
        """Find out where the robot meets nothing.

        Args:
            cloud: The scene.
            floor: Height of its floor.
            frame: Grid of `unknown`.
            unknown: Cells without a floor, shape (H, W): Gaussians say nothing about ground that is not there.
            robot: Whose body it is; the balls have its planning radius, and a margin.
            ground_clearance_m: What is no higher above the floor is ground [m].
        """
        self._floor, self.radius_m = floor, robot.planning_radius_m + MARGIN_M
        self.heights_m = ball_heights(robot)
        self.obstacles = _obstacles(cloud, floor, ground_clearance_m, robot.height_m)
        per_cell = max(round(CELL_M / frame.resolution_m), 1)
        cell_m = per_cell * frame.resolution_m
        self.frame = GridFrame(origin_x_m=frame.origin_x_m, origin_y_m=frame.origin_y_m, resolution_m=cell_m)
        rows, columns = (-(-size // per_cell) for size in unknown.shape)
        padded = np.ones((rows * per_cell, columns * per_cell), np.bool_)
        padded[: unknown.shape[0], : unknown.shape[1]] = unknown
        without_floor = padded.reshape(rows, per_cell, columns, per_cell).any(axis=(1, 3))
        self._centres_m = np.array([self.frame.centre_m(i, j) for i in range(rows) for j in range(columns)])
        ground = floor.at_many(self._centres_m).reshape(rows, columns)
        centres_z = ground[None] + np.array(self.heights_m)[:, None, None]
        origin = frame.origin_x_m, frame.origin_y_m
        self.blocked = self.obstacles.blocked_cells(centres_z, origin, cell_m, self.radius_m) | without_floor

    def path_m(self, start_m: tuple[float, float], goal_m: tuple[float, float]) -> Float64Array | None:
        """A smooth path on which the robot meets nothing, shape (N, 2) [m]; None where there is none."""
        start, goal = self._free_cell(start_m), self._free_cell(goal_m)
        if start is None or goal is None:
            return None
        factor = np.where(self.blocked, np.uint8(0), np.uint8(FREE))
        cells = GridSearch(factor.shape).path(factor, start, goal)
        if cells is None:
            return None
        way = _pieces(taut_path_m(cells, factor, self.frame))
        polygons = [self.polygon(begin, end) for begin, end in itertools.pairwise(way)]
        return smooth_path_m(way, polygons)

    def polygon(self, begin_m: Float64Array, end_m: Float64Array) -> Polygon:
        """Area around a piece of the path in which the robot meets nothing."""
        a, b = (float(begin_m[0]), float(begin_m[1])), (float(end_m[0]), float(end_m[1]))
        near = self.obstacles.near(a, b, POLYGON_M + self.radius_m)
        low, high = np.minimum(a, b) - POLYGON_M, np.maximum(a, b) + POLYGON_M
        ground = self._floor.at(*a), self._floor.at(*b)
        planes = [
            near.half_planes((*a, ground[0] + height), (*b, ground[1] + height), self.radius_m)
            for height in self.heights_m
        ]
        return _polygon_of(low, high, np.concatenate(planes), 0.5 * (begin_m + end_m))

    def _free_cell(self, xy_m: tuple[float, float]) -> tuple[int, int] | None:
        """The nearest cell in which the robot meets nothing."""
        distances = np.where(self.blocked.ravel(), np.inf, np.hypot(*(self._centres_m - xy_m).T))
        nearest = int(distances.argmin())
        return divmod(nearest, self.blocked.shape[1]) if distances[nearest] <= SNAP_M else None


class SplatNavDriver:
    """Follows the path of a `SplatMap`."""

    looks = False

    def __init__(self, splats: SplatMap) -> None:
        self._splats = splats

    def start(self, simulation: EpisodeSimulation) -> Way:
        """The way to the episode's goal."""
        goal_x, goal_y = simulation.scenario.goal_xy_m.tolist()
        return Way(self._splats.path_m((simulation.x_m, simulation.y_m), (goal_x, goal_y)))

    def act(self, running: Sequence[tuple[EpisodeSimulation, Way]]) -> list[Command | DriverFailure]:
        """See `Driver.act`."""
        return [self._command(simulation, way) for simulation, way in running]

    def _command(self, simulation: EpisodeSimulation, way: Way) -> tuple[float, float] | DriverFailure:
        if way.path_m is None:
            return DriverFailure("there is no safe way through the Gaussians")
        here, robot = np.array([simulation.x_m, simulation.y_m]), simulation.robot
        ahead = way.path_m[way.reached :]
        way.reached += int(np.hypot(*(ahead[: round(1.0 / POINT_M)] - here).T).argmin())
        distances = np.hypot(*(way.path_m[way.reached :] - here).T)
        target = way.path_m[way.reached + int(np.argmax(distances > LOOKAHEAD_M))]
        if distances.max() <= LOOKAHEAD_M:
            target = way.path_m[-1]
        bearing = math.atan2(target[1] - here[1], target[0] - here[0]) - simulation.yaw_rad
        bearing = (bearing + math.pi) % (2 * math.pi) - math.pi
        w = min(max(TURN_GAIN_PER_S * bearing, -robot.w_max_radps), robot.w_max_radps)
        if abs(bearing) > ROUGH_RAD:
            return 0.0, w
        # The arc through the target, as fast as the robot can turn.
        curvature = 2.0 * abs(math.sin(bearing)) / LOOKAHEAD_M
        return min(robot.v_max_mps, 0.8 * robot.w_max_radps / max(curvature, 1e-6)), w


def ball_heights(robot: RobotConfig) -> list[float]:
    """Centres above the floor of a stack of balls of the planning radius that hold the robot's cylinder [m]."""
    half_m = math.sqrt(robot.planning_radius_m**2 - robot.radius_m**2)
    count = max(math.ceil(robot.height_m / (2 * half_m)), 1) if half_m > 0.05 else 6
    return [(k + 0.5) * robot.height_m / count for k in range(count)]


def smooth_path_m(way_m: Float64Array, polygons: Sequence[Polygon]) -> Float64Array:
    """The path along a way that bends little, every step of it within one polygon.

    Args:
        way_m: Corners, shape (P + 1, 2).
        polygons: Of each piece, which is inside of it.

    Returns:
        Shape (N, 2).
    """
    counts = [max(math.ceil(math.dist(a, b) / POINT_M), 1) for a, b in itertools.pairwise(way_m)]
    shares = [np.arange(count)[:, None] / count for count in counts]
    points = [a + share * (b - a) for a, b, share in zip(way_m[:-1], way_m[1:], shares, strict=True)]
    path = np.concatenate([*points, way_m[-1:]])
    # A corner is in both polygons: so are both steps beside it.
    bounds: list[Float64Array] = []
    for k, count in enumerate(counts):
        both = np.concatenate([polygons[k - 1].planes, polygons[k].planes]) if k else polygons[k].planes
        bounds += [both] + [polygons[k].planes] * (count - 1)
    for _ in range(SWEEPS):
        for i in range(1, len(path) - 1):
            wanted = _unbent(path, i)
            found = _into(wanted, bounds[i])
            if found is not None:
                path[i] = found
    return path


def _polygon_of(low: Float64Array, high: Float64Array, planes: Float64Array, inside_m: Float64Array) -> Polygon:
    """A box cut by half-planes, without those that the others make needless: the nearest to a point inside go first."""
    kept = np.array([[-1.0, 0.0, -low[0]], [0.0, -1.0, -low[1]], [1.0, 0.0, high[0]], [0.0, 1.0, high[1]]])
    corners = np.array([low, [high[0], low[1]], high, [low[0], high[1]]])
    while len(corners):
        # What does not cut the polygon will not cut a smaller one.
        planes = planes[(planes[:, :2] @ corners.T).max(axis=1) > planes[:, 2] + 1e-9]
        if not len(planes):
            break
        nearest = planes[(planes[:, 2] - planes[:, :2] @ inside_m).argmin()]
        kept, corners = np.concatenate([kept, nearest[None]]), _cut(corners, nearest)
    return Polygon(kept)


def _cut(corners_m: Float64Array, plane: Float64Array) -> Float64Array:
    """The corners of what is left of a convex polygon (Sutherland & Hodgman)."""
    over = corners_m @ plane[:2] - plane[2]
    left = []
    for k, (here, there) in enumerate(zip(over, np.roll(over, -1), strict=True)):
        following = corners_m[(k + 1) % len(corners_m)]
        if here <= 0.0:
            left.append(corners_m[k])
        if here * there < 0.0:
            left.append(corners_m[k] + here / (here - there) * (following - corners_m[k]))
    return np.array(left).reshape(-1, 2)


def _unbent(path_m: Float64Array, i: int) -> Float64Array:
    """Position of a point at which it bends the path least while its neighbours stay where they are."""
    beside = path_m[i - 1] + path_m[i + 1]
    if 2 <= i < len(path_m) - 2:
        least: Float64Array = (4.0 * beside - path_m[i - 2] - path_m[i + 2]) / 6.0
        return least
    middle: Float64Array = 0.5 * beside
    return middle


def _into(xy_m: Float64Array, planes: Float64Array) -> Float64Array | None:
    """A point moved into a polygon, plane by plane; None where that takes too long."""
    point = xy_m
    for _ in range(PROJECTIONS):
        over = planes[:, :2] @ point - planes[:, 2]
        worst = int(over.argmax())
        if over[worst] <= 0.0:
            return point
        point = point - (over[worst] + 1e-9) * planes[worst, :2]
    return None


def _pieces(corners_m: Float64Array) -> Float64Array:
    """A way with further corners, so that no piece is longer than `PIECE_M`."""
    pieces = [corners_m[:1]]
    for begin, end in itertools.pairwise(corners_m):
        count = max(math.ceil(math.dist(begin, end) / PIECE_M), 1)
        pieces.append(begin + np.arange(1, count + 1)[:, None] / count * (end - begin))
    return np.concatenate(pieces)


def _obstacles(cloud: GaussianCloud, floor: FloorMap, ground_clearance_m: float, height_m: float) -> Ellipsoids:
    """The Gaussians that are more than ground, and not above the robot."""
    half_axes = SIGMAS * np.maximum(cloud.scales_m.astype(np.float64), THICKNESS_MIN_M)
    ground = floor.at_many(cloud.means_m[:, :2].astype(np.float64))
    w, x, y, z = (cloud.quats_wxyz / np.linalg.norm(cloud.quats_wxyz, axis=1, keepdims=True)).astype(np.float64).T
    up = np.stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)], axis=1)
    reach = np.sqrt(np.square(half_axes * up).sum(axis=1))
    above = cloud.means_m[:, 2] - ground
    kept = (above + reach > ground_clearance_m) & (above - reach < height_m) & (cloud.opacities >= OPACITY_MIN)
    return Ellipsoids(cloud.means_m[kept], cloud.quats_wxyz[kept], half_axes[kept])
