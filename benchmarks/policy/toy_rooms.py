"""A toy world for benchmarks of the policy: box rooms drawn by a ray caster, and an expert that sees the map."""

import heapq
import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import cv2
import numpy as np

from readygo.common.arrays import BoolArray, Float32Array, Float64Array, RecordArray, UInt8Array
from readygo.common.camera import SensorConfig
from readygo.common.episode import EpisodeConfig
from readygo.common.frames import goal_in_robot_frame
from readygo.common.kernels import kernel_with_cache
from readygo.common.messages import EpisodeKey, Split
from readygo.common.messages.plan import DriverKind, Outcome
from readygo.common.robot import RobotConfig, limit_command, step_unicycle
from readygo.common.robot.kinematics import DT_S

CELL_M = 0.1


@kernel_with_cache
def _hash(a, b, c):
    h = (a * 73856093) ^ (b * 19349663) ^ (c * 83492791)
    h = (h ^ (h >> 13)) * 1274126177
    return ((h ^ (h >> 16)) & 255) / 255.0


@kernel_with_cache
def draw(occupied, x, y, yaw, focal, eye, image):
    """Fill `image` (H, W, 3) uint8 with walls 1.2 m high, floor and ceiling."""
    height, width = image.shape[0], image.shape[1]
    for u in range(width):
        t = (width / 2 - u - 0.5) / focal
        dx, dy = math.cos(yaw) - t * math.sin(yaw), math.sin(yaw) + t * math.cos(yaw)
        depth, side, i, j = _march(occupied, x / 0.1, y / 0.1, dx, dy)
        depth *= 0.1
        hx, hy = x + dx * depth, y + dy * depth
        tone = 0.75 if side == 0 else 1.0
        for v in range(height):
            s = (v + 0.5 - height / 2) / focal
            z = eye - s * depth
            if z < 0.0 or (z > 1.2 and s > 0):
                z = 0.0
            if z <= 0.0:
                d = eye / s
                fx, fy = x + dx * d, y + dy * d
                n = _hash(math.floor(fx * 4), math.floor(fy * 4), 7)
                r, g, b = 90 + 50 * n, 80 + 40 * n, 70 + 30 * n
            elif z <= 1.2:
                n = _hash(math.floor(hx * 5), math.floor(hy * 5), math.floor(z * 5))
                m = _hash(i // 8, j // 8, 3)
                r = tone * (60 + 120 * m + 40 * n)
                g = tone * (150 - 80 * m + 40 * n)
                b = tone * (90 + 60 * _hash(i // 8, j // 8, 5) + 40 * n)
            else:
                r, g, b = 200.0, 205.0, 215.0
            image[v, u, 0], image[v, u, 1], image[v, u, 2] = int(r), int(g), int(b)


@kernel_with_cache
def _march(occupied, x, y, dx, dy):
    i, j = math.floor(y), math.floor(x)
    step_j, step_i = (1 if dx > 0 else -1), (1 if dy > 0 else -1)
    inv_x, inv_y = 1.0 / max(abs(dx), 1e-9), 1.0 / max(abs(dy), 1e-9)
    tx = ((j + 1 - x) if dx > 0 else (x - j)) * inv_x
    ty = ((i + 1 - y) if dy > 0 else (y - i)) * inv_y
    t, side = 0.0, 0
    for _ in range(2000):
        if tx < ty:
            t, side, j, tx = tx, 0, j + step_j, tx + inv_x
        else:
            t, side, i, ty = ty, 1, i + step_i, ty + inv_y
        if occupied[i, j]:
            break
    return max(t, 1e-3), side, i, j


@dataclass
class Rooms:
    """One toy world."""

    occupied: BoolArray
    robot: RobotConfig
    distance_m: Float64Array
    """Distance of each cell's centre to the nearest occupied cell."""

    def image(self, x: float, y: float, yaw: float) -> UInt8Array:
        """What the robot sees."""
        camera = self.robot.camera
        image = np.empty((camera.height_px, camera.width_px, 3), np.uint8)
        draw(self.occupied, x, y, yaw, camera.K_px[0, 0], camera.mount_height_m, image)
        return image

    def clearance_m(self, x: float, y: float) -> float:
        """Distance to the nearest occupied cell, some centimetres rough."""
        return float(self.distance_m[int(y / CELL_M), int(x / CELL_M)])


def make_rooms(robot: RobotConfig, *, seed: int = 0, size_m: float = 12.0, boxes: int = 16) -> Rooms:
    """A square hall with boxes and two walls with a door."""
    from scipy.ndimage import distance_transform_edt

    rng = np.random.default_rng(seed)
    n = round(size_m / CELL_M)
    occupied = np.zeros((n, n), np.bool_)
    occupied[:2] = occupied[-2:] = True
    occupied[:, :2] = occupied[:, -2:] = True
    occupied[n // 2 : n // 2 + 2, : n // 3] = True
    occupied[2 * n // 3 :, n // 2 : n // 2 + 2] = True
    for _ in range(boxes):
        i, j = rng.integers(10, n - 15, 2)
        h, w = rng.integers(4, 12, 2)
        occupied[i : i + h, j : j + w] = True
    return Rooms(occupied, robot, CELL_M * distance_transform_edt(~occupied))


def cost_to_go(rooms: Rooms, goal: Float64Array) -> Float64Array:
    """Distance to the goal around obstacles, with a price on narrow places, shape of the grid."""
    free = rooms.distance_m > rooms.robot.planning_radius_m + 0.1
    price = 1 + 3 * np.clip(0.7 - rooms.distance_m, 0, None)
    cost = np.full(free.shape, np.inf)
    start = (int(goal[1] / CELL_M), int(goal[0] / CELL_M))
    cost[start] = 0.0
    queue = [(0.0, start)]
    while queue:
        d, (i, j) = heapq.heappop(queue)
        if d > cost[i, j]:
            continue
        for di, dj in ((0, 1), (1, 0), (0, -1), (-1, 0), (1, 1), (1, -1), (-1, 1), (-1, -1)):
            k = (i + di, j + dj)
            new = d + CELL_M * math.hypot(di, dj) * price[k]
            if free[k] and new < cost[k]:
                cost[k] = new
                heapq.heappush(queue, (new, k))
    return cost


def expert_command(cost: Float64Array, pose: Sequence[float], robot: RobotConfig) -> tuple[float, float]:
    """Pure pursuit down the cost-to-go."""
    x, y, yaw = pose
    i, j = int(y / CELL_M), int(x / CELL_M)
    for _ in range(8):
        best = (cost[i, j], i, j)
        for di in (-1, 0, 1):
            for dj in (-1, 0, 1):
                best = min(best, (cost[i + di, j + dj], i + di, j + dj))
        _, i, j = best
    bearing = math.atan2((i + 0.5) * CELL_M - y, (j + 0.5) * CELL_M - x) - yaw
    bearing = (bearing + math.pi) % (2 * math.pi) - math.pi
    return robot.v_max_mps * max(0.15, math.cos(bearing)) ** 2, 1.8 * bearing


@dataclass
class ToyTask:
    """Start and goal."""

    pose: tuple[float, float, float]
    goal: Float64Array
    cost: Float64Array = field(repr=False)


def draw_task(rooms: Rooms, rng: np.random.Generator) -> ToyTask:
    """A start with 3 to 10 m to a goal, heading at it."""
    size = rooms.occupied.shape[0] * CELL_M
    while True:
        a, b = rng.uniform(0.5, size - 0.5, (2, 2))
        if rooms.clearance_m(*a) < 0.5 or rooms.clearance_m(*b) < 0.5 or not 3 < math.dist(a, b) < 10:
            continue
        cost = cost_to_go(rooms, b)
        if np.isfinite(cost[int(a[1] / CELL_M), int(a[0] / CELL_M)]):
            return ToyTask((float(a[0]), float(a[1]), math.atan2(b[1] - a[1], b[0] - a[0])), b, cost)


def drive(rooms: Rooms, task: ToyTask, command, *, time_limit_s: float = 50.0):
    """Drive `command(image, goal, previous, pose)` until the end; returns success and the records."""
    pose, previous, records = task.pose, (0.0, 0.0), []
    for _ in range(round(time_limit_s / DT_S)):
        image, goal = rooms.image(*pose), goal_in_robot_frame(*pose, task.goal)
        action = limit_command(*command(image, goal, previous, pose), *previous, rooms.robot, DT_S)
        records.append((image, goal, action, (pose[0], pose[1], 0.0, pose[2])))
        pose, previous = step_unicycle(*pose, *action, DT_S), action
        if rooms.clearance_m(pose[0], pose[1]) < rooms.robot.radius_m:
            return "static_collision", records
        if math.hypot(*goal_in_robot_frame(*pose, task.goal)) < EpisodeConfig().success_radius_m:
            return "success", records
    return "timeout", records


@dataclass
class ToyEpisode:
    """An episode's place among the samples."""

    episode: EpisodeKey
    first_sample: int
    sample_count: int
    sha256: str
    driver: DriverKind = DriverKind.EXPERT
    outcome: Outcome = Outcome.SUCCESS
    policy: str = ""
    drawn: dict[str, float] = field(default_factory=dict)


@dataclass
class ToyDataset:
    """Recorded expert episodes, with the face of `readygo.common.dataset.Dataset`."""

    episodes: list[ToyEpisode]
    actions: Float32Array
    goals_xy_m: Float32Array
    poses: Float64Array
    images: list[UInt8Array]
    robot: RobotConfig
    content_hash: str = "toy"
    sensor: SensorConfig = field(default_factory=SensorConfig)
    has_expert: bool = False
    has_risks: bool = False

    @property
    def truth(self) -> RecordArray:
        """There are no humans."""
        truth = np.zeros(len(self.actions), [("human_distance_m", np.float64), ("human_visible", np.bool_)])
        truth["human_distance_m"] = np.inf
        return truth

    @property
    def humans_xyzyaw(self) -> list[Float64Array]:
        """There are no humans."""
        return [np.empty((0, 4))] * len(self.actions)

    def image(self, index: int) -> bytes:
        """Encoded image of a sample."""
        return cv2.imencode(".jpg", self.images[index][:, :, ::-1])[1].tobytes()


def record(rooms: Rooms, count: int, *, seed: int) -> ToyDataset:
    """`count` successful expert episodes."""
    rng, episodes, rows = np.random.default_rng(seed), [], []
    while len(episodes) < count:
        task = draw_task(rooms, rng)
        outcome, records = drive(rooms, task, lambda i, g, p, pose, c=task.cost: expert_command(c, pose, rooms.robot))
        if outcome == "success":
            key = EpisodeKey(seed=seed, split=Split.TRAIN, index=len(episodes))
            episodes.append(ToyEpisode(key, len(rows), len(records), f"toy-{key.episode_id}"))
            rows += records
    images, goals, actions, poses = zip(*rows, strict=True)
    return ToyDataset(
        episodes,
        np.array(actions, np.float32),
        np.array(goals, np.float32),
        np.array(poses),
        list(images),
        rooms.robot,
        f"toy-{seed}-{count}",
    )
